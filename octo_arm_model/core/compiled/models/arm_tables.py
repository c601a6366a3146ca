"""Tables of an arm for the kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.picard import COLLOCATION_POINTS
from octo_arm_model.core.models.renda2012 import Integration, Renda2012
from octo_arm_model.core.numerics.vectors import runs_of
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame


def own(value: Any) -> Any:
    """Copy of an array, or of a tuple of arrays, that is writable and C-contiguous.

    Read-only and other arrays have other types, for which numba would compile a kernel again.
    """
    if isinstance(value, np.ndarray):
        return np.array(value, order='C')
    return type(value)(*map(own, value)) if hasattr(value, '_fields') else value


class Weights(NamedTuple):
    """Sparse weights of the tensions in sums at nodes or points.

    Attributes:
        runs: sum, tendon, first node and number of nodes of each run of nonzero weights,
            (runs, 4).
        values: weights of all runs, one after another.
        shape: number of sums and of nodes.
    """

    runs: IntArray
    values: FloatArray
    shape: tuple[int, int]


class IntegrationTables(NamedTuple):
    """`renda2012.Integration`: elements between anchorages, and their collocation points.

    The first two points are the ends of the panel next to the first anchorage, in which p = 0 and
    nothing is integrated.

    Attributes:
        weights: of the tensions in first_n, first_b, second_n and second_b at every point.
        stiffness: torsional and bending stiffness there [N m^2], (2, points).
        jump_weights: of the tensions in the first and second moments at every anchorage, by the
            axis of bending (n, b) and the order of the moment, (2, 2, tendons, sections).
        jump_bending: bending stiffness there [N m^2], (sections,).
        elements: section, whether it begins at its anchorage, and first point, (elements, 3).
        integrate: matrices from slopes to values less the initial one, (elements, each, each).
        runs: element, first node and number of nodes of each run of nodes in one element,
            (runs, 3).
        to_nodes: matrices (each, nodes) from the points of an element to a run, one after another.
    """

    weights: Weights
    stiffness: FloatArray
    jump_weights: FloatArray
    jump_bending: FloatArray
    elements: IntArray
    integrate: FloatArray
    runs: IntArray
    to_nodes: FloatArray


class PapersTables(NamedTuple):
    """An arm for the paper's models.

    Attributes:
        weights: of the tensions in axial, first_n, first_b, second_n and second_b at every node.
        stiffness: axial [N], torsional and bending stiffness [N m^2] there, (3, nodes).
        integration: of the model renda2012; without elements for closed_form.
    """

    weights: Weights
    stiffness: FloatArray
    integration: IntegrationTables


class GridTables(NamedTuple):
    """Grid on which the twist is integrated, and the pose of the base.

    Attributes:
        step: length of each interval [m], (intervals,).
        station_node: node of each station, (stations,).
        base: position of the base [m] and its orientation w, x, y, z, (7,).
    """

    step: FloatArray
    station_node: IntArray
    base: FloatArray


def papers_tables(equations: ClosedForm | Renda2012) -> PapersTables:
    """Tables of ``equations``."""
    return PapersTables(
        weights=packed(equations.weights.matrices),
        stiffness=np.array(equations.stiffness),
        integration=(
            integration_tables(equations.integration)
            if isinstance(equations, Renda2012)
            else no_integration()
        ),
    )


def grid_tables(grid: StationGrid, base: Frame) -> GridTables:
    """Tables of a ``grid`` and the pose ``base``."""
    a, b = (complex(part) for part in base.rotation)
    return GridTables(
        step=grid.step,
        station_node=grid.station_node,
        base=np.array([*base.position, a.real, a.imag, b.real, b.imag]),
    )


def integration_tables(given: Integration) -> IntegrationTables:
    """Tables of the integration ``given``."""
    runs = [
        (number, run.start, run.stop - run.start)
        for number, element in enumerate(given.elements)
        for run, _ in element.to_nodes
    ]
    matrices = [matrix for element in given.elements for _, matrix in element.to_nodes]
    at_anchorages = given.at_anchorages.reshape(len(given.at_anchorages), 2, 2, -1)
    return IntegrationTables(
        weights=packed(given.weights.matrices[1:]),
        stiffness=np.array(given.stiffness[1:]),
        jump_weights=at_anchorages.transpose(2, 1, 0, 3),
        jump_bending=given.bending,
        elements=np.array(
            [(element.section, element.jump, element.points.start) for element in given.elements],
            np.int64,
        ).reshape(-1, 3),
        integrate=np.array([element.integrate for element in given.elements]).reshape(
            -1, COLLOCATION_POINTS, COLLOCATION_POINTS
        ),
        runs=np.array(runs, np.int64).reshape(-1, 3),
        to_nodes=np.concatenate([np.zeros(0), *map(np.ravel, matrices)]),
    )


def no_integration() -> IntegrationTables:
    """Empty tables, for closed_form."""
    return IntegrationTables(
        weights=packed(np.zeros((1, 0, 0))),
        stiffness=np.zeros((2, 0)),
        jump_weights=np.zeros((2, 2, 0, 0)),
        jump_bending=np.zeros(0),
        elements=np.zeros((0, 3), np.int64),
        integrate=np.zeros((0, 0, 0)),
        runs=np.zeros((0, 3), np.int64),
        to_nodes=np.zeros(0),
    )


def no_arm() -> PapersTables:
    """Empty tables of the types of `papers_tables`."""
    return PapersTables(packed(np.zeros((1, 0, 0))), np.zeros((3, 0)), no_integration())


def no_grid() -> GridTables:
    """Empty tables of the types of `grid_tables`."""
    return GridTables(np.zeros(0), np.zeros(0, np.int64), np.zeros(7))


def packed(matrices: FloatArray) -> Weights:
    """`Weights` of ``matrices`` (sums, tendons, nodes)."""
    sums, tendons, nodes = matrices.shape
    runs, values = [np.zeros((0, 4), np.int64)], [np.zeros(0)]
    for number in range(sums):
        for tendon in range(tendons):
            row = matrices[number, tendon]
            for run in runs_of(row != 0.0):
                runs.append(np.array([[number, tendon, run.start, run.stop - run.start]]))
                values.append(row[run])
    return Weights(np.concatenate(runs), np.concatenate(values), (sums, nodes))
