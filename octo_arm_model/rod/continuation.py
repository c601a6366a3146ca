"""Newton's method, and continuation of equilibria from a known condition to another one.

Steps with the same factors are corrected by Broyden's good update, in the form of Kelley 1995,
7.3, so that a change of the loads by a per cent takes four steps.

Loads change step by step, and the stability of every equilibrium on the way is tested by its own
Jacobian. Where a branch ends or becomes unstable (the arm buckles) the energy is minimised from
there, as a real arm does.
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

# Below this residual a step by factors of the state may raise the residual: a soft arm turns far,
# which leaves a residual of second order.
_NEARLY_BALANCED = 1e-4
_LEAST_DENOMINATOR = 0.2  # in Broyden's update


class Rule(NamedTuple):
    """The rules for the steps of a search; ratios are of a residual after to before a step."""

    iterations: int = 15  #: largest number of steps
    again: float = 0.2  #: ratio up to which the next step takes the same factors
    #: largest ratio of the first step if its factors are those of another state
    predicted: float = 0.3
    first: float = 3.0  #: largest ratio of the first step by factors of its state
    progress: float = 0.7  #: largest ratio of every other step
    #: least fraction of a step by factors of its state to which the step is shortened while it
    #: raises the residual
    shortest: float = 1.0


STATICS = Rule()
# If a load states no tangent stiffness, convergence is linear.
WITHOUT_TANGENT = Rule(iterations=200, again=0.99, progress=0.99)
# Contacts begin and end along a step, which is shortened if that raises the residual.
TOUCHING = Rule(iterations=40, predicted=0.5, first=1.0, progress=1.0, shortest=0.05)


class NewtonResult(NamedTuple):
    """The end of a search for a balance."""

    state: State  #: the last state
    factors: Linear | None  #: the factors that were used last; None if there was no step
    iterations: int  #: number of steps
    corrected: float  #: rotation of the arm by the steps after the first [rad]


class Chord:
    """Broyden's update of steps with the same factors."""

    def __init__(self, measure: FloatArray) -> None:
        """Begin without steps; ``measure`` (n,) weights the squares of a step in its norm."""
        self._measure = measure
        self._steps: list[FloatArray] = []
        self._duals: list[FloatArray] = []  # whose product with a step is 1

    def corrected(self, step: FloatArray) -> FloatArray:
        """Return the next ``step`` (n,) by these factors, corrected by the steps before it."""
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
    """The equations of an arm at its nodes: a `Problem`, or one with winches."""

    remembered: int  #: number of last residuals; the next one has to be less than their largest

    @property
    def others(self) -> OtherLoads:
        """Loads that are not dead ones."""

    @property
    def measure(self) -> FloatArray:
        """Weights of the squares of a step in its norm, (n,)."""

    def linearise(self, state: State) -> Linear:
        """Return the equations linearised at ``state``."""

    def step(self, state: State, factors: Linear, /) -> tuple[FloatArray, Linear]:
        """Return Newton's change of the unknowns from ``state``, (n,), and its factors."""

    def moved(self, state: State, step: FloatArray, factors: Linear, /) -> State:
        """Return the ``state`` after a ``step`` (n,) by ``factors``."""

    def turn(self, change: FloatArray) -> float:
        """Return the rotation of the arm by a ``change`` (N, m) of the twists [rad]."""


