"""Following equilibria from a known one to another condition."""

from __future__ import annotations

import math

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import Response
from octo_arm_model.core.loaded.newton import Newton
from octo_arm_model.core.loaded.sliding.sliding_response import newton_step
from octo_arm_model.core.loaded.stability import stability_of
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.rod.solution import Shape

TOLERANCE = 1e-11
# Residual of intermediate equilibria: about what the few points that most are found at leave.
ON_THE_WAY = 3e-3
_SMALLEST_STEP = 1e-3
# Where the corrections after Newton's first step turn the arm by more than this [rad], they may
# have left its branch of equilibria: a smaller load step follows the branch more closely.
MOST_CORRECTED = 0.25
_USUAL_CORRECTION = 0.1  # correction that load steps are chosen for [rad]
_LONGER = 1.7  # times the step before, at most
_PER_DESCENT = 200
_BEYOND = 0.05  # load step past the end of a branch, from where energy is minimised
_PERTURBATION = 0.02  # of an unstable equilibrium [rad]
# Residual from which on Newton's method may lead to the next equilibrium, stable or not, and what
# part of it a step has to leave at most.
_NEARLY, _QUICK = 1e-7, 0.5
# Damping, in parts of the stiffness of the sections: the first, the least that it is raised to and
# the largest; and by how much it is raised.
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _RAISED = 4.0, 1e-4, 1e9, 4.0


def follow(
    problem: Equilibrium,
    newton: Newton,
    known: Condition,
    shape: Shape,
    wanted: Condition,
    spending: Spending,
    tolerance: float = TOLERANCE,
    step: float = 1.0,
) -> State:
    """Follow the equilibrium from the ``shape`` under ``known`` to the condition ``wanted``.

    The load is changed in one step of continuation where Newton's method then converges, else in
    several, of which the first is the fraction ``step`` of the path. Where the branch ends at a
    limit point, or becomes unstable (the arm buckles), the potential energy is minimised from
    there on.

    Returns:
        A stable state under ``wanted`` whose residual is at most ``tolerance``.

    Raises:
        ConvergenceError: if no equilibrium was found; it carries the last iterate.
        ContinuationError: if it would take more than the budget of ``spending``.
    """
    done = 0.0
    last: tuple[Shape, float] | None = None
    sign = 1
    while True:
        target = min(1.0, done + step)
        condition = wanted if target == 1.0 else known.towards(wanted, target)
        limit = tolerance if target == 1.0 else ON_THE_WAY
        guess = shape
        if last is not None:
            before, length = last
            guess = problem.extrapolate(before, shape, (target - done) / length)
        state, used, corrected, system, *_ = newton(condition, guess, limit)
        spending.add(used, done, state.residual, state.shape.twist)
        is_found = False
        if problem.loads.without_tangent:
            # Neither stability nor a direction of descent follows without the tangent.
            is_found = state.residual <= limit and corrected <= MOST_CORRECTED
            if not is_found and step <= _SMALLEST_STEP:
                raise _unbalanced(state, spending.iterations)
        elif state.residual <= limit and (corrected <= MOST_CORRECTED or step <= _SMALLEST_STEP):
            # Where two branches are near, Newton's method may converge to an unstable one.
            stability = stability_of(problem, state, system)
            is_found = bool(stability.is_stable)
            if stability.is_stable is None:
                is_found = stability.sign == sign or step <= _SMALLEST_STEP
                sign = stability.sign if is_found else sign
        if is_found:
            last = shape, target - done
            step = last[1] * (_growth(corrected) if used <= 5 else 1.0)
        elif step <= _SMALLEST_STEP:
            # The branch ends or is unstable. Just past its end the imbalance is small and descent
            # slow, so that it begins a little further on.
            target = min(1.0, done + _BEYOND)
            condition = wanted if target == 1.0 else known.towards(wanted, target)
            state = _levenberg_marquardt(problem, condition, shape, spending, done)
            last, step, is_found = None, _BEYOND, True
        if is_found:
            if target == 1.0:
                return state
            done, shape = target, state.shape
        else:
            # A converged step is shortened by how large its correction was, another by a factor.
            shorter = 0.25 if state.residual > limit else min(_growth(corrected), 0.7)
            step = max(shorter * (target - done), _SMALLEST_STEP)


