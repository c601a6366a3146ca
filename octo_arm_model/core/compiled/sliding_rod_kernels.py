"""Loaded rods whose tendons have friction: what `numba_build` compiles.

Steps of Newton's method at tensions that stay, each followed by those tensions along the tendons
that the new shape leaves. How far a tendon turns depends most on its own tension, which
`friction_kernels.improve` takes into account, so that few steps more are enough.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction_tables import FrictionTables
from octo_arm_model.core.compiled.orientation_kernels import find_turn
from octo_arm_model.core.compiled.response_kernels import respond
from octo_arm_model.core.compiled.rod_kernels import turn_of
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.sliding_kernels import slide_along
from octo_arm_model.core.compiled.state_kernels import (
    RodState,
    copy_state,
    empty_state,
    find_state,
)
from octo_arm_model.core.compiled.system_kernels import empty_system, find_system
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.newton import FIRST_PROGRESS

MOST_STEPS = 30
SETTLED = 1e-9  # change of the angles by which tendons turn, with which tensions stay [rad]
SLOW = 0.2  # part of the residual that a step must leave less than, else the system is found anew
STUCK = 0.9  # likewise, else NumPy solves for shape and tensions at once


def find_sliding_balance(
    tables: RodTables, friction: FrictionTables, tensions: FloatArray, before: FloatArray,
    tip_wrench: FloatArray, factor: float, tolerance: float, state: RodState, slip: FloatArray,
) -> tuple[int, float]:  # fmt: skip
    """Balance the ``state``, of which twist and orientations are given, and its tendons.

    These have ``tensions`` at the base and ``before`` along them, as `find_tensions` takes them;
    they end as the ``transmission`` of both tables, with their ``slip`` (tendons, points).

    Returns:
        How many systems it took, as iterations of Newton's method count; -1 where there is no
        balance; and how far all steps but the first have turned the arm [rad].
    """
    count, corrected, systems = state.twist.shape[1], 0.0, 0
    system, new = empty_system(tables), empty_state(count)
    side, step = np.empty((4, count, 1)), np.empty((4, count, 1))
    turn, angle = np.empty((3, count, 1)), np.zeros(slip.shape)
    held = np.zeros(tensions.size)
    for tendon in range(tensions.size):
        held[tendon] = 1.0 if tensions[tendon] > 0.0 else 0.0
    along = tables.sections.transmission
    changed = slide_along(friction, tensions, before, True, state.twist, angle, slip)
    along[:] = friction.sections.transmission
    residual, is_slow = find_state(tables, held, tip_wrench, factor, state), True
    for number in range(MOST_STEPS):
        if residual <= tolerance and changed <= SETTLED:
            return systems, corrected
        if is_slow:
            systems += 1
            if not find_system(tables, state, system):
                return -1, corrected
        side[:, :, 0] = state.imbalance
        respond(tables, system, side, step, turn)
        new.twist[:] = state.twist + step[:, :, 0]
        new.turn[:] = state.turn
        find_turn(tables, new.twist, new.turn)
        changed = slide_along(friction, tensions, before, False, new.twist, angle, slip)
        along[:] = friction.sections.transmission
        found = find_state(tables, held, tip_wrench, factor, new)
        if not found <= max((STUCK if number else FIRST_PROGRESS) * residual, tolerance):
            return -1, corrected
        is_slow, residual = found > SLOW * residual, found
        copy_state(new, state)
        if number:
            corrected += turn_of(tables, step[:, :, 0])
    return -1, corrected
