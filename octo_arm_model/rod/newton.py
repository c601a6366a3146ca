"""Newton's method with factors that are used again as long as they serve: chord steps.

The steps with the same factors are corrected by what the steps before them left (Broyden's good
update, in the form of Kelley 1995, 7.3), so that a change of a per cent takes four.
"""

from __future__ import annotations

from typing import NamedTuple

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Acting, Problem, State
from octo_arm_model.rod.factors import Linear

MOST = 15  # iterations of one search
# Part of a residual that a step has to leave at most: the first by factors from elsewhere, the
# first by those of the state, which may raise it, and every other.
PREDICTED, FIRST, PROGRESS = 0.3, 3.0, 0.7
# Where a load states no tangent stiffness convergence is linear: iterations and what each leaves.
MOST_LINEAR, LINEAR_PROGRESS = 200, 0.99
# Below this residual a step by factors of the state may raise it again: where the arm is soft it
# turns far, and what is left is of second order.
_SOFT = 1e-4
CHORD = 0.2  # and up to which the same factors are used again
_LEAST_DENOMINATOR = 0.2  # of Broyden's update


class Found(NamedTuple):
    """Where a search for a balance ended.

    Attributes:
        state: the last state.
        factors: that were used last; None where no step was made.
        iterations: number of steps.
        corrected: how far the steps after the first turned the arm [rad].
    """

    state: State
    factors: Linear | None
    iterations: int
    corrected: float


class Chord:
    """Steps with the same factors."""

    def __init__(self, measure: FloatArray) -> None:
        """Of steps (n,) whose squares are summed by ``measure`` (n,)."""
        self._measure = measure
        self._steps: list[FloatArray] = []
        self._duals: list[FloatArray] = []  # whose product with a step is 1

    def corrected(self, step: FloatArray) -> FloatArray:
        """The next ``step`` (n,) by these factors, corrected by what those before it left."""
        for dual, after in zip(self._duals, self._steps[1:]):
            step += float(dual @ step) * after
        if self._duals:
            part = float(self._duals[-1] @ step)
            if 1.0 - part > _LEAST_DENOMINATOR:
                step *= 1.0 / (1.0 - part)
        dual = step * self._measure
        size = float(dual @ step)
        if size > 0.0:
            dual /= size
            self._steps.append(step)
            self._duals.append(dual)
        return step


def settle(
    problem: Problem, acting: Acting, z: FloatArray, tolerance: float,
    factors: Linear | None = None, again: float = CHORD,
) -> Found:  # fmt: skip
    """Search for a balance from the twists ``z`` (N, m), with ``factors`` from nearby if any.

    Factors are used ``again`` as long as they leave at most this part of a residual. The state it
    ends in is a balance if its residual is at most ``tolerance``.
    """
    state, iterations = problem.evaluate(acting, z), 0
    predicted: State | None = None
    chord = None if factors is None else Chord(problem.measure)
    is_near, is_first = False, True
    limit, progress = MOST, PROGRESS
    if problem.others.without_tangent:
        limit, progress, again = MOST_LINEAR, LINEAR_PROGRESS, LINEAR_PROGRESS
    while state.residual > tolerance and iterations < limit:
        try:
            if chord is None or factors is None:
                factors, is_near = problem.linearise(state), True
                chord = Chord(problem.measure)
            step = chord.corrected(factors.solve(-state.imbalance.ravel()))
        except ConvergenceError:
            break
        new = problem.evaluate(acting, state.z + step.reshape(state.z.shape))
        iterations += 1
        most = progress
        if is_first:
            most = FIRST if is_near else PREDICTED
        elif is_near and state.residual <= _SOFT:
            most = FIRST
        if not new.residual <= most * state.residual:  # nor where it is NaN
            if is_near:
                break
            chord = None
            continue
        predicted = new if is_first else predicted
        if new.residual > again * state.residual:
            chord = None
        state, is_first, is_near = new, False, False
    corrected = 0.0 if predicted is None else problem.turn(state.z - predicted.z)
    return Found(state, factors, iterations, corrected)