def newton(
    equations: Equations,
    state: State,
    tolerance: float,
    factors: Linear | None = None,
    is_near: bool = False,
    rule: Rule = STATICS,
) -> NewtonResult:
    """Search for a balance from ``state`` by Newton's method.

    The first steps take ``factors``, if given: those of a state nearby, or of ``state`` itself if
    ``is_near``. The last state is a balance if its residual is at most ``tolerance``.
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
            step, fraction = chord.corrected(step), 1.0
            new = equations.moved(state, step, factors)
            iterations += 1
            while is_near and fraction > rule.shortest and not new.residual < state.residual:
                fraction *= 0.5
                new = equations.moved(state, fraction * step, factors)
        allowed = rule.progress
        if state is first:
            allowed = rule.first if is_near else rule.predicted
        elif is_near and state.residual <= _NEARLY_BALANCED:
            allowed = rule.first
        allowed *= max(errors[-equations.remembered :])
        if new is None or not new.residual <= allowed:  # nor where it is NaN
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


def _rule_of(others: OtherLoads, default: Rule) -> Rule:
    """Return the ``default`` rule, or the one that ``others``, the loads, require instead."""
    if others.without_tangent:
        return WITHOUT_TANGENT
    return TOUCHING if default is STATICS and others.has_obstacles else default


# Continuation ------------------------------------------------------------------------------------

TOLERANCE = 1e-11
_TOUCHING = 1e-9  # tolerance of an arm beside obstacles, whose pressure adds rounding errors
ON_THE_WAY = 3e-3  # residual of equilibria on the way
_CLOSER = 1e-7  # residual of those on the way that are not stable by a margin
# If the steps after the first turn the arm by more [rad], it may have left its branch.
MOST_CORRECTED = 0.25
SMALLEST_STEP = 1e-3
# Iterations of a step up to which the next step may be longer; factors on a step that ended in a
# balance which was not accepted, and on one that ended in none.
_FEW_ITERATIONS, _SHORTER, _MUCH_SHORTER = 5, 0.7, 0.25
_USUAL_CORRECTION = 0.1  # correction that load steps are chosen for [rad]
_LONGER = 1.7  # largest ratio of a step to the one before
_MOST_DESCENT = 300
BEYOND = 0.05  # load step past the end of a branch, from where energy is minimised
_PERTURBATION = 0.02  # rotation of the perturbation of an unstable equilibrium [rad]
_MOST_PERTURBED = 6  # unstable equilibria that a descent may leave
# Residual below which Newton's method may find the next equilibrium, stable or not, and the
# largest part of it that a step may leave.
_NEAR_BALANCE, _PROGRESS = 1e-7, 0.5
# Damping, relative to the stiffness of the sections.
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _RAISED = 4.0, 1e-4, 1e9, 4.0
_NO_DAMPING = 1e-8
# Where the energy is level, as for an upright arm that may fall to any side, a state counts as an
# equilibrium if its residual, the stiffness of its softest mode relative to the sections, and the
# damping of the last step are at most these.
_LEVEL, _NEUTRAL, _LITTLE_DAMPING = 1e-7, 1e-6, 1e-3


class Verdict(NamedTuple):
    """The stability of an equilibrium by its own Jacobian."""

    state: State
    factors: LazyFactors  #: factors of the Jacobian
    stability: Stability  #: whether the equilibrium is stable
    variation: Variation  #: the second variation of the energy


def judge(problem: Problem, state: State) -> Verdict:
    """Test the stability of an equilibrium of ``problem`` by its own Jacobian.

    If a load states no tangent stiffness, the test is impossible and the equilibrium counts as
    stable. If the determinant decides and the Jacobian is singular, it counts as unstable.
    """
    problem.fill_jacobian(state)
    variation = problem.variation()
    has_tangent = not problem.others.without_tangent
    stability = variation.stability() if has_tangent else Stability(True, False)
    if not stability.is_stable and not problem.has_energy(state.condition):
        with contextlib.suppress(ConvergenceError):
            stability = Stability(factorise(problem.work.jacobian.copy()).sign > 0, False)
    factors = LazyFactors(problem.work.jacobian.copy(), state.z)
    return Verdict(state, factors, stability, variation)


def tolerance_of(problem: Problem) -> float:
    """Return the largest residual of an equilibrium of ``problem``."""
    return TOLERANCE if problem.contact is None else _TOUCHING


def advance(
    attempt: Callable[[float, float, bool], tuple[NewtonResult, bool, bool]],
    leap: Callable[[float, NewtonResult], tuple[float, float]],
    step: float,
    smallest: float,
) -> None:
    """Follow a branch from 0 to 1 by steps: ``step`` is the first, ``smallest`` the least one.

    ``attempt(done, end, is_smallest)`` follows it from one fraction of the way to the next, and
    returns the result of Newton's method, whether it is in balance, and whether it is accepted.
    Where the branch ends, ``leap(done, result)`` changes to another branch, and returns the
    fraction of the way that this begins at and the next step.
    """
    done = 0.0
    while done < 1.0:
        end, is_smallest = min(1.0, done + step), step <= smallest
        result, is_balanced, is_accepted = attempt(done, end, is_smallest)
        # The correction grows with the square of the step.
        factor = math.sqrt(_USUAL_CORRECTION / max(result.corrected, 1e-9))
        factor = min(max(factor, 0.1), _LONGER)
        if is_accepted:
            step = (end - done) * (factor if result.iterations <= _FEW_ITERATIONS else 1.0)
            done = end
        elif is_smallest:
            done, step = leap(done, result)
        else:
            shorter = min(factor, _SHORTER) if is_balanced else _MUCH_SHORTER
            step = max(shorter * (end - done), smallest)


def follow(
    problem: Problem,
    initial: Condition,
    z: FloatArray,
    target: Condition,
    spending: Spending,
    step: float = 1.0,
    is_rough: bool = False,
) -> Verdict:
    """Follow the equilibrium of twists ``z`` (N, m) from the condition ``initial`` to ``target``.

    The first step is the fraction ``step`` of the way.

    Returns:
        A stable equilibrium whose residual is at most `tolerance_of`. If ``is_rough``, one with
        the residual of those on the way, or the last one on a branch that ends.

    Raises:
        ConvergenceError: if there is no equilibrium to be found.
        ContinuationError: if the search would take more than the budget of ``spending``.
    """
    previous: tuple[FloatArray, float] | None = None  # twists before the last step, and its size
    reached: Verdict | None = None

    def attempt(done: float, end: float, is_smallest: bool) -> tuple[NewtonResult, bool, bool]:
        nonlocal z, previous, reached
        tolerance = ON_THE_WAY if is_rough or end < 1.0 else tolerance_of(problem)
        guess = z if previous is None else z + (end - done) / previous[1] * (z - previous[0])
        guess_state = problem.evaluate(problem.at_nodes(initial.towards(target, end)), guess)
        result = newton(problem, guess_state, tolerance)
        spending.add(result.iterations, done, result.state.residual)
        is_balanced = result.state.residual <= tolerance and not problem.passes(z, result.state.z)
        is_last = is_smallest and not problem.others.without_tangent
        verdict = None
        if is_balanced and (result.corrected <= MOST_CORRECTED or is_last):
            verdict = judge_stable(problem, result.state)
            is_firm = not is_last if verdict is None else verdict.stability.is_firm
            if tolerance > _CLOSER and not is_firm:
                # Near the end of a branch the residual of a rough balance decides the direction.
                result, verdict = _closer(problem, result, verdict)
                spending.add(result.iterations, done, result.state.residual)
        if verdict is not None:
            previous, z, reached = (z, end - done), verdict.state.z, verdict
        return result, is_balanced, verdict is not None

    def leap(done: float, result: NewtonResult) -> tuple[float, float]:
        nonlocal z, previous, reached
        if problem.others.without_tangent:
            # Without the tangent stiffness there is no direction of descent.
            raise _unbalanced(result.state, spending.iterations)
        if is_rough and reached is not None:
            return 1.0, step
        # The branch ends or is unstable. Just past its end the imbalance is small and a descent
        # slow, so the descent begins a little further on.
        end = min(1.0, done + BEYOND)
        reached = descend(problem, initial.towards(target, end), z, spending, done)
        previous, z = None, reached.state.z
        return end, BEYOND

    advance(attempt, leap, step, SMALLEST_STEP)
    assert reached is not None
    return reached


def _closer(
    problem: Problem, result: NewtonResult, verdict: Verdict | None
) -> tuple[NewtonResult, Verdict | None]:
    """Reduce the residual of ``result`` to `_CLOSER`, and test its stability if not known.

    The second value is the verdict; None if the equilibrium is unstable, or moved too far.
    """
    state = result.state
    closer = newton(problem, state, _CLOSER, result.factors)
    closer = closer._replace(corrected=result.corrected + problem.turn(closer.state.z - state.z))
    if closer.corrected > MOST_CORRECTED:
        return closer, None
    if verdict is None:
        return closer, judge_stable(problem, closer.state)
    return closer, verdict._replace(state=closer.state)


def judge_stable(problem: Problem, state: State) -> Verdict | None:
    """Return the verdict of the equilibrium ``state`` if it is stable, else None."""
    verdict = judge(problem, state)
    return verdict if verdict.stability.is_stable else None


def descend(
    problem: Problem, condition: Condition, z: FloatArray, spending: Spending, part: float
) -> Verdict:
    """Minimise the potential energy from ``z`` by the method of Levenberg and Marquardt.

    Each step is a Newton step with sections that a damping stiffens. The damping is raised until
    a step lowers the energy without going far past its minimum along the step. ``part`` is the
    fraction of the way followed so far, for the error.

    Returns:
        A stable equilibrium whose residual is at most `tolerance_of`, or `_LEVEL`.

    Raises:
        ConvergenceError: if there is none to be found.
        ContinuationError: if the search would take more than the budget of ``spending``.
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
        if state.residual <= _NEAR_BALANCE:
            new = _newton_step(problem, state)
            if new is not None and new.residual <= _PROGRESS * state.residual:
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
    """Return the state of an unstable equilibrium moved along its softest mode, downhill."""
    state = verdict.state
    mode = verdict.variation.softest()[1].reshape(state.z.shape)
    mode = mode * (_PERTURBATION / problem.turn(mode))
    if problem.power(state, mode) < 0.0:
        mode = -mode
    return problem.evaluate(state.at_nodes, state.z + mode)


