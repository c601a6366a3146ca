"""Newton's method, and following equilibria from a known one to another condition.

The steps with the same factors are corrected by what the steps before them left (Broyden's good
update, in the form of Kelley 1995, 7.3), so that a change of a per cent takes four.

Loads change step by step. Every equilibrium on the way is judged by the system at itself. Where a
branch ends or becomes unstable (the arm buckles) the energy is minimised from there, as a real
arm's would be.
"""

import contextlib
import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Spending
from octo_arm_model.rod.equilibrium import Condition, Problem, State
from octo_arm_model.rod.factors import LazyFactors, Linear, Stability, Variation, factorise
from octo_arm_model.rod.loads import OtherLoads

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


class NewtonResult(NamedTuple):
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


def newton(
    equations: Equations,
    state: State,
    tolerance: float,
    factors: Linear | None = None,
    is_near: bool = False,
    rule: Rule = STATICS,
) -> NewtonResult:
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
    return NewtonResult(state, factors, iterations, corrected)


def _rule_of(others: OtherLoads, rule: Rule) -> Rule:
    """The ``rule`` of a search, or what ``others`` take instead of it."""
    if others.without_tangent:
        return WITHOUT_TANGENT
    return TOUCHING if rule is STATICS and others.has_obstacles else rule


# Continuation ------------------------------------------------------------------------------------

TOLERANCE = 1e-11
_TOUCHING = 1e-9  # the same of an arm beside obstacles, as rounding leaves more where they press
ON_THE_WAY = 3e-3  # residual of equilibria on the way
_CLOSER = 1e-7  # the same where these are not stable by a margin
# Where the steps after the first turn the arm by more [rad] they may have left its branch.
MOST_CORRECTED = 0.25
SMALLEST_STEP = 1e-3
# Iterations of a step after which the next may be longer, and factors on a step that was not
# accepted, or not found.
_QUICKLY, _SHORTER, _MUCH_SHORTER = 5, 0.7, 0.25
_USUAL_CORRECTION = 0.1  # correction that load steps are chosen for [rad]
_LONGER = 1.7  # times the step before, at most
_MOST_DESCENT = 300
BEYOND = 0.05  # load step past the end of a branch, from where energy is minimised
_PERTURBATION = 0.02  # of an unstable equilibrium [rad]
_MOST_PERTURBED = 6  # times that a descent leaves unstable equilibria
# Residual from which on Newton's method may lead to the next equilibrium, stable or not, and what
# part of it a step has to leave at most.
_NEARLY, _QUICK = 1e-7, 0.5
# Damping, in parts of the stiffness of the sections.
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _RAISED = 4.0, 1e-4, 1e9, 4.0
_NO_DAMPING = 1e-8
# Where the energy is level, as of an upright arm that may fall to any side, an equilibrium is
# where no more than this residual is left along a mode that is no stiffer than this, in parts of
# the stiffness of the sections, after steps of no more damping than this.
_LEVEL, _NEUTRAL, _LITTLE_DAMPING = 1e-7, 1e-6, 1e-3


class Verdict(NamedTuple):
    """An equilibrium and what the system at itself says of it.

    Attributes:
        state: the equilibrium.
        factors: of the Jacobian there.
        stability: of the equilibrium.
        variation: the second variation of the energy there.
    """

    state: State
    factors: LazyFactors
    stability: Stability
    variation: Variation


def judge(problem: Problem, state: State) -> Verdict:
    """Judge the stability of an equilibrium of ``problem`` by its Jacobian there.

    Where a load states no tangent stiffness nothing tells of it, and it counts as stable; where
    the Jacobian decides and is singular it does not.
    """
    problem.fill_jacobian(state)
    variation = problem.variation()
    is_known = not problem.others.without_tangent
    stability = variation.stability() if is_known else Stability(True, False)
    if not stability.is_stable and not problem.has_energy(state.condition):
        with contextlib.suppress(ConvergenceError):
            stability = Stability(factorise(problem.work.jacobian.copy()).sign > 0, False)
    return Verdict(state, LazyFactors(problem.work.jacobian.copy()), stability, variation)


def tolerance_of(problem: Problem) -> float:
    """The residual that may be left of an equilibrium of ``problem``."""
    return TOLERANCE if problem.contact is None else _TOUCHING


