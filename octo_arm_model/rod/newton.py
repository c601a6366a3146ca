"""Newton's method with factors that are used again as long as they serve: chord steps.

The steps with the same factors are corrected by what the steps before them left (Broyden's good
update, in the form of Kelley 1995, 7.3), so that a change of a per cent takes four.
"""

from __future__ import annotations

import contextlib
from typing import NamedTuple, Protocol

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import State
from octo_arm_model.rod.factors import Linear
from octo_arm_model.rod.other_loads import OtherLoads

# Below this residual a step by factors of the state may raise it again: where the arm is soft it
# turns far, and what is left is of second order.
_SOFT = 1e-4
_LEAST_DENOMINATOR = 0.2  # of Broyden's update


class Rule(NamedTuple):
    """Which steps a search takes; parts are those of a residual that a step leaves at most.

    Attributes:
        iterations: at most.
        again: part up to which the same factors serve for the next step.
        predicted: part that the first step has to leave by factors from elsewhere.
        first: likewise by factors of the state, which may raise it.
        progress: likewise every other step.
        shortest: part of a step by factors of the state, to which it is shortened at least where
            it would raise the residual.
    """

    iterations: int = 15
    again: float = 0.2
    predicted: float = 0.3
    first: float = 3.0
    progress: float = 0.7
    shortest: float = 1.0


STATICS = Rule()
# Where a load states no tangent stiffness convergence is linear.
WITHOUT_TANGENT = Rule(iterations=200, again=0.99, progress=0.99)
# Contacts begin and end along a step, which is shortened where that leaves more.
TOUCHING = Rule(iterations=40, predicted=0.5, first=1.0, progress=1.0, shortest=0.05)


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


class Equations(Protocol):
    """Equations of an arm at its nodes: a `Problem`, or with winches.

    Attributes:
        remembered: how many residuals, than the worst of which a next one has to be less.
    """

    remembered: int

    @property
    def others(self) -> OtherLoads:
        """Loads of other kinds."""

    @property
    def measure(self) -> FloatArray:
        """Factors of the squares of steps, (n,)."""

    def linearise(self, state: State) -> Linear:
        """The equations linearised at ``state``."""

    def step(self, state: State, factors: Linear, /) -> tuple[FloatArray, Linear]:
        """Newton's change of the unknowns, (n,), from ``state``, and the factors it is by."""

    def moved(self, state: State, step: FloatArray, factors: Linear, /) -> State:
        """The ``state`` after a step by ``factors``."""

    def turn(self, change: FloatArray) -> float:
        """How far a ``change`` (N, m) of the twists turns the arm [rad]."""


def settle(
    equations: Equations, state: State, tolerance: float, factors: Linear | None = None,
    is_near: bool = False, rule: Rule = STATICS,
) -> Found:  # fmt: skip
    """Search for a balance from ``state``, with ``factors`` from nearby, or of it, if any.

    The state it ends in is a balance if its residual is at most ``tolerance``.
    """
    iterations, predicted, first, errors = 0, None, state, [state.residual]
    chord = None if factors is None else Chord(equations.measure)
    rule = _rule_of(equations.others, rule)
    while state.residual > tolerance and iterations < rule.iterations:
        new = None
        with contextlib.suppress(SolveError):
            if chord is None or factors is None:
                is_near, chord = True, Chord(equations.measure)
                factors = equations.linearise(state)
            step, factors = equations.step(state, factors)
            step, part = chord.corrected(step), 1.0
            new = equations.moved(state, step, factors)
            iterations += 1
            while is_near and part > rule.shortest and not new.residual < state.residual:
                part *= 0.5
                new = equations.moved(state, part * step, factors)
        most = rule.progress
        if state is first:
            most = rule.first if is_near else rule.predicted
        elif is_near and state.residual <= _SOFT:
            most = rule.first
        most *= max(errors[-equations.remembered :])
        if new is None or not new.residual <= most:  # nor where it is NaN
            if is_near:
                break
            chord = None
            continue
        predicted = new if predicted is None else predicted
        if new.residual > rule.again * state.residual:
            chord = None
        errors.append(new.residual)
        state, is_near = new, False
    corrected = 0.0 if predicted is None else equations.turn(state.z - predicted.z)
    return Found(state, factors, iterations, corrected)


def _rule_of(others: OtherLoads, rule: Rule) -> Rule:
    """The ``rule`` of a search, or what ``others`` take instead of it."""
    if others.without_tangent:
        return WITHOUT_TANGENT
    return TOUCHING if rule is STATICS and others.has_obstacles else rule
