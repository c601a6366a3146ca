"""Newton's method for the balance of a loaded rod in one condition."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import System, TipAnswer
from octo_arm_model.core.loaded.sliding_response import newton_step
from octo_arm_model.core.loaded.state import Condition, Stability, State
from octo_arm_model.core.rod.solution import Shape

MOST = 10  # iterations
PROGRESS = 0.7  # what each iteration must leave less than of the residual
# Where a load states no tangent stiffness convergence is linear: iterations, and progress of each.
_MOST_LINEAR, _LINEAR_PROGRESS = 200, 0.99
FIRST_PROGRESS = 3.0  # likewise the first, which takes up the change of the loads
# A factorised system is used for another step where the one before left this residual and part of
# it, and for judging stability where no more than this has been turned since [rad].
NEAR, QUICK, SAME = 2e-5, 0.02, 0.1


class Iterate(NamedTuple):
    """Result of Newton's method.

    Attributes:
        state: balanced or not.
        iterations: made.
        corrected: how far all of them but the first, which takes up the change of the loads, have
            turned the arm [rad].
        system: the last one solved, how it answers wrenches on the tip, or its stability where
            that is known already, if the state is balanced.
    """

    state: State
    iterations: int
    corrected: float
    system: System | TipAnswer | Stability | None


class Newton(Protocol):
    """From a shape to balance in a condition, for as long as there is progress."""

    def __call__(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""


def newton(problem: Equilibrium, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
    """`Newton` for ``problem``."""
    state = problem.state(condition, shape)
    corrected, turned, is_near = 0.0, 0.0, False
    system: System | None = None
    most, progress = MOST, PROGRESS
    if problem.loads.without_tangent:
        most, progress = _MOST_LINEAR, _LINEAR_PROGRESS
    for iteration in range(most):
        if state.residual <= tolerance:
            return Iterate(state, iteration, corrected, system if turned <= SAME else None)
        if not (system and is_near):
            try:
                system, turned = problem.linearised(state), 0.0
            except ConvergenceError:
                return Iterate(state, iteration, corrected, None)
        try:
            step = newton_step(problem, system, state)
            # Of wild shapes tendons in sheaths have no places.
            new = problem.state(condition, problem.moved(state.shape, step))
        except ConvergenceError:
            return Iterate(state, iteration, corrected, None)
        # Not where NaN.
        if not new.residual <= (progress if iteration else FIRST_PROGRESS) * state.residual:
            return Iterate(state, iteration + 1, corrected, None)
        is_near = new.residual <= NEAR and new.residual <= QUICK * state.residual
        state = new
        turn = problem.turn(step)
        turned += turn
        if iteration:
            corrected += turn
    return Iterate(state, most, corrected, system if turned <= SAME else None)
