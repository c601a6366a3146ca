"""Tendons with friction, tabulated for the compiled kernels."""

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
    """A rod whose tendons have friction, as `Friction` has it.

    Attributes:
        sections: at the points of all elements; their ``transmission`` is overwritten by the
            tensions at the points, so that a tendon's tension at its base counts as 1.
        transmission: part of its tension that each tendon has at a point without friction,
            (tendons, points).
        reach: how many points each acts at, those up to its anchorage, (tendons,).
        coefficient: mu of every tendon, (tendons,).
        step: lengths of the elements [m], (elements,).
        lengths: of those that the points lie in [m], (points,).
        quadrature: weights of the integral along the arm [m], (points,).
        from_start_columns: columns, as rows, of the integrals within an element from its start.
        differentiate_columns: likewise of the derivatives, for an element of length one.
        end_columns: columns, as rows, to values at both ends of an element, (each, 2).
        tail: from them to the last two Legendre coefficients, (2, each).
        node_paths: x, y, dx and dy as of `SectionTables` at the nodes of the grid, for the closed
            form alone, (4, tendons, nodes).
        node_stiffness: likewise axial, squared and torsion, (3, nodes).
        runs: element, first node and number of nodes of ranges of nodes, (runs, 3).
        to_nodes: matrices (each, nodes) from values at points to these, one after another.
        station_runs: likewise of the stations.
        to_stations: likewise.
        is_exact: whether cross sections have least energy; else they are of the closed form.
        is_finest: as of `LoadedRod`.
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
    """Of a ``rod`` with friction: by the closed form, with its sections ``at_nodes``, or exact."""
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
    """Of no arm."""
    none, table, sections = np.zeros(0), np.zeros((0, 0)), no_exact().sections
    runs = np.zeros((0, 3), np.int64)
    return FrictionTables(
        sections, table, np.zeros(0, np.int64), none, none, none, none, table, table,
        np.zeros((0, 2)), np.zeros((2, 0)), np.zeros((4, 0, 0)), np.zeros((3, 0)), runs, none,
        runs, none, False, False,
    )  # fmt: skip
