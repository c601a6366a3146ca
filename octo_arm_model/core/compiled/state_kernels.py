"""The balance of a loaded rod: what `numba_build` compiles, as `Equilibrium` has it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.orientation_kernels import find_rotation
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.section_kernels import evaluate_sections
from octo_arm_model.core.hints import FloatArray


class RodState(NamedTuple):
    """A loaded rod as `State` has it.

    Attributes:
        twist: (4, points).
        turn: orientation w, x, y, z of the points, (4, points).
        rotation: the same as matrices, (3, 3, points).
        force: of what lies beyond, in base_frame, (3, points) [N].
        moment: likewise [N m].
        imbalance: in the axes of the cross sections, (4, points).
        hessian: of the energy by the twist, (4, 4, points).
    """

    twist: FloatArray
    turn: FloatArray
    rotation: FloatArray
    force: FloatArray
    moment: FloatArray
    imbalance: FloatArray
    hessian: FloatArray


def empty_state(count: int) -> RodState:
    """Room for a state of ``count`` points."""
    return RodState(
        np.empty((4, count)), np.empty((4, count)), np.empty((3, 3, count)),
        np.empty((3, count)), np.empty((3, count)), np.empty((4, count)),
        np.empty((4, 4, count)),
    )  # fmt: skip


def copy_state(state: RodState, out: RodState) -> None:
    """Copy ``state`` to ``out``."""
    out.twist[:], out.turn[:], out.rotation[:] = state.twist, state.turn, state.rotation
    out.force[:], out.moment[:] = state.force, state.moment
    out.imbalance[:], out.hessian[:] = state.imbalance, state.hessian


def add_levers(
    tables: RodTables, state: RodState, element: int, force: FloatArray, moment: FloatArray,
    beyond: FloatArray,
) -> None:  # fmt: skip
    """Add to the ``moment`` (3, points) within an ``element`` that of ``force`` (3, points) there.

    By its levers from each point to the end of the element; to ``beyond`` (3,) the same from its
    start.
    """
    s, h = tables.weights.size, tables.step[element]
    first, rotation, carried = element * s, state.rotation, np.empty(s)
    for k in range(3):
        n, m = (k + 1) % 3, (k + 2) % 3
        for j in range(s):
            at = first + j
            carried[j] = h * state.twist[3, at] * (
                rotation[n, 0, at] * force[m, at] - rotation[m, 0, at] * force[n, at]
            )  # fmt: skip
        add_products(carried, tables.to_end_columns, moment[k, first : first + s])
        for j in range(s):
            beyond[k] += tables.weights[j] * carried[j]


def find_state(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float, state: RodState
) -> float:
    """Fill in what follows from twist and orientations as `Equilibrium.state` does.

    Returns:
        The residual.
    """
    points, count = tables.weights.size, state.twist.shape[1]
    twist, rotation, force, moment = state.twist, state.rotation, state.force, state.moment
    imbalance = state.imbalance
    find_rotation(state.turn, rotation)
    scale, gradient = np.empty((4, count)), np.empty((4, count))
    evaluate_sections(tables.sections, tensions, twist, gradient, state.hessian, scale)
    beyond = tip_wrench[3:].copy()
    for k in range(3):
        for i in range(count):
            force[k, i] = factor * tables.force[k, i] + tip_wrench[k]
    for element in range(tables.step.size - 1, -1, -1):
        for k in range(3):
            for i in range(element * points, element * points + points):
                moment[k, i] = beyond[k] + factor * tables.moment[k, i]
        add_levers(tables, state, element, force, moment, beyond)
    outside = np.zeros(4)
    for i in range(count):
        for k in range(3):
            wrench = 0.0
            for m in range(3):
                wrench += rotation[m, k, i] * moment[m, i]
            imbalance[k, i] = wrench
            outside[k] = max(outside[k], abs(wrench))
        wrench = 0.0
        for m in range(3):
            wrench += rotation[m, 0, i] * force[m, i]
        imbalance[3, i] = wrench
        outside[3] = max(outside[3], abs(wrench))
    residual, total = 0.0, 0.0
    for k in range(4):
        for i in range(count):
            imbalance[k, i] -= gradient[k, i]
            residual = max(residual, abs(imbalance[k, i]) / (scale[k, i] + outside[k]))
            total += imbalance[k, i]
    return residual if np.isfinite(total) else np.nan