def _growth(corrected: float) -> float:
    """Factor by which to change the load step after one with the angle ``corrected`` [rad].

    ``corrected`` is by how much the iterations after the first turned the arm. It grows with the
    square of the step, which gives the step whose correction is `_USUAL_CORRECTION`.
    """
    return min(max(math.sqrt(_USUAL_CORRECTION / max(corrected, 1e-9)), 0.1), _LONGER)


def _unbalanced(state: State, iterations: int) -> ConvergenceError:
    return ConvergenceError(
        'the balance under load', state.residual, iterations, state.shape.twist
    )


def _are_near(problem: Equilibrium, before: Shape | None, now: Shape) -> bool:
    """Whether an arm that was perturbed from the shape ``before`` is no farther away ``now``."""
    if before is None:
        return False
    twist = (now.twist - before.twist)[:, np.newaxis]
    change = Response(twist, np.zeros((3, *twist.shape[1:])))
    return float(problem.turn(change)) <= 2.0 * _PERTURBATION


def _levenberg_marquardt(
    problem: Equilibrium, condition: Condition, shape: Shape, spending: Spending, part: float
) -> State:
    """Minimise the potential energy by the method of Levenberg and Marquardt.

    Each step is a Newton step with cross sections that are stiffened by a damping. The damping is
    raised until a step lowers the energy without going far past its minimum along the step.
    ``part`` is the fraction of the path followed so far, for the error.

    Returns:
        A stable state whose residual is at most `TOLERANCE`.

    Raises:
        ConvergenceError: if none is found.
        ContinuationError: if it would take more than the budget of ``spending``.
    """
    state = problem.state(condition, shape)
    damping = _FIRST_DAMPING
    unstable: Shape | None = None
    for _ in range(_PER_DESCENT):
        spending.add(1, part, state.residual, state.shape.twist)
        if state.residual <= TOLERANCE:
            mode = stability_of(problem, state).softest_mode
            if mode is None or _are_near(problem, unstable, state.shape):
                # Where it stays when it is perturbed the energy is level in that direction, as of
                # an upright arm that may fall to any side.
                return state
            # Unstable equilibrium: perturb along the softest mode, downhill if it is inclined.
            unstable = state.shape
            moved = math.copysign(_PERTURBATION, problem.work(state, mode))
            state = problem.state(condition, problem.moved(unstable, mode, moved))
            damping = _FIRST_DAMPING
        if damping > _MOST_DAMPING:
            break
        heavier = max(_RAISED * damping, _LEAST_DAMPING)
        try:
            if state.residual <= _NEARLY:
                step = newton_step(problem, problem.linearised(state), state)
                new = problem.state(condition, problem.moved(state.shape, step))
                if new.residual <= _QUICK * state.residual:
                    state = new
                    continue
            system = problem.linearised(state, damping)
            # Where the second variation is not positive a step leads to a saddle of the energy,
            # on the other side of it perhaps.
            if stability_of(problem, state, system).is_stable is False:
                damping = heavier
                continue
            step = newton_step(problem, system, state)
            new = problem.state(condition, problem.moved(state.shape, step))
        except ConvergenceError:
            damping = heavier
            continue
        down = problem.work(state, step)
        if not down > 0.0:
            damping = heavier
            continue
        left = problem.work(new, step)
        if not left > -0.5 * down:  # nor NaN
            damping = heavier
            continue
        # Where the energy still falls at its end, the step could have been longer.
        damping *= 0.25 if left > 0.25 * down else 0.5
        damping = damping if damping > 0.1 * _LEAST_DAMPING else 0.0
        state = new
    raise _unbalanced(state, _PER_DESCENT)
