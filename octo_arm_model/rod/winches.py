"""Equilibria of an arm in which winches hold some tendons at a length.

The equations are those of `winch_equations`. They are solved from an equilibrium nearby, in one
step or by continuation. From the unloaded arm, winches reel in before the arm bears its loads.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator

import numpy as np

from octo_arm_model.arm.errors import ContinuationError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Spending
from octo_arm_model.rod.checks import check_solution
from octo_arm_model.rod.continuation import (
    BEYOND,
    MOST_CORRECTED,
    SMALLEST_STEP,
    NewtonResult,
    advance,
    judge,
    newton,
)
from octo_arm_model.rod.equilibrium import Condition, Equilibrium
from octo_arm_model.rod.rod import Rod, moved
from octo_arm_model.rod.winch_equations import BorderedSystem, RodWinchEquations

_TOLERANCE = 1e-10
# Residual that is accepted where rounding and friction allow no less, and that over the allowed
# error with a history of tensions, where those of tendons that stick are uncertain.
_ACCEPTED, _OF_ALLOWED = 1e-8, 0.1
_ON_THE_WAY, _REVERSING = 3e-4, 1e-6  # on the way, without a history of tensions and with one
_FIRST_STEP = 0.3  # first step of continuation
_SMALLEST_LOAD = 0.03  # smallest step of continuation while loads begin to act
_FEW_STEPS = 3  # steps up to which the next search may reuse a linearisation from nearby
_MOST_JUMPS = 4  # changes to another branch, under tensions that are held


class Winches:
    """Equilibria of an arm in which winches hold some tendons at a length."""

    def __init__(
        self, rod: Rod, equations: Callable[[int], RodWinchEquations] | None = None
    ) -> None:
        """Take ``rod``, or another model of its arm by the ``equations`` of each level."""
        self._rod = rod
        self.equations = functools.cache(equations or functools.partial(RodWinchEquations, rod))

    def solve(
        self, target: Condition, start: Equilibrium | None, spending: Spending
    ) -> Equilibrium:
        """Find the equilibrium with the lengths of driven tendons in the condition ``target``.

        The other tendons have its tensions. The search begins at ``start``, or at the unloaded
        arm. Tendons with friction slide from `Condition.before` of any level.

        Raises:
            SolveError: if no tensions that hold these lengths are found.
            ContinuationError: if the search would take more than the budget.
        """
        driven = target.driven
        target = target._replace(
            tensions=np.where(driven, 0.0, target.tensions),
            lengths=np.where(driven, target.lengths, 0.0),
        )
        search = _Search(self._rod, self.equations, target, spending)
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            equilibrium = search.find(self._rod.on_start_level(start, target.before))
            problem = self.equations(equilibrium.level).problem
            check_solution(problem, equilibrium.state, not search.is_free(target))
        return equilibrium

    def displacements(self, equilibrium: Equilibrium) -> FloatArray:
        """Return the lengths reeled in, or that would make slack tendons taut [m], (J,)."""
        return self.equations(equilibrium.level).displacement(equilibrium.state)


class _Search:
    """One search for the tensions that hold a condition."""

    def __init__(
        self,
        rod: Rod,
        equations: Callable[[int], RodWinchEquations],
        target: Condition,
        spending: Spending,
    ) -> None:
        """Begin a search for ``target`` on a ``rod``, with its ``equations`` of each level."""
        self._rod, self._equations = rod, equations
        self._target, self._spending = target, spending

    def is_free(self, condition: Condition) -> bool:
        """Whether only tendons act, so that there is only one equilibrium."""
        if self._rod.has_obstacles:
            return False
        is_loaded = condition.factor > 0.0 and self._rod.is_loaded
        return not (is_loaded or condition.tip_wrench.any())

    def find(self, start: Equilibrium | None) -> Equilibrium:
        """Find the equilibrium from ``start``, or from the unloaded arm."""
        equilibrium = None
        if start is not None:
            with self._ignoring_failure():
                equilibrium = self._search(self._target, start)
        if equilibrium is None:
            equilibrium = self._from_unloaded()
        elif start is not None and equilibrium.firm_state is start.firm_state is not None:
            return equilibrium  # The start was resolved, and this one is close to it.
        return self._resolved(equilibrium)

    @contextlib.contextmanager
    def _ignoring_failure(self) -> Iterator[None]:
        """Return a context that ends where a search fails; ContinuationError passes."""
        try:
            yield
        except ContinuationError:
            raise
        except SolveError:
            pass

    def _try(
        self, target: Condition, last: Equilibrium, tolerance: float, done: float
    ) -> tuple[Equilibrium | None, NewtonResult]:
        """Search near the ``last`` equilibrium, a fraction ``done`` of the way to ``target``."""
        equations, z, factors = self._equations(last.level), last.state.z, last.factors
        system = factors if isinstance(factors, BorderedSystem) else None
        tensions = np.where(target.driven, last.state.condition.tensions, target.tensions)
        target = self._rod.at_level(target, last.level)._replace(tensions=tensions)
        initial = equations.evaluate(target, z)
        is_near = system is not None and system.z is z
        result = newton(equations, initial, tolerance, system, is_near)
        self._spending.add(result.iterations, done, result.state.residual)
        return self._accepted(last, result, tolerance), result

    def _accepted(
        self, last: Equilibrium, result: NewtonResult, tolerance: float
    ) -> Equilibrium | None:
        """Return the ``result`` if it is stable and on the branch of ``last``, else None."""
        state, system, firm = result.state, result.factors, last.firm_state
        condition, equations = state.condition, self._equations(last.level)
        is_free = self.is_free(condition)
        accepted = max(_ACCEPTED, _OF_ALLOWED * self._rod.allowed_error(condition.before))
        if not state.residual <= max(tolerance, accepted):
            return None
        if result.corrected > MOST_CORRECTED and not is_free:
            return None
        if equations.problem.passes(last.state.z, state.z):
            return None
        if firm is None or not self._rod.is_near(equations.problem, firm, state):
            firm = None
        if firm is None and not is_free:
            verdict = judge(equations.problem, state)
            is_stable = verdict.stability.is_stable
            is_reusable = tolerance < _REVERSING and result.iterations <= _FEW_STEPS
            if not (isinstance(system, BorderedSystem) and is_reusable and is_stable):
                system = equations.linearise(state, verdict.factors)
            if not (is_stable or equations.is_held(state, system)):
                return None
            firm = verdict.state if verdict.stability.is_firm else None
        return Equilibrium(state, last.level, system, firm, self._spending.iterations)

    def _search(self, target: Condition, start: Equilibrium) -> Equilibrium:
        """Search from an equilibrium nearby, in one step or by continuation."""
        initial, factors = start, start.factors
        if factors is not None and not isinstance(factors, BorderedSystem):
            system = self._equations(start.level).linearise(start.state, factors)
            initial = start._replace(factors=system)
        equilibrium = self._try(target, initial, self._spending.residual, 0.0)[0]
        return equilibrium or self._by_continuation(target, start)

    def _held_condition(self, start: Equilibrium) -> Condition:
        """Return the condition of ``start`` with the lengths that winches hold there."""
        equations, state = self._equations(start.level), start.state
        equations.problem.load_work(state)
        lengths, driven = equations.displacement(state), self._target.driven
        return state.condition._replace(lengths=lengths, driven=driven)

    def _by_continuation(self, target: Condition, last: Equilibrium) -> Equilibrium:
        """Search by continuation from the equilibrium ``last``, with the same loads or none."""
        initial, jumps = self._held_condition(last), 0
        is_loading = initial.factor < target.factor
        on_the_way = _ON_THE_WAY if target.before is None else _REVERSING

        def attempt(done: float, end: float, _: bool) -> tuple[NewtonResult, bool, bool]:
            nonlocal last
            tolerance = _TOLERANCE if end == 1.0 else on_the_way
            accepted, result = self._try(initial.towards(target, end), last, tolerance, done)
            last = accepted or last
            return result, result.state.residual <= tolerance, accepted is not None

        def leap(done: float, result: NewtonResult) -> tuple[float, float]:
            nonlocal initial, last, jumps
            jumps += 1
            if jumps > _MOST_JUMPS or self.is_free(target) or is_loading:
                raise self._error(result)
            # Continue from the equilibrium under the tensions at the end of the branch.
            beyond, at_end = initial.towards(target, min(1.0, done + BEYOND)), last.state.condition
            tensions = np.where(beyond.driven, at_end.tensions, beyond.tensions)
            last = self._under_tensions(tensions, beyond, last)
            initial = self._held_condition(last)
            return 0.0, _FIRST_STEP

        advance(attempt, leap, _FIRST_STEP, _SMALLEST_LOAD if is_loading else SMALLEST_STEP)
        return last

    def _under_tensions(
        self, tensions: FloatArray, condition: Condition, start: Equilibrium | None
    ) -> Equilibrium:
        """Find the equilibrium under fixed ``tensions`` (J,) [N], else as in ``condition``."""
        held = Condition(tensions, condition.tip_wrench, before=condition.before)
        return self._rod.solve(held, start, self._spending)

    def _error(self, result: NewtonResult) -> ConvergenceError:
        subject, count = 'the displacement of the tendons', self._spending.iterations
        return ConvergenceError(subject, result.state.residual, count)

    def _from_unloaded(self) -> Equilibrium:
        """Search from the unloaded arm: winches reel in first, then loads act."""
        rod, target, level = self._rod, self._target, self._rod.first_level(self._target.before)
        condition, equations = rod.at_level(target, level), self._equations(level)
        if rod.has_obstacles:
            # Loads act from the beginning, because they press the arm against the obstacles. The
            # search may need fewer nodes than its start.
            with self._ignoring_failure():
                start = self._under_tensions(condition.tensions, condition, None)
                return self._search(target, rod.on_level(start, level))
            # If winches did not pull, the arm might be inside an obstacle.
            free = Winches(rod.without_obstacles).solve(target, None, self._spending)
            start = self._under_tensions(free.state.condition.tensions, condition, None)
            return self._search(target, rod.on_level(start, level))
        free = condition._replace(tip_wrench=np.zeros(6), factor=0.0)
        if condition.before is None and not condition.tensions.any():
            initial = Equilibrium(equations.slack[0], level, equations.slack[1], None, 0)
        else:
            initial = Equilibrium(equations.unloaded(free), level, None, None, 0)
        unloaded = self._search(free, initial)
        if self.is_free(target):
            return unloaded
        without_factors = unloaded._replace(factors=None)
        equilibrium = self._try(target, without_factors, _TOLERANCE, 0.0)[0]
        if equilibrium is not None:
            return equilibrium
        with self._ignoring_failure():
            return self._by_continuation(target, without_factors)
        with self._ignoring_failure():
            tensions = unloaded.state.condition.tensions
            return self._search(target, self._under_tensions(tensions, condition, None))
        return self._search(target, self._under_tensions(condition.tensions, condition, None))

    def _resolved(self, equilibrium: Equilibrium) -> Equilibrium:
        """Return the ``equilibrium`` on enough nodes for the accuracy."""
        while not self._equations(equilibrium.level).is_resolved(equilibrium.state):
            state, level = equilibrium.state, equilibrium.level
            before, after = (self._equations(level + finer_by).problem for finer_by in (0, 1))
            state = state._replace(z=moved(state.z, before.elements, after.elements))
            start = Equilibrium(state, level + 1, None, None, 0)
            finer, result = self._try(self._target, start, _TOLERANCE, 1.0)
            if finer is None:
                raise self._error(result)
            equilibrium = finer
        if self.is_free(self._target):
            equilibrium = equilibrium._replace(firm_state=equilibrium.state)
        return equilibrium