def advance(
    attempt: Callable[[float, float, bool], tuple[NewtonResult, bool, bool]],
    leap: Callable[[float, NewtonResult], tuple[float, float]],
    step: float,
    smallest: float,
) -> None:
    """Go the way from 0 to 1 by steps of which the first is ``step`` and none below ``smallest``.

    ``attempt(done, target, is_smallest)`` follows a branch from one part of the way to the next.
    It returns where Newton's method ended, whether in balance and whether that is accepted. Where
    the branch ends ``leap(done, found)`` goes to another one, and returns where on the way that
    is and the next step.
    """
    done = 0.0
    while done < 1.0:
        target, is_smallest = min(1.0, done + step), step <= smallest
        found, is_met, is_accepted = attempt(done, target, is_smallest)
        # The correction grows with the square of the step.
        factor = math.sqrt(_USUAL_CORRECTION / max(found.corrected, 1e-9))
        factor = min(max(factor, 0.1), _LONGER)
        if is_accepted:
            step = (target - done) * (factor if found.iterations <= _QUICKLY else 1.0)
            done = target
        elif is_smallest:
            done, step = leap(done, found)
        else:
            shorter = min(factor, _SHORTER) if is_met else _MUCH_SHORTER
            step = max(shorter * (target - done), smallest)


def follow(
    problem: Problem,
    known: Condition,
    z: FloatArray,
    wanted: Condition,
    spending: Spending,
    step: float = 1.0,
    roughly: bool = False,
) -> Verdict:
    """Follow the equilibrium of twists ``z`` (N, m) under ``known`` to the condition ``wanted``.

    In one step where Newton's method then converges, else in several, of which the first is the
    fraction ``step`` of the way.

    Returns:
        A stable equilibrium whose residual is at most `tolerance_of`; ``roughly`` one as on the
        way, or, where the branch ends, the last one on it.

    Raises:
        ConvergenceError: if none was found.
        ContinuationError: if it would take more than the budget of ``spending``.
    """
    last: tuple[FloatArray, float] | None = None  # twists before the last step, and its size
    reached: Verdict | None = None

    def attempt(done: float, target: float, is_smallest: bool) -> tuple[NewtonResult, bool, bool]:
        nonlocal z, last, reached
        tolerance = ON_THE_WAY if roughly or target < 1.0 else tolerance_of(problem)
        guess = z if last is None else z + (target - done) / last[1] * (z - last[0])
        begun = problem.evaluate(problem.at_nodes(known.towards(wanted, target)), guess)
        found = newton(problem, begun, tolerance)
        spending.add(found.iterations, done, found.state.residual)
        is_met = found.state.residual <= tolerance and not problem.passes(z, found.state.z)
        is_last = is_smallest and not problem.others.without_tangent
        verdict = None
        if is_met and (found.corrected <= MOST_CORRECTED or is_last):
            verdict = judge_stable(problem, found.state)
            is_firm = not is_last if verdict is None else verdict.stability.is_firm
            if tolerance > _CLOSER and not is_firm:
                # Near the end of a branch what a rough balance leaves decides where the arm goes.
                found, verdict = _closer(problem, found, verdict)
                spending.add(found.iterations, done, found.state.residual)
        if verdict is not None:
            last, z, reached = (z, target - done), verdict.state.z, verdict
        return found, is_met, verdict is not None

    def leap(done: float, found: NewtonResult) -> tuple[float, float]:
        nonlocal z, last, reached
        if problem.others.without_tangent:
            # No direction of descent follows without the tangent.
            raise _unbalanced(found.state, spending.iterations)
        if roughly and reached is not None:
            return 1.0, step
        # The branch ends or is unstable. Just past its end the imbalance is small and descent
        # slow, so that it begins a little further on.
        target = min(1.0, done + BEYOND)
        reached = descend(problem, known.towards(wanted, target), z, spending, done)
        last, z = None, reached.state.z
        return target, BEYOND

    advance(attempt, leap, step, SMALLEST_STEP)
    assert reached is not None
    return reached


def _closer(
    problem: Problem, found: NewtonResult, verdict: Verdict | None
) -> tuple[NewtonResult, Verdict | None]:
    """What is ``found``, settled to `_CLOSER`, and ``verdict`` where it was not seen to be stable.

    None in place of the latter where it is not, or not near what was found.
    """
    rough = found.state
    closer = newton(problem, rough, _CLOSER, found.factors)
    closer = closer._replace(corrected=found.corrected + problem.turn(closer.state.z - rough.z))
    if closer.corrected > MOST_CORRECTED:
        return closer, None
    if verdict is None:
        return closer, judge_stable(problem, closer.state)
    return closer, verdict._replace(state=closer.state)


