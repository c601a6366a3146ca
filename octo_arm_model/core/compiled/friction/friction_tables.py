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
        coefficient: mu of every tendon, (tendons,).
        step: lengths of the elements [m], (elements,).
        lengths: of those that the points lie in [m], (points,).
        quadrature: weights of the integral along the arm [m], (points,).
        from_start_columns: columns, as rows, of the integrals within an element from its start.
        differentiate_columns: likewise of the derivatives, for an element of length one.
        end_columns: columns, as rows, to values at both ends of an element, (each, 2).
        tail: from them to the last two Legendre coefficients, (2, each).
        at_nodes: likewise at the nodes of the grid, for the closed form alone.
        runs: element, first node and number of nodes of ranges of nodes, (runs, 3).
        to_nodes: matrices (each, nodes) from values at points to these, one after another.
        station_runs: likewise of the stations.
        to_stations: likewise.
        is_exact: whether cross sections have least energy; else they are of the closed form.
    """

    sections: SectionTables
    transmission: FloatArray
    coefficient: FloatArray
    step: FloatArray
    lengths: FloatArray
    quadrature: FloatArray
    from_start_columns: FloatArray
    differentiate_columns: FloatArray
    end_columns: FloatArray
    tail: FloatArray
    at_nodes: SectionTables
    runs: IntArray
    to_nodes: FloatArray
    station_runs: IntArray
    to_stations: FloatArray
    is_exact: bool


def friction_tables(rod: LoadedRod, at_nodes: SectionEnergy | None) -> FrictionTables:
    """Of a ``rod`` with friction: by the closed form, with its sections ``at_nodes``, or exact."""
    own, energy = rod.equilibrium.collocation, rod.equilibrium.energy
    friction, rule = rod.equilibrium.friction, own.rule
    assert friction is not None
    runs, to_nodes = runs_by_element(rod.nodes.element, rod.nodes.values)
    station_runs, to_stations = runs_by_element(rod.stations.element, rod.stations.values)
    return FrictionTables(
        sections=section_tables(energy),
        transmission=energy.transmission[:, 0],
        coefficient=friction.coefficient,
        step=own.step,
        lengths=np.repeat(own.step, rule.points.size),
        quadrature=own.weights,
        from_start_columns=rule.from_start.T,
        differentiate_columns=rule.differentiation.T,
        end_columns=rule.interpolate(np.array([0.0, 1.0])).T,
        tail=rule.tail,
        at_nodes=no_exact().sections if at_nodes is None else section_tables(at_nodes),
        runs=runs,
        to_nodes=to_nodes,
        station_runs=station_runs,
        to_stations=to_stations,
        is_exact=at_nodes is None,
    )


def no_friction() -> FrictionTables:
    """Of no arm."""
    none, table, sections = np.zeros(0), np.zeros((0, 0)), no_exact().sections
    runs = np.zeros((0, 3), np.int64)
    return FrictionTables(
        sections, table, none, none, none, none, table, table, np.zeros((0, 2)),
        np.zeros((2, 0)), sections, runs, none, runs, none, False,
    )  # fmt: skip
