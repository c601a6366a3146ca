"""Kernels for the equilibrium of loaded rods whose tendons have friction.

Each step is a Newton or chord step of the loaded rod at constant tensions along the tendons. After
it the tensions are computed anew from the angles by which tendons turn in the new shape, and the
twist is changed by its derivatives by the tensions at the same point, as without loads.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction.coupling_kernels import follow_tensions, improve
from octo_arm_model.core.compiled.friction.friction_kernels import (
    TurningState,
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
    MOST_DEFECTS,
    find_rotation,
    find_turn,
    normalise,
    turn_by,
)
from octo_arm_model.core.compiled.loaded.readout_kernels import Readings
from octo_arm_model.core.compiled.loaded.rod_kernels import (
    ANY_READINGS,
    BALANCE,
    READINGS,
    combine,
    enter,
    leave,
    search,
    turn_of,
)
from octo_arm_model.core.compiled.loaded.rod_state import (
    RodState,
    RodWork,
    copy_rows,
    copy_state,
    rod_work,
)
from octo_arm_model.core.compiled.loaded.rod_tables import RodTables
from octo_arm_model.core.compiled.loaded.state_kernels import find_state
from octo_arm_model.core.compiled.loaded.step_kernels import find_step
from octo_arm_model.core.compiled.loaded.system_kernels import System, find_system
from octo_arm_model.core.compiled.numerics.products import add_runs
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import ComplexArray, FloatArray, IntArray
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED
from octo_arm_model.core.loaded.newton import FIRST_PROGRESS
from octo_arm_model.core.loaded.sliding.sliding_balance import TOLERANCE
from octo_arm_model.core.loaded.stability import SAME

MOST_STEPS = 30
# Steps after its first within which the known system has to be expected to reach the tolerance.
# Each takes a third of the time of a new system.
MOST_REUSED = 5
# Largest part of the residual that a step may leave for the next to use the same system.
SLOW = 0.2
# Largest part of it that a step may leave at all; otherwise NumPy solves for shape and tensions at
# once.
STUCK = 0.9
# Over the larger part of the residual that one of the last two steps has left, a bound of what
# the next leaves: with tensions computed in turns with the shape, steps converge linearly.
MARGIN = 5.0


def slide_rod(
    tables: RodTables, friction: FrictionTables, tensions: FloatArray, before: FloatArray,
    tip_wrench: FloatArray, factor: float, tolerance: float, has_energy: bool, wanted: int,
    is_known: bool, known: System, reach: float, limit: float, orientation: ComplexArray,
    state: RodState, slip: FloatArray, system: System, compliance: FloatArray, change: FloatArray,
    readings: Readings,
) -> tuple[float, int, float, float, int, bool, bool, bool, bool, bool, float]:  # fmt: skip
    """Find the equilibrium of a loaded rod with friction, test its stability and read it out.

    `find_sliding_balance` finds the equilibrium from the twist of ``state`` and ``orientation``
    (2, points), the complex numbers of `Quaternions`, and both are filled in. Then
    `rod_kernels.search` tests its stability at constant tensions along the tendons and reads it
    out as ``wanted``. The result counts as not read out where `READINGS` are wanted and the
    elements do not resolve the tensions.

    Returns:
        The fields of `Outcome`, with an infinite residual where tensions are not found; and the
        first residual.
    """
    count, pulled = state.twist.shape[1], np.flatnonzero(tensions)
    work = rod_work(tensions, count, tables.elements.step.size, tables.station_node.size)
    turning = state_in(friction, pulled, np.empty((remembered(pulled.size), count)))
    held = np.sign(tensions)
    enter(orientation, state.turn)
    residual, systems, sign, corrected, turned, changed, is_reused, sticks, is_resolved = (
        find_sliding_balance(
            tables, friction, tensions, held, before, tip_wrench, factor, tolerance,
            wanted != BALANCE, is_known, known, reach, limit, state, slip, system, turning, work,
        )
    )  # fmt: skip
    if systems < 0:
        return np.inf, 0, corrected, 0.0, 0, False, False, False, False, False, changed
    normalise(state.turn)
    # The strains have a kink where a tendon begins to stick, which no elements resolve.
    kind = ANY_READINGS if sticks and wanted == READINGS else wanted
    found = search(
        tables, held, tip_wrench, factor, tolerance, has_energy, kind, False, known,
        reach if is_reused else 0.0, False, residual, sign, state, system, compliance, change,
        readings, work,
    )  # fmt: skip
    leave(state.turn, orientation)
    corrected += found.corrected
    is_read = (
        found.is_read and corrected <= MOST_CORRECTED and (kind == ANY_READINGS or is_resolved)
    )
    return (
        found.residual, systems + found.iterations, corrected,
        turned if is_reused or sign else found.turned, found.sign, found.is_least, found.is_firm,
        found.is_reused, found.is_definite, is_read, changed,
    )  # fmt: skip


@borrows
def find_sliding_balance(
    tables: RodTables, friction: FrictionTables, tensions: FloatArray, held: FloatArray,
    before: FloatArray, tip_wrench: FloatArray, factor: float, tolerance: float, may_bound: bool,
    is_known: bool, known: System, reach: float, limit: float, state: RodState, slip: FloatArray,
    system: System, turning: TurningState, work: RodWork,
) -> tuple[float, int, int, float, float, float, bool, bool, bool]:  # fmt: skip
    """Find the equilibrium of a loaded rod and the tensions along its tendons with friction.

    Twist and orientations of ``state`` are given and are the start; all its fields are filled in.
    ``tensions`` (tendons,) are those at the base, ``held`` (tendons,) is one where they are not
    zero, and ``before`` (tendons, points) are those along the tendons before, without size for
    slack tendons. ``turning`` and ``work`` are room, in which no value is kept. The new tensions
    along the tendons [N] are filled in as the ``transmission`` of the sections at the points,
    which both tables share, and at the stations, together with ``slip`` (tendons, points).

    If ``is_known``, the first step is a chord step with the ``known`` system, linearised about an
    equilibrium nearby. That makes all steps if a few will reach the tolerance, the first residual
    is at most ``limit`` and the arm turns by no more than ``reach`` [rad]. Otherwise the second
    step uses a ``system`` linearised anew, which is filled in. Further steps use the same system
    for as long as each reduces the residual enough.

    If ``may_bound``, the residual after the last step may be estimated from those before, see
    `rod_kernels.iterate`.

    Returns:
        The residual; the number of systems used, which counts as that of iterations, -1 where no
        equilibrium was found; the sign of the determinant of ``system``, 0 where it is not
        linearised about nearly the equilibrium; the angle by which all steps but the first have
        turned the arm [rad]; the angle by which it has turned since the state that ``system`` is
        linearised about or, if the known one makes all steps, in all; the first residual; whether
        the known system makes all steps; whether any tendon sticks; and whether the elements
        resolve the tensions.
    """
    corrected, systems, turned, sign, pulled = 0.0, int(is_known), 0.0, 0, turning.pulled
    sections, part, coefficient = friction.sections, friction.transmission, friction.coefficient
    angle, kept, slips, change = turning.angle, turning.kept, turning.slip, turning.change
    reach_of = turning.reach
    # The state after each step takes the place of the one before it; copying takes as long as
    # an evaluation of the loads.
    here, there, is_elsewhere, current = state, work.there, False, known
    step, turn = work.step, work.turn
    along, changed = tables.sections.transmission, np.inf
    near = max(tolerance, TOLERANCE)  # on the way to another equilibrium, tensions may be rough
    along[:] = 0.0
    if turning.offset.size:
        # Places of tendons in compliant sheaths depend on the tensions; those without friction
        # are near enough to begin with.
        kept[:] = 1.0
        set_tensions(tensions, before, pulled, reach_of, part, kept, along, slips, change)
        place_tendons(sections, state.twist, pulled, turning.offset, turning.place)
    find_turnings(turning, state.twist)
    copy_rows(turning.turned, angle)
    set_kept(coefficient, pulled, reach_of, angle, turning.turned, np.inf, kept)
    sticks = set_tensions(tensions, before, pulled, reach_of, part, kept, along, slips, change)
    first = residual = find_state(tables, held, tip_wrench, factor, state, work)
    is_reused = is_known and reach > 0.0 and first <= limit
    row = 0
    for k in range(4):
        copy_rows(state.hessian[k, : k + 1], turning.hessian[row : row + k + 1])
        row += k + 1
    find_responses(turning, state.twist)
    is_slow, uses_known, older, left = not is_known, is_known, np.inf, np.inf
    for number in range(MOST_STEPS):
        if residual <= tolerance and changed <= near:
            if is_elsewhere:
                copy_state(here, state)
            slip[:] = -1.0
            for place in range(pulled.size):
                for i in range(reach_of[place]):
                    slip[pulled[place], i] = slips[place, i]
            interpolate(tables, pulled, along)
            is_fine = resolves_tensions(friction, pulled)
            sign = sign if turned <= SAME else 0
            return residual, systems, sign, corrected, turned, first, is_reused, sticks, is_fine
        if is_slow:
            systems, turned, current = systems + 1, 0.0, system
            older, left, uses_known, is_reused = np.inf, np.inf, False, False
            sign = find_system(tables.elements, here, system)
            if sign == 0:
                break
        find_step(tables.elements, current, here.imbalance, step, turn, work)
        combine(here.twist, 1.0, step, there.twist)
        if turning.offset.size:
            place_tendons(sections, there.twist, pulled, turning.offset, turning.place)
        find_turnings(turning, there.twist)
        changed = improve(
            coefficient, pulled, reach_of, along, turning.quadrature, slips, turning.across,
            turning.by_pull, turning.turned, turning.few, angle,
        )  # fmt: skip
        set_kept(coefficient, pulled, reach_of, angle, turning.turned, changed, kept)
        sticks = set_tensions(tensions, before, pulled, reach_of, part, kept, along, slips, change)
        follow_tensions(reach_of, turning.by_pull, change, there.twist)
        turn_by(turn, here.turn, there.turn)
        combine(there.twist, -1.0, here.twist, step)
        moved = turn_of(tables.elements.quadrature, step)
        turned += moved
        if number:
            corrected += moved
        bound = MARGIN * residual * max(older, left)
        if may_bound and changed <= near and bound <= tolerance:
            find_turn(tables.elements, there.twist, DEFECTS, there.turn, work.rows)
            copy_rows(there.twist, here.twist)
            copy_rows(there.turn, here.turn)
            residual = bound
            find_rotation(here.turn, here.rotation)
            continue
        settled = min(max(1e-3 * moved**4, DEFECTS), MOST_DEFECTS)
        defects = find_turn(tables.elements, there.twist, settled, there.turn, work.rows)
        found = find_state(tables, held, tip_wrench, factor, there, work)
        if found <= tolerance and defects > DEFECTS:
            find_turn(tables.elements, there.twist, DEFECTS, there.turn, work.rows)
            found = find_state(tables, held, tip_wrench, factor, there, work)
        if not found <= max((STUCK if number else FIRST_PROGRESS) * residual, tolerance):
            break
        older, left, residual = left, found / residual, found
        here, there, is_elsewhere = there, here, not is_elsewhere
        if number == 0:
            is_reused = is_reused and found * (2.0 * left) ** MOST_REUSED <= tolerance
        is_reused = is_reused and turned <= reach
        # Where the known system is not reused the stability test needs a new one anyway.
        is_slow = left > SLOW or (uses_known and not is_reused)
    return residual, -1, 0, corrected, 0.0, first, False, False, False


@borrows
def interpolate(tables: RodTables, pulled: IntArray, along: FloatArray) -> None:
    """Fill in the tensions at the stations from those ``along`` (tendons, points) the tendons.

    Only the tendons ``pulled`` have any. They are the ``transmission`` of the sections there.
    """
    at_stations, each = tables.station_sections.transmission, tables.elements.weights.size
    at_stations[:] = 0.0
    for tendon in pulled:
        only = slice(tendon, tendon + 1)
        add_runs(tables.station_runs, tables.at_stations, each, along[only], at_stations[only])
