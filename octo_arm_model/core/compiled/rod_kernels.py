"""Newton's method for a loaded rod: what `numba_build` compiles.

As `loaded.newton`, with cross sections as in `section_kernels` and the linearised equilibrium of
`system_kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import is_definite
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.section_kernels import evaluate_sections
from octo_arm_model.core.compiled.system_kernels import (
    empty_system,
    find_system,
    respond,
    tip_wrenches,
)
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.newton import MOST, NEAR, PROGRESS, QUICK, SAME, UPHILL

_MOST_SWEEPS = 60
_SETTLED = 1e-26  # sum of squares of what quaternions change by in the last sweep


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


def find_turn(tables: RodTables, twist: FloatArray, turn: FloatArray) -> bool:
    """Fill in orientations ``turn`` (4, points) under ``twist``, as `kinematics.frames`.

    The collocated equations are swept from what is given, which leaves in each sweep but a small
    part of the error: integrals of integrals are small.

    Returns:
        Whether the sweeps converge.
    """
    s = tables.weights.size
    rate, new = np.empty((4, s)), np.empty((4, s))
    start, raw = tables.base.copy(), np.empty((4, s))
    for element in range(tables.step.size):
        first, half = element * s, 0.5 * tables.step[element]
        x, y, z = twist[0, first:], twist[1, first:], twist[2, first:]
        raw[:] = turn[:, first : first + s]
        change = 0.0
        for _ in range(_MOST_SWEEPS):
            a, b, c, d = raw[0], raw[1], raw[2], raw[3]
            for j in range(s):
                t, n, m = half * x[j], half * y[j], half * z[j]
                rate[0, j] = -b[j] * t - c[j] * n - d[j] * m
                rate[1, j] = a[j] * t + c[j] * m - d[j] * n
                rate[2, j] = a[j] * n + d[j] * t - b[j] * m
                rate[3, j] = a[j] * m + b[j] * n - c[j] * t
            change = 0.0
            for k in range(4):
                new[k] = start[k]
                add_products(rate[k], tables.from_start_columns, new[k])
                for i in range(s):
                    change += (new[k, i] - raw[k, i]) ** 2
            raw[:] = new
            if change <= _SETTLED:
                break
        if not change <= _SETTLED:
            return False
        for k in range(4):
            for j in range(s):
                start[k] += tables.weights[j] * rate[k, j]
        for i in range(s):
            square = raw[0, i] ** 2 + raw[1, i] ** 2 + raw[2, i] ** 2 + raw[3, i] ** 2
            over = 1.0 / np.sqrt(square)
            for k in range(4):
                turn[k, first + i] = over * raw[k, i]
    return True


def find_rotation(turn: FloatArray, rotation: FloatArray) -> None:
    """Fill in the matrices (3, 3, points) of orientations."""
    for i in range(turn.shape[1]):
        w, x, y, z = turn[0, i], turn[1, i], turn[2, i], turn[3, i]
        rotation[0, 0, i] = 1.0 - 2.0 * (y * y + z * z)
        rotation[0, 1, i], rotation[1, 0, i] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
        rotation[0, 2, i], rotation[2, 0, i] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
        rotation[1, 1, i] = 1.0 - 2.0 * (x * x + z * z)
        rotation[1, 2, i], rotation[2, 1, i] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
        rotation[2, 2, i] = 1.0 - 2.0 * (x * x + y * y)


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
    carried = np.empty(points)
    beyond = tip_wrench[3:].copy()
    for k in range(3):
        for i in range(count):
            force[k, i] = factor * tables.force[k, i] + tip_wrench[k]
    for element in range(tables.step.size - 1, -1, -1):
        first, h = element * points, tables.step[element]
        for k in range(3):
            n, m = (k + 1) % 3, (k + 2) % 3
            for j in range(points):
                at = first + j
                carried[j] = (
                    h
                    * twist[3, at]
                    * (rotation[n, 0, at] * force[m, at] - rotation[m, 0, at] * force[n, at])
                )
            out = moment[k, first : first + points]
            for i in range(points):
                out[i] = beyond[k] + factor * tables.moment[k, first + i]
            add_products(carried, tables.to_end_columns, out)
            for j in range(points):
                beyond[k] += tables.weights[j] * carried[j]
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


def turn_of(tables: RodTables, change: FloatArray) -> float:
    """How far a ``change`` (4, points) turns the arm [rad]."""
    points, total = tables.weights.size, 0.0
    for i in range(change.shape[1]):
        square = change[0, i] ** 2 + change[1, i] ** 2 + change[2, i] ** 2
        total += tables.step[i // points] * tables.weights[i % points] * np.sqrt(square)
    return total


def newton(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, state: RodState, compliance: FloatArray, change: FloatArray,
) -> tuple[float, int, float, int, bool]:  # fmt: skip
    """Newton's method from the twist and orientations of ``state``, as `loaded.newton`.

    Fills in the state it ends in and, where that is balanced, the ``compliance`` (6, 6) of the
    tip and the ``change`` (6, 4, points) that unit wrenches on it make, see `TipAnswer`.

    Returns:
        Residual, number of iterations, how far all but the first have turned the arm [rad], the
        sign of the determinant of the system, 0 where there is none, and whether the compliance
        is definite.
    """
    s, count = tables.weights.size, state.twist.shape[1]
    system, new = empty_system(tables), empty_state(count)
    side, step = np.empty((1, 4, count)), np.empty((1, 4, count))
    residual = find_state(tables, tensions, tip_wrench, factor, state)
    strayed, turned, iterations, is_near, sign = 0.0, 0.0, 0, False, 0
    while residual > tolerance and iterations < MOST:
        if not (sign and is_near):
            sign = find_system(
                tables, state.twist, state.rotation, state.force, state.moment, state.hessian,
                system,
            )  # fmt: skip
            if sign == 0:
                return residual, iterations, strayed, 0, False
            turned = 0.0
        side[0] = state.imbalance
        respond(tables, state.rotation, system, side, step)
        iterations += 1
        new.twist[:] = state.twist + step[0]
        new.turn[:] = state.turn
        found = np.nan
        if find_turn(tables, new.twist, new.turn):
            found = find_state(tables, tensions, tip_wrench, factor, new)
        if not found <= (PROGRESS if iterations > 1 else UPHILL) * residual:
            return residual, iterations, strayed, 0, False
        is_near = found <= NEAR and found <= QUICK * residual
        residual = found
        copy_state(new, state)
        turn = turn_of(tables, step[0])
        turned += turn
        if iterations > 1:
            strayed += turn
    if not residual <= tolerance:
        return residual, iterations, strayed, 0, False
    if sign == 0 or turned > SAME:
        sign = find_system(
            tables, state.twist, state.rotation, state.force, state.moment, state.hessian, system
        )
        if sign == 0:
            return residual, iterations, strayed, 0, False
    wrench = tip_wrenches(tables, state.twist, state.rotation)
    respond(tables, state.rotation, system, wrench, change)
    for row in range(6):
        for column in range(6):
            total = 0.0
            for k in range(4):
                for i in range(count):
                    weight = tables.step[i // s] * tables.weights[i % s]
                    total += weight * wrench[row, k, i] * change[column, k, i]
            compliance[row, column] = total
    return residual, iterations, strayed, sign, is_definite(compliance)