def _newton_step(problem: Problem, state: State) -> State | None:
    """Return the state after a Newton step; None if it is impossible or raises the energy."""
    try:
        step = problem.linearise(state).solve(-state.imbalance.ravel()).reshape(state.z.shape)
    except ConvergenceError:
        return None
    if not problem.power(state, step) > 0.0 or problem.passes(state.z, state.z + step):
        return None
    return problem.evaluate(state.at_nodes, state.z + step)


def _descent_step(problem: Problem, state: State, damping: float) -> tuple[State, float]:
    """Return the state after a damped step, and the damping of the next.

    The state is the same if the step raises the energy, or goes far past its minimum.
    """
    raised = max(_RAISED * damping, _LEAST_DAMPING)
    problem.fill_jacobian(state, damping)
    # If the second variation is not positive, a step may lead to a saddle of the energy.
    variation = problem.variation()
    try:
        if not variation.is_positive():
            # This makes the softest mode as stiff as it is unstable. More damping would make the
            # descent slow where the energy is nearly level.
            return state, 2.0 * (damping - variation.softest()[0])
        factors = factorise(problem.work.jacobian.copy())
    except ConvergenceError:
        return state, raised
    step = factors.solve(-state.imbalance.ravel()).reshape(state.z.shape)
    if problem.passes(state.z, state.z + step):
        return state, raised
    new = problem.evaluate(state.at_nodes, state.z + step)
    down = problem.power(state, step)
    remaining = problem.power(new, step)
    if not (down > 0.0 and np.isfinite(new.residual) and remaining > -0.5 * down):
        return state, raised
    # If the energy still falls at the end of the step, it could have been longer.
    damping *= 0.25 if remaining > 0.25 * down else 0.5
    return new, damping if damping > _NO_DAMPING else 0.0
