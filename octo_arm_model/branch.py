"""Following equilibria from a known one to another condition."""

from __future__ import annotations

from octo_arm_model.equilibrium import Condition, Equilibrium, State
from octo_arm_model.errors import ConvergenceError
from octo_arm_model.hints import FloatArray

TOLERANCE = 1e-11
MAX_ITERATIONS = 1000
_PER_STEP = 10  # iterations in one step of the condition
_PROGRESS = 0.7  # what each iteration must leave less than of the residual
_SMALLEST_STEP = 1e-3
_PER_FALL = 200
_BEYOND = 0.05
_HEAVY, _LIGHT, _HEAVIEST = 4.0, 1e-2, 1e9  # damping, in parts of the stiffness of the sections


def follow(
    problem: Equilibrium, known: Condition, twist: FloatArray, wanted: Condition
) -> tuple[State, int]:
    """From the balanced ``twist`` (n, nodes) in ``known`` to balance in ``wanted``.

    In one step where that converges, in as many as it takes where it does not. Where the branch
    ends on the way (the arm buckles) the arm goes where it would fall. Returns the balanced state
    and the number of iterations.

    Raises:
        ConvergenceError: if no balance was found; it carries the last iterate.
    """
    done, step, iterations = 0.0, 1.0, 0
    last: tuple[FloatArray, float] | None = None
    while True:
        target = min(1.0, done + step)
        condition = wanted if target == 1.0 else known.towards(wanted, target)
        guess = twist
        if last is not None:
            guess = twist + (twist - last[0]) * ((target - done) / last[1])
        state, used = _newton(problem, condition, guess)
        iterations += used
        if state.residual <= TOLERANCE:
            last = twist, target - done
            step = last[1] * (2.0 if used <= 5 else 1.0)
        elif step <= _SMALLEST_STEP:
            # The branch goes no further. Just beyond its end hardly anything pushes the arm on,
            # and the fall would take long.
            target = min(1.0, done + _BEYOND)
            condition = wanted if target == 1.0 else known.towards(wanted, target)
            state, used = _fall(problem, condition, twist)
            iterations += used
            last, step = None, _BEYOND
            if not state.residual <= TOLERANCE:
                raise _lost(state, iterations)
        if state.residual <= TOLERANCE:
            if target == 1.0:
                return state, iterations
            done, twist = target, state.twist
        else:
            step = max(0.25 * (target - done), _SMALLEST_STEP)
        if iterations > MAX_ITERATIONS:
            raise _lost(state, iterations)


def _lost(state: State, iterations: int) -> ConvergenceError:
    return ConvergenceError('the balance under load', state.residual, iterations, state.twist)


def _newton(problem: Equilibrium, condition: Condition, twist: FloatArray) -> tuple[State, int]:
    """Newton's method for as long as it makes progress; balanced or not."""
    state = problem.state(condition, twist)
    for iteration in range(_PER_STEP):
        if state.residual <= TOLERANCE:
            return state, iteration
        try:
            step = problem.step(state)
        except ConvergenceError:
            return state, iteration
        new = problem.state(condition, state.twist + step)
        # Not where NaN. The first step may lead uphill: it is the one that follows the condition.
        if not new.residual <= (_PROGRESS if iteration else 3.0) * state.residual:
            return state, iteration + 1
        state = new
    return state, _PER_STEP


def _fall(problem: Equilibrium, condition: Condition, twist: FloatArray) -> tuple[State, int]:
    """Down the slope of the energy to a stable balance; balanced or not.

    Steps as if the cross sections were stiffer, by as much as it takes for a step to lead down
    and not far up again; where it takes nothing they are Newton's (Levenberg and Marquardt).
    """
    state = problem.state(condition, twist)
    damping = _HEAVY
    for iteration in range(_PER_FALL):
        if state.residual <= TOLERANCE:
            return state, iteration
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
    return state, _PER_FALL
