"""Newton's method for a loaded rod: what `numba_build` compiles.

As `loaded.newton`, with cross sections as in `section_kernels` and the linearised equilibrium of
`system_kernels`.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import is_definite
from octo_arm_model.core.compiled.response_kernels import respond, tip_wrenches
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.state_kernels import (
    RodState,
    copy_state,
    empty_state,
    find_state,
    find_turn,
)
from octo_arm_model.core.compiled.system_kernels import empty_system, find_system
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.newton import MOST, NEAR, PROGRESS, QUICK, SAME, UPHILL


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
    tip and the ``change`` (4, points, 6) that unit wrenches on it make, see `TipAnswer`.

    Returns:
        Residual, number of iterations, how far all but the first have turned the arm [rad], the
        sign of the determinant of the system, 0 where there is none, and whether the compliance
        is definite.
    """
    s, count = tables.weights.size, state.twist.shape[1]
    system, new = empty_system(tables), empty_state(count)
    side, step = np.empty((4, count, 1)), np.empty((4, count, 1))
    turn = np.empty((3, count, 1))
    residual = find_state(tables, tensions, tip_wrench, factor, state)
    strayed, turned, iterations, is_near, sign = 0.0, 0.0, 0, False, 0
    while residual > tolerance and iterations < MOST:
        if not (sign and is_near):
            sign = find_system(tables, state, system)
            if sign == 0:
                return residual, iterations, strayed, 0, False
            turned = 0.0
        side[:, :, 0] = state.imbalance
        respond(tables, system, side, step, turn)
        iterations += 1
        new.twist[:] = state.twist + step[:, :, 0]
        new.turn[:] = state.turn
        find_turn(tables, new.twist, new.turn)
        found = find_state(tables, tensions, tip_wrench, factor, new)
        if not found <= (PROGRESS if iterations > 1 else UPHILL) * residual:
            return residual, iterations, strayed, 0, False
        is_near = found <= NEAR and found <= QUICK * residual
        residual = found
        copy_state(new, state)
        angle = turn_of(tables, step[:, :, 0])
        turned += angle
        if iterations > 1:
            strayed += angle
    if not residual <= tolerance:
        return residual, iterations, strayed, 0, False
    if sign == 0 or turned > SAME:
        sign = find_system(tables, state, system)
        if sign == 0:
            return residual, iterations, strayed, 0, False
    wrench = tip_wrenches(tables, state)
    respond(tables, system, wrench, change, np.empty((3, count, 6)))
    for row in range(6):
        for column in range(6):
            total = 0.0
            for k in range(4):
                for i in range(count):
                    weight = tables.step[i // s] * tables.weights[i % s]
                    total += weight * wrench[k, i, row] * change[k, i, column]
            compliance[row, column] = total
    return residual, iterations, strayed, sign, is_definite(compliance)
