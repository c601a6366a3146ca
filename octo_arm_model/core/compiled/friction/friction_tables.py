"""Tables of tendons with friction for the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.rod_tables import runs_by_element
from octo_arm_model.core.compiled.section.section_tables import (
    SectionTables,
    no_exact,
    section_tables,
)
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.section.energy import SectionEnergy


class FrictionTables(NamedTuple):
    """The data of a rod whose tendons have friction, with ``each`` points per element.

    Attributes:
        sections: cross sections at the points of all elements. The kernels overwrite their
            ``transmission`` by the tensions at the points [N] and pass tensions of 1 at the base.
        transmission: part of its tension at the base that each tendon has at a point without
            friction, (tendons, points).
        reach: number of points up to the anchorage of each tendon, (tendons,).
        coefficient: coefficient of friction mu of each tendon, (tendons,).
        step: lengths of the elements [m], (elements,).
        lengths: length of the element of each point [m], (points,).
        quadrature: weights of the integral along the arm [m], (points,).
        from_start_columns: transpose of the matrix of the integrals within an element of length
            one from its start, (each, each).
        differentiate_columns: transpose of the matrix of the derivatives at the points of an
            element of length one, (each, each).
        end_columns: transpose of the matrix from values at the points to those at both ends of an
            element, (each, 2).
        tail: matrix from values at the points to the last two Legendre coefficients, (2, each).
        node_paths: x, y, dx and dy of `SectionTables` at the nodes of the grid, (4, tendons,
            nodes); without nodes for exact sections.
        node_stiffness: axial, squared and torsion of `SectionTables` at the nodes, (3, nodes);
            without nodes for exact sections.
        runs: element, first node and number of nodes of each run of nodes in one element, (runs,
            3).
        to_nodes: matrices (each, nodes) from values at points to those at the nodes of a run, one
            after another.
        station_runs: element, first station and number of stations of each run of stations in one
            element, (runs, 3).
        to_stations: matrices (each, stations) from values at points to those at the stations of a
            run, one after another.
        is_exact: whether cross sections minimise the energy; otherwise their twist is that of the
            closed form.
        is_finest: whether there are no finer elements, as in `LoadedRod`.
    """

    sections: SectionTables
    transmission: FloatArray
    reach: IntArray
    coefficient: FloatArray
    step: FloatArray
    lengths: FloatArray
    quadrature: FloatArray
    from_start_columns: FloatArray
    differentiate_columns: FloatArray
    end_columns: FloatArray
    tail: FloatArray
    node_paths: FloatArray
    node_stiffness: FloatArray
    runs: IntArray
    to_nodes: FloatArray
    station_runs: IntArray
    to_stations: FloatArray
    is_exact: bool
    is_finest: bool


def friction_tables(rod: LoadedRod, at_nodes: SectionEnergy | None) -> FrictionTables:
    """Collect the `FrictionTables` of a ``rod`` whose tendons have friction.

    ``at_nodes`` are the cross sections at the nodes for the closed form, None for exact sections.
    """
    own, energy = rod.equilibrium.collocation, rod.equilibrium.energy
    friction, rule = rod.equilibrium.friction, own.rule
    assert friction is not None
    paths, stiffness = np.zeros((4, 0, 0)), np.zeros((3, 0))
    if at_nodes is not None:
        found = section_tables(at_nodes)
        paths = np.stack([found.x, found.y, found.dx, found.dy])
        stiffness = np.stack([found.axial, found.squared, found.torsion])
    runs, to_nodes = runs_by_element(rod.nodes.element, rod.nodes.values)
    station_runs, to_stations = runs_by_element(rod.stations.element, rod.stations.values)
    return FrictionTables(
        sections=section_tables(energy),
        transmission=energy.transmission[:, 0],
        reach=np.count_nonzero(energy.transmission[:, 0], axis=1),
        coefficient=friction.coefficient,
        step=own.step,
        lengths=np.repeat(own.step, rule.points.size),
        quadrature=own.weights,
        from_start_columns=rule.from_start.T,
        differentiate_columns=rule.differentiation.T,
        end_columns=rule.interpolate(np.array([0.0, 1.0])).T,
        tail=rule.tail,
        node_paths=paths,
        node_stiffness=stiffness,
        runs=runs,
        to_nodes=to_nodes,
        station_runs=station_runs,
        to_stations=to_stations,
        is_exact=at_nodes is None,
        is_finest=rod.is_finest,
    )


def no_friction() -> FrictionTables:
    """Make empty `FrictionTables`, of the same types for the compiler as `friction_tables`."""
    none, table, sections = np.zeros(0), np.zeros((0, 0)), no_exact().sections
    runs = np.zeros((0, 3), np.int64)
    return FrictionTables(
        sections, table, np.zeros(0, np.int64), none, none, none, none, table, table,
        np.zeros((0, 2)), np.zeros((2, 0)), np.zeros((4, 0, 0)), np.zeros((3, 0)), runs, none,
        runs, none, False, False,
    )  # fmt: skip
