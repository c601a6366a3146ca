"""Balances of a loaded rod: what `numba_build` compiles.

As `loaded.newton`, with cross sections as in `section_kernels` and the linearised equilibrium of
`system_kernels`, and as `LoadedRod.settle`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.orientation_kernels import (
    DEFECTS,
    MOST_DEFECTS,
    find_rotation,
    find_turn,
    normalise,
    turn_by,
)
from octo_arm_model.core.compiled.loaded.readout_kernels import Readings, read_rod
from octo_arm_model.core.compiled.loaded.resolution_kernels import resolves_twist
from octo_arm_model.core.compiled.loaded.response_kernels import respond, tip_wrenches
from octo_arm_model.core.compiled.loaded.rod_tables import RodTables
from octo_arm_model.core.compiled.loaded.stability_kernels import FIRM, is_minimum
from octo_arm_model.core.compiled.loaded.state_kernels import (
    RodState,
    copy_state,
    empty_state,
    find_state,
)
from octo_arm_model.core.compiled.loaded.step_kernels import find_step
from octo_arm_model.core.compiled.loaded.system_kernels import System, find_system
from octo_arm_model.core.compiled.numerics.dense_kernels import is_definite
from octo_arm_model.core.compiled.section.section_tables import SectionTables
from octo_arm_model.core.hints import ComplexArray, FloatArray
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED
from octo_arm_model.core.loaded.newton import (
    FIRST_PROGRESS,
    MOST,
    NEAR,
    PREDICTED,
    PROGRESS,
    QUICK,
    SAME,
)
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.strain_measures import SHORTEST_FIBRE

# What is wanted: a balance; one that is read out if it is stable and resolved, or whether resolved
# or not; what is given read out.
BALANCE, READINGS, ANY_READINGS, READ_ONLY = 0, 1, 2, 3
# A step with the same system leaves about the same part of residual and turn as the one before; by
# how many times more is allowed for where the residual is not evaluated.
SAFETY = 10.0
# Sum of squares of the defects of orientations before the last sweep, likewise.
FEW_DEFECTS = 1e-12
MOST_EXACT, MOST_REUSED = 5, 3  # see `iterate`


class Outcome(NamedTuple):
    """What became of a search for balance.

    Attributes:
        residual: of the state it ended in, or a bound of it.
        iterations: made.
        corrected: how far all but the first have turned the arm [rad].
        turned: how far it has turned since the state that the system is linearised about [rad].
        sign: of the determinant of the system, 0 where there is no balance.
        is_least: whether it is seen to be one of least energy.
        is_firm: whether it is by a margin, see `stability_kernels.FIRM`.
        is_reused: whether that is by the system known before, which also made all steps.
        is_definite: otherwise, of a balance alone, whether the compliance of the tip is definite.
        is_read: whether it was read out.
    """

    residual: float
    iterations: int
    corrected: float
    turned: float
    sign: int
    is_least: bool
    is_firm: bool
    is_reused: bool
    is_definite: bool
    is_read: bool


def turn_of(quadrature: FloatArray, change: FloatArray) -> float:
    """How far a ``change`` (4, points) turns the arm [rad], by the weights of its integral."""
    total = 0.0
    for i in range(change.shape[1]):
        square = change[0, i] ** 2 + change[1, i] ** 2 + change[2, i] ** 2
        total += quadrature[i] * np.sqrt(square)
    return total


def iterate(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, is_known: bool, known: System, reach: float, is_exact: bool, may_bound: bool,
    residual: float, sign: int, state: RodState, system: System,
) -> tuple[float, int, float, float, int, bool]:  # fmt: skip
    """Newton's method from a ``state`` of this ``residual``, as `loaded.newton`.

    Fills in the state it ends in and, where that is balanced, the ``system`` linearised about
    nearly the same, unless its ``sign`` says that it is that already. If ``is_known``, the
    ``known`` system of a balance nearby makes the first step, as long as that leaves a small part
    of the residual. It makes the next as well where few more will do, if the arm turns by no more
    than ``reach`` [rad], within which the known system is good for what ``system`` is, or if
    ``is_exact``: then ``system`` is that of the balance itself, which its derivatives need. If
    ``may_bound``, the residual after the last step may be a bound by how the steps before have
    converged; then forces and stiffnesses of the ``state`` are those before that step.

    Returns:
        Residual, number of iterations, how far all but the first have turned the arm [rad], how
        far it has turned since the state that the system is linearised about or, for the known
        one, in all [rad], the sign of the determinant of the system, 0 where there is no balance,
        and whether that system is the known one.
    """
    count = state.twist.shape[1]
    new, step, turn = empty_state(count), np.empty((4, count)), np.empty((3, count))
    corrected, turned, iterations, is_first, is_near = 0.0, 0.0, 0, True, False
    angle, convergence, defects = np.inf, np.inf, np.inf
    # Steps that the known system makes after the first: they take less time than another system.
    most = MOST_EXACT if is_exact else MOST_REUSED
    while residual > tolerance and iterations < MOST:
        if is_known:
            find_step(tables.elements, known, state.imbalance, step, turn)
        elif not (sign and is_near):
            sign = find_system(tables.elements, state, system)
            if sign == 0:
                return residual, iterations, corrected, 0.0, 0, False
            turned = 0.0
        if not is_known:
            find_step(tables.elements, system, state.imbalance, step, turn)
        iterations += 1
        before, angle = angle, turn_of(tables.elements.quadrature, step)
        is_told = sign != 0 or (turned + angle <= reach and not is_exact)
        if may_bound and is_near and is_told and defects <= FEW_DEFECTS:
            left = SAFETY * residual * max(convergence, angle / before)
            if left <= tolerance:
                state.twist[:] = state.twist + step
                turn_by(turn, state.turn, state.turn)
                find_rotation(state.turn, state.rotation)
                corrected, turned = corrected + angle, turned + angle
                return left, iterations, corrected, turned, max(sign, 1), sign == 0
        new.twist[:] = state.twist + step
        turn_by(turn, state.turn, new.turn)
        # A step leaves about its square.
        settled = min(max(1e-3 * angle**4, DEFECTS), MOST_DEFECTS)
        defects = find_turn(tables.elements, new.twist, settled, new.turn)
        found = find_state(tables, tensions, tip_wrench, factor, new)
        if found <= tolerance and defects > DEFECTS:
            find_turn(tables.elements, new.twist, DEFECTS, new.turn)
            found = find_state(tables, tensions, tip_wrench, factor, new)
        if is_known:
            if not found <= PREDICTED * residual:
                is_known = False
                continue
            # Steps with the same system leave twice the part that the first does.
            left = (2.0 if is_first else 1.0) * found / residual
            is_wanted = is_exact or turned + angle < reach
            is_known = most > 0 and is_wanted and found * left**most <= tolerance
            most -= 1
        if not found <= (FIRST_PROGRESS if is_first else PROGRESS) * residual:
            return residual, iterations, corrected, 0.0, 0, False
        is_near = found <= NEAR and found <= QUICK * residual
        convergence, residual = found / residual, found
        copy_state(new, state)
        turned += angle
        if not is_first:
            corrected += angle
        is_first = False
    if not residual <= tolerance:
        return residual, iterations, corrected, 0.0, 0, False
    if sign == 0 and reach > 0.0 and turned <= reach and not is_exact:
        return residual, iterations, corrected, turned, 1, True
    if sign == 0 or turned > SAME:
        sign, turned = find_system(tables.elements, state, system), 0.0
    return residual, iterations, corrected, turned, sign, False


def balance(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, has_energy: bool, wanted: int, is_known: bool, known: System, reach: float,
    limit: float, is_exact: bool, orientation: ComplexArray, state: RodState, system: System,
    compliance: FloatArray, change: FloatArray, readings: Readings,
) -> tuple[float, int, float, float, int, bool, bool, bool, bool, bool, float]:  # fmt: skip
    """Find balance from the twist of ``state`` and ``orientation``, and fill in that it ends in.

    ``orientation`` (2, points) is that of `Quaternions`. Where a balance alone is ``wanted`` and
    the state is not seen to be one of least energy, which takes that the loads have an energy, the
    ``compliance`` (6, 6) of the tip and the ``change`` (4, points, 6) that unit wrenches on it
    make are filled in, see `TipAnswer`; the ``readings`` as ``wanted``. As to the systems see
    `iterate`; nothing is in ``reach`` of the known one where the residual at first is above the
    ``limit``.

    Returns:
        The fields of `Outcome`, and the residual at first. To make one numba would call Python,
        which takes signals then, and a handler that raises would leave numba with none, which it
        does not look for.
    """
    turn = state.turn
    for i in range(turn.shape[1]):
        a, b = orientation[0, i], orientation[1, i]
        turn[0, i], turn[1, i], turn[2, i], turn[3, i] = a.real, a.imag, b.real, b.imag
    residual = find_state(tables, tensions, tip_wrench, factor, state)
    outcome = search(
        tables, tensions, tip_wrench, factor, tolerance, has_energy, wanted, is_known, known,
        reach if residual <= limit else 0.0, is_exact, residual, 0, state, system, compliance,
        change, readings,
    )  # fmt: skip
    leave(turn, orientation)
    return (
        outcome.residual, outcome.iterations, outcome.corrected, outcome.turned, outcome.sign,
        outcome.is_least, outcome.is_firm, outcome.is_reused, outcome.is_definite, outcome.is_read,
        residual,
    )  # fmt: skip


def leave(turn: FloatArray, orientation: ComplexArray) -> None:
    """Make ``turn`` (4, points) of norm one, and fill in ``orientation`` (2, points) by it."""
    normalise(turn)
    for i in range(turn.shape[1]):
        orientation[0, i] = complex(turn[0, i], turn[1, i])
        orientation[1, i] = complex(turn[2, i], turn[3, i])


def search(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, has_energy: bool, wanted: int, is_known: bool, known: System, reach: float,
    is_exact: bool, residual: float, sign: int, state: RodState, system: System,
    compliance: FloatArray, change: FloatArray, readings: Readings,
) -> Outcome:  # fmt: skip
    """As `balance`, from a ``state``; for its ``residual`` and ``sign`` see `iterate`."""
    elements = tables.elements
    if wanted == READ_ONLY:
        read_rod(tables, tensions, tip_wrench, state, readings)
        return Outcome(residual, 0, 0.0, 0.0, 0, False, False, False, False, True)
    residual, iterations, corrected, turned, sign, is_reused = iterate(
        tables, tensions, tip_wrench, factor, tolerance, is_known, known, reach, is_exact,
        wanted != BALANCE, residual, sign, state, system,
    )  # fmt: skip
    is_firm = is_reused or (has_energy and sign > 0 and is_minimum(system, FIRM))
    is_least = is_firm or (has_energy and sign > 0 and is_minimum(system, 0.0))
    is_read, is_tip_stable = False, False
    # Under moments without an energy the sign is all that is known.
    if (
        sign > 0 and wanted != BALANCE and corrected <= MOST_CORRECTED
        and (is_least or not has_energy)
        and (wanted == ANY_READINGS or resolves_twist(elements.tail, elements.step, state.twist))
        and has_fibres(tables.sections, state.twist)
    ):  # fmt: skip
        read_rod(tables, tensions, tip_wrench, state, readings)
        is_read = readings.twist[3].min() > 0.0
    elif sign and wanted == BALANCE and not is_least:
        find_compliance(tables, state, system, compliance, change)
        is_tip_stable = is_definite(compliance)
    return Outcome(
        residual, iterations, corrected, turned, sign, is_least, is_firm, is_reused, is_tip_stable,
        is_read,
    )  # fmt: skip


def find_compliance(
    tables: RodTables, state: RodState, system: System, compliance: FloatArray, change: FloatArray
) -> None:
    """Fill in the ``compliance`` (6, 6) of the tip and the ``change`` (4, points, 6) for it."""
    count = state.twist.shape[1]
    wrench = tip_wrenches(tables.elements, state)
    respond(tables.elements, system, wrench, change, np.empty((3, count, 6)))
    for row in range(6):
        for column in range(6):
            total = 0.0
            for k in range(4):
                for i in range(count):
                    total += (
                        tables.elements.quadrature[i] * wrench[k, i, row] * change[k, i, column]
                    )
            compliance[row, column] = total


def has_fibres(sections: SectionTables, twist: FloatArray) -> bool:
    """Whether no fibre is compressed to nothing under ``twist`` (4, points)."""
    if sections.widens:
        for i in range(twist.shape[1]):
            stretch = twist[3, i]
            square = (twist[1, i] ** 2 + twist[2, i] ** 2) * sections.squared[i]
            bend = incompressible_widening(stretch)[0] * np.sqrt(square)
            if not stretch - bend > SHORTEST_FIBRE:
                return False
    return True