def judge_stable(problem: Problem, state: State) -> Verdict | None:
    """The equilibrium ``state`` if it is stable."""
    verdict = judge(problem, state)
    return verdict if verdict.stability.is_stable else None


def descend(
    problem: Problem, condition: Condition, z: FloatArray, spending: Spending, part: float
) -> Verdict:
    """Minimise the potential energy from ``z`` by the method of Levenberg and Marquardt.

    Each step is a Newton step with sections that are stiffened by a damping, which is raised until
    a step lowers the energy without going far past its minimum along the step. ``part`` is the
    fraction of the way followed so far, for the error.

    Returns:
        A stable equilibrium whose residual is at most `tolerance_of`, or `_LEVEL`.

    Raises:
        ConvergenceError: if none is found.
        ContinuationError: if it would take more than the budget of ``spending``.
    """
    state = problem.evaluate(problem.at_nodes(condition), z)
    damping, perturbed = _FIRST_DAMPING, 0
    for _ in range(_MOST_DESCENT):
        spending.add(1, part, state.residual)
        if state.residual <= tolerance_of(problem):
            verdict = judge(problem, state)
            if verdict.stability.is_stable:
                return verdict
            perturbed += 1
            if perturbed > _MOST_PERTURBED:
                break
            state, damping = _perturbed(problem, verdict), _FIRST_DAMPING
        if damping > _MOST_DAMPING:
            break
        if state.residual <= _NEARLY:
            new = _newton_step(problem, state)
            if new is not None and new.residual <= _QUICK * state.residual:
                state = new
                continue
            if state.residual <= _LEVEL and damping <= _LITTLE_DAMPING:
                verdict = judge(problem, state)
                if verdict.stability.is_stable and verdict.variation.softest()[0] <= _NEUTRAL:
                    return verdict
        state, damping = _descent_step(problem, state, damping)
    raise _unbalanced(state, spending.iterations)


def _unbalanced(state: State, iterations: int) -> ConvergenceError:
    return ConvergenceError('the balance under load', state.residual, iterations)


def _perturbed(problem: Problem, verdict: Verdict) -> State:
    """An unstable equilibrium moved along its softest mode, downhill if it is inclined."""
    state = verdict.state
    mode = verdict.variation.softest()[1].reshape(state.z.shape)
    mode = mode * (_PERTURBATION / problem.turn(mode))
    if problem.power(state, mode) < 0.0:
        mode = -mode
    return problem.evaluate(state.at_nodes, state.z + mode)


def _newton_step(problem: Problem, state: State) -> State | None:
    """The state after a step of Newton's method; None where there is none, or it leads uphill."""
    try:
        step = problem.linearise(state).solve(-state.imbalance.ravel()).reshape(state.z.shape)
    except ConvergenceError:
        return None
    if not problem.power(state, step) > 0.0 or problem.passes(state.z, state.z + step):
        return None
    return problem.evaluate(state.at_nodes, state.z + step)


def _descent_step(problem: Problem, state: State, damping: float) -> tuple[State, float]:
    """The state after a damped step, and the damping of the next.

    The same state where the step raises the energy, or leads far past its minimum along itself.
    """
    raised = max(_RAISED * damping, _LEAST_DAMPING)
    problem.fill_jacobian(state, damping)
    # Where the second variation is not positive a step leads to a saddle of the energy, on the
    # other side of it perhaps.
    variation = problem.variation()
    try:
        if not variation.is_positive():
            # As much as makes the softest mode as stiff as it is unstable, and no more: where the
            # energy is nearly level the way down is long.
            return state, 2.0 * (damping - variation.softest()[0])
        factors = factorise(problem.work.jacobian.copy())
    except ConvergenceError:
        return state, raised
    step = factors.solve(-state.imbalance.ravel()).reshape(state.z.shape)
    if problem.passes(state.z, state.z + step):
        return state, raised
    new = problem.evaluate(state.at_nodes, state.z + step)
    down = problem.power(state, step)
    left = problem.power(new, step)
    if not (down > 0.0 and np.isfinite(new.residual) and left > -0.5 * down):
        return state, raised
    # Where the energy still falls at its end, the step could have been longer.
    damping *= 0.25 if left > 0.25 * down else 0.5
    return new, damping if damping > _NO_DAMPING else 0.0
