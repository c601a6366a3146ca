"""Kernels for the equilibrium of loaded rods whose tendons have friction.

Each step is a Newton or chord step of the loaded rod at constant tensions along the tendons. After
it the tensions are computed anew from the angles by which tendons turn in the new shape, and the
twist is changed by its derivatives by the tensions at the same point, as without loads.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction.coupling_kernels import follow_tensions, improve
from octo_arm_model.core.compiled.friction.friction_kernels import (
    find_responses,
    find_turnings,
    remembered,
    resolves_tensions,
    state_in,
)
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables
from octo_arm_model.core.compiled.friction.placing_kernels import place_tendons
from octo_arm_model.core.compiled.friction.turning_kernels import set_kept, set_tensions
from octo_arm_model.core.compiled.loaded.orientation_kernels import (
    DEFECTS,
    find_turn,
    normalise,
    turn_by,
)
from octo_arm_model.core.compiled.loaded.readout_kernels import Readings
from octo_arm_model.core.compiled.loaded.rod_kernels import (
    ANY_READINGS,
    READINGS,
    leave,
    search,
    turn_of,
)
from octo_arm_model.core.compiled.loaded.rod_tables import RodTables
from octo_arm_model.core.compiled.loaded.state_kernels import (
    RodState,
    copy_state,
    empty_state,
    find_state,
)
from octo_arm_model.core.compiled.loaded.step_kernels import find_step
from octo_arm_model.core.compiled.loaded.system_kernels import System, find_system
from octo_arm_model.core.compiled.numerics.products import add_runs
from octo_arm_model.core.hints import ComplexArray, FloatArray
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED
from octo_arm_model.core.loaded.newton import FIRST_PROGRESS, SAME
from octo_arm_model.core.loaded.sliding.sliding_balance import TOLERANCE

MOST_STEPS = 30
# Largest part of the residual that a step may leave for the next to use the same system.
SLOW = 0.2
# Largest part of it that a step may leave at all; otherwise NumPy solves for shape and tensions at
# once.
STUCK = 0.9


def slide_rod(
    tables: RodTables, friction: FrictionTables, tensions: FloatArray, before: FloatArray,
    tip_wrench: FloatArray, factor: float, tolerance: float, has_energy: bool, wanted: int,
    is_known: bool, known: System, orientation: ComplexArray, state: RodState, slip: FloatArray,
    system: System, compliance: FloatArray, change: FloatArray, readings: Readings,
) -> tuple[float, int, float, float, int, bool, bool, bool, bool, bool]:  # fmt: skip
    """Find the equilibrium of a loaded rod with friction, test its stability and read it out.

    `find_sliding_balance` finds the equilibrium; `rod_kernels.search` then tests its stability at
    constant tensions along the tendons and reads it out as ``wanted``. Also fills in the
    ``orientation`` (2, points), the complex numbers of `Quaternions`. The result counts as not
    read out where `READINGS` are wanted and the elements do not resolve the tensions.

    Returns:
        The fields of `Outcome`; an infinite residual where tensions are not found.
    """
    residual, systems, sign, corrected, sticks, is_resolved = find_sliding_balance(
        tables, friction, tensions, before, tip_wrench, factor, tolerance, is_known, known, state,
        slip, system,
    )  # fmt: skip
    if systems < 0:
        return np.inf, 0, corrected, 0.0, 0, False, False, False, False, False
    normalise(state.turn)
    # The strains have a kink where a tendon begins to stick, which no elements resolve.
    kind = ANY_READINGS if sticks and wanted == READINGS else wanted
    found = search(
        tables, np.sign(tensions), tip_wrench, factor, tolerance, has_energy, kind, False, known,
        0.0, False, residual, sign, state, system, compliance, change, readings,
    )  # fmt: skip
    leave(state.turn, orientation)
    corrected += found.corrected
    is_read = (
        found.is_read and corrected <= MOST_CORRECTED and (kind == ANY_READINGS or is_resolved)
    )
    # If the system comes from `find_sliding_balance` the angle turned since is not known.
    turned = np.inf if sign else found.turned
    return (
        found.residual, systems + found.iterations, corrected, turned, found.sign, found.is_least,
        found.is_firm, False, found.is_definite, is_read,
    )  # fmt: skip


def find_sliding_balance(
    tables: RodTables, friction: FrictionTables, tensions: FloatArray, before: FloatArray,
    tip_wrench: FloatArray, factor: float, tolerance: float, is_known: bool, known: System,
    state: RodState, slip: FloatArray, system: System,
) -> tuple[float, int, int, float, bool, bool]:  # fmt: skip
    """Find the equilibrium of a loaded rod and the tensions along its tendons with friction.

    Twist and orientations of ``state`` are given and are the start; all its fields are filled in.
    ``tensions`` (tendons,) are those at the base and ``before`` (tendons, points) those along the
    tendons before, without size for slack tendons. The new tensions along the tendons [N] are
    filled in as the ``transmission`` of the sections at the points, which both tables share, and
    at the stations, together with ``slip`` (tendons, points).

    If ``is_known``, the first step is a chord step with the ``known`` system, linearised about an
    equilibrium nearby. The second step uses a ``system`` linearised anew, which is filled in.
    Further steps use the same system for as long as each reduces the residual enough.

    Returns:
        The residual; the number of systems used, which counts as that of iterations, -1 where no
        equilibrium was found; the sign of the determinant of ``system``, 0 where it is not
        linearised about nearly the equilibrium; the angle by which all steps but the first have
        turned the arm [rad]; whether any tendon sticks; and whether the elements resolve the
        tensions.
    """
    count, corrected, systems = state.twist.shape[1], 0.0, int(is_known)
    turned, sign = 0.0, 0
    pulled = np.flatnonzero(tensions)
    memory = np.zeros((remembered(pulled.size), count))
    turning = state_in(friction, pulled, memory)
    sections, part, coefficient = friction.sections, friction.transmission, friction.coefficient
    angle, kept, slips, change = turning.angle, turning.kept, turning.slip, turning.change
    reach = turning.reach
    new, current = empty_state(count), known
    step, turn = np.empty((4, count)), np.empty((3, count))
    held = np.zeros(tensions.size)
    held[pulled] = 1.0
    along, changed = tables.sections.transmission, np.inf
    along[:] = 0.0
    if turning.offset.size:
        # Places of tendons in compliant sheaths depend on the tensions; those without friction
        # are near enough to begin with.
        kept[:] = 1.0
        set_tensions(tensions, before, pulled, reach, part, kept, along, slips, change)
        place_tendons(sections, state.twist, pulled, turning.offset, turning.place)
    find_turnings(turning, state.twist)
    angle[:] = turning.turned
    set_kept(coefficient, pulled, reach, angle, kept)
    sticks = set_tensions(tensions, before, pulled, reach, part, kept, along, slips, change)
    residual = find_state(tables, held, tip_wrench, factor, state)
    row = 0
    for k in range(4):
        for m in range(k + 1):
            turning.hessian[row] = state.hessian[k, m]
            row += 1
    find_responses(turning, state.twist)
    is_slow = not is_known
    for number in range(MOST_STEPS):
        if residual <= tolerance and changed <= TOLERANCE:
            slip[:] = -1.0
            for place in range(pulled.size):
                slip[pulled[place], : reach[place]] = slips[place, : reach[place]]
            at_stations = tables.station_sections.transmission
            at_stations[:] = 0.0
            each = tables.elements.weights.size
            add_runs(tables.station_runs, tables.at_stations, each, along, at_stations)
            is_fine = resolves_tensions(friction, pulled)
            sign = sign if turned <= SAME else 0
            return residual, systems, sign, corrected, sticks, is_fine
        if is_slow:
            systems, turned, current = systems + 1, 0.0, system
            sign = find_system(tables.elements, state, system)
            if sign == 0:
                break
        find_step(tables.elements, current, state.imbalance, step, turn)
        new.twist[:] = state.twist + step
        if turning.offset.size:
            place_tendons(sections, new.twist, pulled, turning.offset, turning.place)
        find_turnings(turning, new.twist)
        changed = improve(
            coefficient, pulled, reach, along, turning.quadrature, slips, turning.across,
            turning.by_pull, turning.turned, turning.few, angle,
        )  # fmt: skip
        set_kept(coefficient, pulled, reach, angle, kept)
        sticks = set_tensions(tensions, before, pulled, reach, part, kept, along, slips, change)
        follow_tensions(reach, turning.by_pull, change, new.twist)
        turn_by(turn, state.turn, new.turn)
        find_turn(tables.elements, new.twist, DEFECTS, new.turn)
        found = find_state(tables, held, tip_wrench, factor, new)
        if not found <= max((STUCK if number else FIRST_PROGRESS) * residual, tolerance):
            break
        # After a chord step of the known system a new one is needed for the stability test anyway.
        is_slow, residual = found > SLOW * residual or (is_known and number == 0), found
        moved = turn_of(tables.elements.quadrature, new.twist - state.twist)
        copy_state(new, state)
        turned += moved
        if number:
            corrected += moved
    return residual, -1, 0, corrected, False, False
