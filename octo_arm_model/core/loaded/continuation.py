"""Following equilibria from a known one to another condition."""

from __future__ import annotations

from octo_arm_model.core.errors import ContinuationError, ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.equilibrium import Condition, Equilibrium, State

TOLERANCE = 1e-11
MAX_ITERATIONS = 1000
_PER_STEP = 10  # iterations in one step of the condition
_PROGRESS = 0.7  # what each iteration must leave less than of the residual
_SMALLEST_STEP = 1e-3
# A branch bends where Newton's method turns the arm further than this from where its first step
# led [rad]: then smaller steps make sure that it is still the same one.
_STRAY = 0.25
_PER_DESCENT = 200
_BEYOND = 0.05  # part of the way by which a fall begins beyond the end of a branch
_NUDGE = 0.02  # turn of the arm that makes it fall off an unstable balance [rad]
_HEAVY, _LIGHT, _HEAVIEST = 4.0, 1e-2, 1e9  # damping, in parts of the stiffness of the sections


def follow(
    problem: Equilibrium, known: Condition, twist: FloatArray, wanted: Condition
) -> tuple[State, int]:
    """From the balanced ``twist`` (n, nodes) in ``known`` to balance in ``wanted``.

    In one step where that converges, in as many as it takes where it does not. Where the branch
    ends on the way, or its balance is no longer stable (the arm buckles), the arm goes where it
    would fall. Returns the balanced, stable state and the number of iterations.

    Raises:
        ConvergenceError: if no balance was found; it carries the last iterate.
        ContinuationError: if it would take more than `MAX_ITERATIONS`.
    """
    done, step, iterations = 0.0, 1.0, 0
    last: tuple[FloatArray, float] | None = None
    sign = 1
    while True:
        target = min(1.0, done + step)
        condition = wanted if target == 1.0 else known.towards(wanted, target)
        guess = twist
        if last is not None:
            guess = twist + (twist - last[0]) * ((target - done) / last[1])
        state, used, strayed = _newton(problem, condition, guess)
        iterations += used
        is_found = False
        if state.residual <= TOLERANCE and (strayed <= _STRAY or step <= _SMALLEST_STEP):
            # Where two branches are near, Newton's method may jump to one on which no arm stays.
            stability = problem.stability(state)
            is_found = bool(stability.is_stable)
            if stability.is_stable is None:
                is_found = stability.sign == sign or step <= _SMALLEST_STEP
                sign = stability.sign if is_found else sign
        if is_found:
            last = twist, target - done
            step = last[1] * (2.0 if used <= 5 else 1.0)
        elif step <= _SMALLEST_STEP:
            # The branch goes no further, or no arm follows it. Just beyond its end hardly anything
            # pushes the arm on, and the fall would take long.
            target = min(1.0, done + _BEYOND)
            condition = wanted if target == 1.0 else known.towards(wanted, target)
            state, used = _levenberg_marquardt(problem, condition, twist)
            iterations += used
            last, step, is_found = None, _BEYOND, True
        if is_found:
            if target == 1.0:
                return state, iterations
            done, twist = target, state.twist
        else:
            step = max(0.25 * (target - done), _SMALLEST_STEP)
        if iterations > MAX_ITERATIONS:
            raise ContinuationError(done, state.residual, iterations, state.twist)


def _unbalanced(state: State, iterations: int) -> ConvergenceError:
    return ConvergenceError('the balance under load', state.residual, iterations, state.twist)


def _newton(
    problem: Equilibrium, condition: Condition, twist: FloatArray
) -> tuple[State, int, float]:
    """Newton's method for as long as it makes progress; balanced or not.

    Returns the state, the number of iterations, and how far all of them but the first, which goes
    along the branch, have turned the arm [rad].
    """
    state = problem.state(condition, twist)
    strayed = 0.0
    for iteration in range(_PER_STEP):
        if state.residual <= TOLERANCE:
            return state, iteration, strayed
        try:
            step = problem.step(state)
        except ConvergenceError:
            return state, iteration, strayed
        new = problem.state(condition, state.twist + step)
        # Not where NaN. The first step may lead uphill: it is the one that follows the condition.
        if not new.residual <= (_PROGRESS if iteration else 3.0) * state.residual:
            return state, iteration + 1, strayed
        state = new
        if iteration:
            strayed += problem.turn(step)
    return state, _PER_STEP, strayed


def _levenberg_marquardt(
    problem: Equilibrium, condition: Condition, twist: FloatArray
) -> tuple[State, int]:
    """Down the slope of the energy to a stable balance (Levenberg and Marquardt).

    Steps as if the cross sections were stiffer, by as much as it takes for a step to lead down
    and not far up again; where it takes nothing they are Newton's.

    Raises:
        ConvergenceError: if there is none.
    """
    state = problem.state(condition, twist)
    damping = _HEAVY
    for iteration in range(_PER_DESCENT):
        if state.residual <= TOLERANCE:
            stability = problem.stability(state)
            if stability.is_stable is not False:
                return state, iteration
            # Unstable equilibrium: perturb along the softest mode, in either direction.
            nudged = state.twist + _NUDGE * stability.softest_mode
            state, damping = problem.state(condition, nudged), _HEAVY
        if damping > _HEAVIEST:
            break
        heavier = max(_HEAVY * damping, _LIGHT)
        try:
            step = problem.step(state, damping)
        except ConvergenceError:
            damping = heavier
            continue
        down = problem.work(state, step)
        if not down > 0.0:
            damping = heavier
            continue
        new = problem.state(condition, state.twist + step)
        left = problem.work(new, step)
        if not left > -0.5 * down:  # nor NaN
            damping = heavier
            continue
        # Still going down at its end, the step could have been longer.
        damping *= 0.25 if left > 0.25 * down else 0.5
        damping = damping if damping > 0.1 * _LIGHT else 0.0
        state = new
    raise _unbalanced(state, _PER_DESCENT)
