"""Tables of a loaded rod for the kernels."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.section.section_tables import (
    SectionTables,
    no_exact,
    section_tables,
)
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.rod import LoadedRod


class ElementTables(NamedTuple):
    """The elements of a loaded rod, with ``each`` collocation points per element.

    Most kernels need this part of `RodTables` only.

    Attributes:
        from_start: matrix of the integrals within an element from its start, (each, each).
        from_start_columns: its transpose.
        to_end_columns: transpose of the matrix of the integrals from a point to the end of the
            element, (each, each).
        twice: from values f at the points to the integrals, from each point to the end, of f times
            the integral of another g from the start: (each of f, each of g x lower limits).
        tail: matrix from the values at the points to the last two Legendre coefficients, (2,
            each).
        weights: weights of the integral over an element of length one, (each,).
        step: lengths of the elements [m], (elements,).
        lengths: length of the element of each point [m], (points,).
        quadrature: weights of the integral over the arm [m], (points,).
        base: orientation of the base as a quaternion w, x, y, z, (4,).
        length: length of the arm [m].
    """

    from_start: FloatArray
    from_start_columns: FloatArray
    to_end_columns: FloatArray
    twice: FloatArray
    tail: FloatArray
    weights: FloatArray
    step: FloatArray
    lengths: FloatArray
    quadrature: FloatArray
    base: FloatArray
    length: float


class RodTables(NamedTuple):
    """The data of a `LoadedRod` and its `Equilibrium` that the kernels use.

    Attributes:
        elements: the collocated elements.
        sections: cross sections at the points of all elements.
        force: resultant of the loads beyond each point [N], (3, points).
        moment: resultant of the free moments beyond each point [N m], (3, points).
        position: position of the base [m], (3,).
        node_runs: element, first node and number of nodes of each run of nodes in one element,
            (runs, 3).
        to_nodes: matrices (each, nodes) from values at points to those at the nodes of a run, one
            after another.
        station_runs: element, first station and number of stations of each run of stations in one
            element, (runs, 3).
        to_stations: matrices (each, stations) from values at points to their integrals from the
            start of the element, of length one, to the stations of a run, one after another.
        at_stations: matrices (each, stations) from values at points to those at the stations of a
            run, one after another.
        most: largest number of stations in one run.
        station_sections: cross sections at the stations.
        station_node: node of each station, (stations,).
    """

    elements: ElementTables
    sections: SectionTables
    force: FloatArray
    moment: FloatArray
    position: FloatArray
    node_runs: IntArray
    to_nodes: FloatArray
    station_runs: IntArray
    to_stations: FloatArray
    at_stations: FloatArray
    most: int
    station_sections: SectionTables
    station_node: IntArray


class ParameterTables(NamedTuple):
    """Derivatives of cross sections by parameters at the points: tables of `ParameterDerivatives`.

    Attributes:
        x: component along n of the unit vector from the midline to each tendon, (tendons, points).
        y: component along b of that vector, (tendons, points).
        dx: derivative of ``x`` by arc length [1/m], (tendons, points).
        dy: derivative of ``y`` by arc length [1/m], (tendons, points).
        torsion_by_poisson: derivative of G I by Poisson's ratio [N m^2], (points,).
    """

    x: FloatArray
    y: FloatArray
    dx: FloatArray
    dy: FloatArray
    torsion_by_poisson: FloatArray


def rod_tables(rod: LoadedRod) -> RodTables:
    """Collect the `RodTables` of ``rod``."""
    problem = rod.equilibrium
    own, rule = problem.collocation, problem.collocation.rule
    a, b = problem.base.a.item(), problem.base.b.item()
    nodes, stations = rod.nodes, rod.stations
    node_runs, to_nodes = runs_by_element(nodes.element, nodes.values)
    within = stations.within / own.step[stations.element, np.newaxis]
    lengths = np.repeat(own.step, rule.points.size)
    station_runs, to_stations = runs_by_element(stations.element, within)
    _, at_stations = runs_by_element(stations.element, stations.values)
    elements = ElementTables(
        from_start=rule.from_start,
        from_start_columns=rule.from_start.T,
        to_end_columns=rule.to_end.T,
        twice=own.twice.reshape(3 * (rule.points.size,)).swapaxes(1, 2).reshape(own.twice.shape),
        tail=rule.tail,
        weights=rule.weights,
        step=own.step,
        lengths=lengths,
        quadrature=lengths * np.tile(rule.weights, own.step.size),
        base=np.array([a.real, a.imag, b.real, b.imag]),
        length=own.length,
    )
    return RodTables(
        elements=elements,
        sections=section_tables(problem.energy),
        force=problem.loads.dead.force,
        moment=problem.loads.dead.moment,
        position=rod.base.position,
        node_runs=node_runs,
        to_nodes=to_nodes,
        station_runs=station_runs,
        to_stations=to_stations,
        at_stations=at_stations,
        most=int(station_runs[:, 2].max()),
        station_sections=section_tables(rod.station_sections),
        station_node=rod.station_node,
    )


def parameter_tables(rod: LoadedRod) -> ParameterTables:
    """Collect the `ParameterTables` of ``rod``."""
    x, y, dx, dy = (table[:, 0] for table in rod.parameters.outwards)
    return ParameterTables(x, y, dx, dy, rod.parameters.torsion_by_poisson[0])


def runs_by_element(element: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cut places into runs of which each lies in one element, and gather their matrices.

    ``element`` (n,) is the number of the element of each place, ``values`` (n, each) the weights
    of the element's points for it.

    Returns:
        Element, first place and number of places of each run, (runs, 3); and the transposed
        ``values`` of each run, (each, number), flattened one after another.
    """
    edges = [0, *(np.flatnonzero(np.diff(element)) + 1), element.size]
    runs = [(element[i], i, j - i) for i, j in itertools.pairwise(edges)]
    matrices = [values[i:j].T.ravel() for i, j in itertools.pairwise(edges)]
    return np.array(runs, np.int64), np.concatenate(matrices)


def no_rod() -> RodTables:
    """Make empty `RodTables`, of the same types for the compiler as those of `rod_tables`."""
    none, table, nothing = np.zeros(0), np.zeros((0, 0)), np.zeros((3, 0))
    runs, sections = np.zeros((0, 3), np.int64), no_exact().sections
    elements = ElementTables(
        table, table, table, table, np.zeros((2, 0)), none, none, none, none, np.zeros(4), 1.0
    )
    return RodTables(
        elements, sections, nothing, nothing, np.zeros(3), runs, none, runs, none, none, 0,
        sections, np.zeros(0, np.int64),
    )  # fmt: skip


def no_parameters() -> ParameterTables:
    """Make empty `ParameterTables`, of the same types for the compiler as `parameter_tables`."""
    table = np.zeros((0, 0))
    return ParameterTables(table, table, table, table, np.zeros(0))
