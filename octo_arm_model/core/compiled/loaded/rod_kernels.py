"""Kernels that find the equilibrium of a loaded rod by Newton's method.

They are the compiled counterpart of `loaded.newton` and of `LoadedRod.settle`. Cross sections are
evaluated by `section_kernels` and the equilibrium is linearised by `system_kernels`.
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
from octo_arm_model.core.compiled.loaded.rod_state import (
    RodState,
    RodWork,
    copy_state,
    rod_work,
)
from octo_arm_model.core.compiled.loaded.rod_tables import RodTables
from octo_arm_model.core.compiled.loaded.stability_kernels import is_minimum
from octo_arm_model.core.compiled.loaded.state_kernels import find_state
from octo_arm_model.core.compiled.loaded.step_kernels import find_step
from octo_arm_model.core.compiled.loaded.system_kernels import System, find_system
from octo_arm_model.core.compiled.numerics.dense_kernels import is_definite
from octo_arm_model.core.compiled.numerics.references import borrows, inlined
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
    SAFETY,
    TINY,
)
from octo_arm_model.core.loaded.stability import FIRM, SAME
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.strain_measures import SHORTEST_FIBRE

# Values of ``wanted``: find an equilibrium only; read it out as well if it is stable and resolved;
# read it out if it is stable, whether resolved or not; read out the given state without a search.
BALANCE, READINGS, ANY_READINGS, READ_ONLY = 0, 1, 2, 3
# Largest sum of squares of the defects of orientations before their last sweep at which the
# residual may be estimated by `SAFETY`.
FEW_DEFECTS = 1e-12
# Most chord steps of the known system after its first step, if ``is_exact`` and if not.
MOST_EXACT, MOST_REUSED = 5, 3


class Outcome(NamedTuple):
    """Result of a search for equilibrium.

    Attributes:
        residual: residual of the last state, or an upper bound of it.
        iterations: number of Newton and chord steps.
        corrected: angle by which all steps but the first have turned the arm [rad].
        turned: angle by which the arm has turned since the state that the system is linearised
            about [rad].
        sign: sign of the determinant of the system, 0 where no equilibrium was found.
        is_least: whether the test of `is_minimum` shows a minimum of the energy.
        is_firm: whether that test holds with the margin `stability.FIRM`.
        is_reused: whether the known system made all steps, so that the stability known of its
            equilibrium is taken over without a test.
        is_definite: whether the compliance of the tip is positive definite; computed only where an
            equilibrium alone is wanted and ``is_least`` is False.
        is_read: whether the state was read out.
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


@borrows
def turn_of(quadrature: FloatArray, change: FloatArray) -> float:
    """Angle by which a ``change`` of twist (4, points) turns the arm [rad].

    It is the integral along the arm of the norm of the angular part; ``quadrature`` (points,) are
    the weights. At least `TINY`: a system is that of the state itself only if no step has been
    made since, whether the arm turns in it or not.
    """
    total = 0.0
    for i in range(change.shape[1]):
        square = change[0, i] ** 2 + change[1, i] ** 2 + change[2, i] ** 2
        total += quadrature[i] * np.sqrt(square)
    return max(total, TINY)


@borrows
def combine(one: FloatArray, factor: float, other: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (n, points), the sum of ``one`` and ``factor`` times ``other``.

    Without the array that an expression allocates.
    """
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[k, i] = one[k, i] + factor * other[k, i]


@borrows
@inlined
def iterate(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, is_known: bool, known: System, reach: float, is_exact: bool, may_bound: bool,
    residual: float, sign: int, state: RodState, system: System, work: RodWork,
) -> tuple[float, int, float, float, int, bool]:  # fmt: skip
    """Iterate from a ``state`` with this ``residual`` to equilibrium by Newton's method.

    The compiled counterpart of `loaded.newton`. Fills in the ``state`` after the last step and,
    where it is an equilibrium, the ``system`` linearised about nearly that state. A ``sign`` other
    than 0 says that ``system`` is already linearised about the given state.

    If ``is_known``, the first step is a chord step with the ``known`` system, linearised about an
    equilibrium nearby. It is discarded unless it leaves a small part of the residual. The known
    system makes more chord steps where a few will reach the tolerance and one of two conditions
    holds. Either the arm turns by no more than ``reach`` [rad] in all: then the known system
    stands in for that of the new equilibrium. Or ``is_exact``: then ``system`` is linearised at
    the equilibrium itself in the end, as its derivatives require.

    If ``may_bound``, the residual after the last step may be estimated from the convergence of
    the steps before instead of evaluated; forces and stiffnesses of ``state`` are then those
    before that step.

    Returns:
        The residual; the number of iterations; the angle by which all steps but the first have
        turned the arm [rad]; the angle by which it has turned since the state that the system is
        linearised about or, if the known system is used, in all [rad]; the sign of the determinant
        of the system, 0 where no equilibrium was found; and whether the known system is used in
        place of ``system``.
    """
    # The state after each step takes the place of the one before it; copying takes as long as
    # an evaluation of the loads.
    here, there, is_elsewhere = state, work.there, False
    step, turn = work.step, work.turn
    corrected, turned, iterations, is_first, is_near = 0.0, 0.0, 0, True, False
    angle, convergence, defects = np.inf, np.inf, np.inf
    is_stuck, is_bounded = False, False
    # Chord steps of the known system after its first take less time than a new factorisation.
    most = MOST_EXACT if is_exact else MOST_REUSED
    while residual > tolerance and iterations < MOST:
        if not (is_known or (sign and is_near)):
            sign = find_system(tables.elements, here, system)
            if sign == 0:
                is_stuck = True
                break
            turned = 0.0
        current = known if is_known else system
        find_step(tables.elements, current, here.imbalance, step, turn, work)
        iterations += 1
        before, angle = angle, turn_of(tables.elements.quadrature, step)
        is_told = sign != 0 or (turned + angle <= reach and not is_exact)
        if may_bound and is_near and is_told and defects <= FEW_DEFECTS:
            left = SAFETY * residual * max(convergence, angle / before)
            if left <= tolerance:
                combine(here.twist, 1.0, step, here.twist)
                turn_by(turn, here.turn, here.turn)
                find_rotation(here.turn, here.rotation)
                corrected, turned = corrected + angle, turned + angle
                residual, is_bounded = left, True
                break
        combine(here.twist, 1.0, step, there.twist)
        turn_by(turn, here.turn, there.turn)
        # A Newton step leaves an error of about its square.
        settled = min(max(1e-3 * angle**4, DEFECTS), MOST_DEFECTS)
        defects = find_turn(tables.elements, there.twist, settled, there.turn, work.rows)
        found = find_state(tables, tensions, tip_wrench, factor, there, work)
        if found <= tolerance and defects > DEFECTS:
            find_turn(tables.elements, there.twist, DEFECTS, there.turn, work.rows)
            found = find_state(tables, tensions, tip_wrench, factor, there, work)
        if is_known:
            if not found <= PREDICTED * residual:
                is_known = False
                continue
            # Later chord steps leave about twice the part of the residual that the first leaves.
            left = (2.0 if is_first else 1.0) * found / residual
            is_wanted = is_exact or turned + angle < reach
            is_known = most > 0 and is_wanted and found * left**most <= tolerance
            most -= 1
        if not found <= (FIRST_PROGRESS if is_first else PROGRESS) * residual:
            is_stuck = True
            break
        is_near = found <= NEAR and found <= QUICK * residual
        convergence, residual = found / residual, found
        here, there, is_elsewhere = there, here, not is_elsewhere
        turned += angle
        if not is_first:
            corrected += angle
        is_first = False
    if is_elsewhere:
        copy_state(here, state)
    if is_stuck or not residual <= tolerance:
        return residual, iterations, corrected, 0.0, 0, False
    if is_bounded:
        return residual, iterations, corrected, turned, max(sign, 1), sign == 0
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
    """Find the equilibrium from the twist of ``state`` and ``orientation``, and fill in both.

    ``orientation`` (2, points) are the complex numbers of `Quaternions`. ``tensions`` (tendons,),
    ``tip_wrench`` (6,) and ``factor``, which multiplies the dead loads, state the loads;
    ``has_energy`` says whether these have a potential. ``wanted`` is one of `BALANCE`, `READINGS`,
    `ANY_READINGS` and `READ_ONLY`; the ``readings`` are filled in accordingly. Where an
    equilibrium alone is wanted and `is_minimum` does not show a minimum of the energy, the
    ``compliance`` (6, 6) of the tip and the ``change`` of the twist (4, points, 6) under unit
    wrenches on the tip are filled in, see `TipAnswer`.

    The ``known`` system makes chord steps and ``system`` is filled in as `iterate` describes;
    ``reach`` counts as zero where the first residual is above ``limit``.

    Returns:
        The fields of `Outcome`, and the first residual. They are a plain tuple, since numba would
        call Python to make an `Outcome`. Python then handles signals, and numba does not check
        whether a signal handler has raised an exception.
    """
    work = rod_work(
        tensions, state.twist.shape[1], tables.elements.step.size, tables.station_node.size
    )
    enter(orientation, state.turn)
    residual = find_state(tables, tensions, tip_wrench, factor, state, work)
    outcome = search(
        tables, tensions, tip_wrench, factor, tolerance, has_energy, wanted, is_known, known,
        reach if residual <= limit else 0.0, is_exact, residual, 0, state, system, compliance,
        change, readings, work,
    )  # fmt: skip
    leave(state.turn, orientation)
    return (
        outcome.residual, outcome.iterations, outcome.corrected, outcome.turned, outcome.sign,
        outcome.is_least, outcome.is_firm, outcome.is_reused, outcome.is_definite, outcome.is_read,
        residual,
    )  # fmt: skip


@borrows
def enter(orientation: ComplexArray, turn: FloatArray) -> None:
    """Fill in the quaternions ``turn`` (4, points) from ``orientation``, see `leave`."""
    for i in range(turn.shape[1]):
        a, b = orientation[0, i], orientation[1, i]
        turn[0, i], turn[1, i], turn[2, i], turn[3, i] = a.real, a.imag, b.real, b.imag


@borrows
def leave(turn: FloatArray, orientation: ComplexArray) -> None:
    """Normalise the quaternions ``turn`` (4, points) and copy them to ``orientation``.

    ``orientation`` (2, points) has the complex numbers of `Quaternions`.
    """
    normalise(turn)
    for i in range(turn.shape[1]):
        orientation[0, i] = complex(turn[0, i], turn[1, i])
        orientation[1, i] = complex(turn[2, i], turn[3, i])


@borrows
@inlined
def search(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, has_energy: bool, wanted: int, is_known: bool, known: System, reach: float,
    is_exact: bool, residual: float, sign: int, state: RodState, system: System,
    compliance: FloatArray, change: FloatArray, readings: Readings, work: RodWork,
) -> Outcome:  # fmt: skip
    """Find the equilibrium from a ``state``, test its stability and read it out as ``wanted``.

    The ``state`` has all its fields; ``residual`` is that of the state. A ``sign`` other than 0 is
    that of the determinant of ``system``, which is then already linearised about the state. The
    other arguments are those of `balance`.
    """
    elements = tables.elements
    if wanted == READ_ONLY:
        read_rod(tables, tensions, tip_wrench, state, readings, work)
        return Outcome(residual, 0, 0.0, 0.0, 0, False, False, False, False, True)
    residual, iterations, corrected, turned, sign, is_reused = iterate(
        tables, tensions, tip_wrench, factor, tolerance, is_known, known, reach, is_exact,
        wanted != BALANCE, residual, sign, state, system, work,
    )  # fmt: skip
    is_firm = is_reused or (has_energy and sign > 0 and is_minimum(system, FIRM))
    is_least = is_firm or (has_energy and sign > 0 and is_minimum(system, 0.0))
    is_read, is_tip_stable = False, False
    # Under moments without an energy only the sign of the determinant is known.
    if (
        sign > 0 and wanted != BALANCE and corrected <= MOST_CORRECTED
        and (is_least or not has_energy)
        and (wanted == ANY_READINGS or resolves_twist(elements.tail, elements.step, state.twist))
        and has_fibres(tables.sections, state.twist)
    ):  # fmt: skip
        read_rod(tables, tensions, tip_wrench, state, readings, work)
        is_read = are_positive(readings.twist[3])
    elif sign and wanted == BALANCE and not is_least:
        find_compliance(tables, state, system, compliance, change)
        is_tip_stable = is_definite(compliance)
    return Outcome(
        residual, iterations, corrected, turned, sign, is_least, is_firm, is_reused, is_tip_stable,
        is_read,
    )  # fmt: skip


@borrows
def are_positive(row: FloatArray) -> bool:
    """Whether all of ``row`` (n,) are above zero; False for NaN."""
    for value in row:
        if not value > 0.0:
            return False
    return True


def find_compliance(
    tables: RodTables, state: RodState, system: System, compliance: FloatArray, change: FloatArray
) -> None:
    """Fill in the ``compliance`` (6, 6) of the tip from the linearised ``system``.

    ``state`` is the equilibrium. Also fills in the ``change`` (4, points, 6) of the twist under
    unit wrenches on the tip, see `tip_wrenches`. The compliance is the work of each such wrench on
    the change that each makes.
    """
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


@borrows
@inlined
def has_fibres(sections: SectionTables, twist: FloatArray) -> bool:
    """Whether all fibres keep more than the length `SHORTEST_FIBRE` under ``twist`` (4, points).

    The length is relative. Always True for sections that do not widen, whose law is linear.
    """
    if sections.widens:
        for i in range(twist.shape[1]):
            stretch = twist[3, i]
            square = (twist[1, i] ** 2 + twist[2, i] ** 2) * sections.squared[i]
            bend = incompressible_widening(stretch)[0] * np.sqrt(square)
            if not stretch - bend > SHORTEST_FIBRE:
                return False
    return True
