"""Equilibria of an arm of which winches hold some tendons at a length.

Found by `winch_equations` from an equilibrium nearby, in one step or by continuation of
what is held. From the unloaded arm winches are wound before it bears its loads.
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
_MET = 1e-8  # residual that will do where rounding and friction leave no less
_ON_THE_WAY, _TURNING = 3e-4, 1e-6  # of equilibria on the way, and where tendons turn round
_FIRST_STEP = 0.3  # of continuation
_SMALLEST_LOAD = 0.03  # likewise, where loads begin to act
_SERVED = 3  # steps up to which a border from nearby will do for the next search too
_MOST_JUMPS = 4  # to what an arm whose branch ends turns to under tensions that are held


class Winches:
    """Equilibria of an arm of which winches hold some tendons at a length."""

    def __init__(
        self, rod: Rod, equations: Callable[[int], RodWinchEquations] | None = None
    ) -> None:
        """Of ``rod``, or of another model of its arm with its ``equations`` of each level."""
        self._rod = rod
        self.equations = functools.cache(equations or functools.partial(RodWinchEquations, rod))

    def solve(
        self, wanted: Condition, start: Equilibrium | None, spending: Spending
    ) -> Equilibrium:
        """What holds the lengths of the tendons that are driven in a condition that is ``wanted``.

        And the tensions of the others; neither counts for the rest. From ``start``, or from the
        unloaded arm. Tendons with friction slide from `Condition.before` of any level.

        Raises:
            SolveError: if no tensions were found that hold these lengths.
            ContinuationError: if it would take more than the budget.
        """
        driven = wanted.driven
        wanted = wanted._replace(
            tensions=np.where(driven, 0.0, wanted.tensions),
            lengths=np.where(driven, wanted.lengths, 0.0),
        )
        search = _Search(self._rod, self.equations, wanted, spending)
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            found = search.find(self._rod.at_least(start, wanted.before))
            problem = self.equations(found.level).problem
            check_solution(problem, found.state, not search.is_free(wanted))
        return found

    def displacements(self, equilibrium: Equilibrium) -> FloatArray:
        """What winches have reeled in [m], (J,); of slack tendons what would make them taut."""
        return self.equations(equilibrium.level).displacement(equilibrium.state)


class _Search:
    """One search for the tensions that hold a condition."""

    def __init__(
        self,
        rod: Rod,
        equations: Callable[[int], RodWinchEquations],
        wanted: Condition,
        spending: Spending,
    ) -> None:
        """For ``wanted`` on a ``rod`` with its equations of each level."""
        self._rod, self._equations = rod, equations
        self._wanted, self._spending = wanted, spending

    def is_free(self, condition: Condition) -> bool:
        """Whether nothing but tendons acts, so that there is one equilibrium."""
        if self._rod.has_obstacles:
            return False
        is_loaded = condition.factor > 0.0 and self._rod.is_loaded
        return not (is_loaded or condition.tip_wrench.any())

    def find(self, start: Equilibrium | None) -> Equilibrium:
        """See `Winches.solve`."""
        found = None
        if start is not None:
            with self._failing():
                found = self._from(self._wanted, start)
        if found is None:
            found = self._cold()
        elif start is not None and found.firm_state is start.firm_state is not None:
            return found  # resolved as well as that
        return self._resolved(found)

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        """Where a search may fail, unless because its budget is spent."""
        try:
            yield
        except ContinuationError:
            raise
        except SolveError:
            pass

    def _try(
        self, wanted: Condition, last: Equilibrium, tolerance: float, part: float
    ) -> tuple[Equilibrium | None, NewtonResult]:
        """What holds ``wanted`` near the ``last`` equilibrium, if stable, and what was found.

        ``part`` of the way has been followed.
        """
        equations, z, factors = self._equations(last.level), last.state.z, last.factors
        system = factors if isinstance(factors, BorderedSystem) else None
        pulled = np.where(wanted.driven, last.state.condition.tensions, wanted.tensions)
        wanted = self._rod.at_level(wanted, last.level)._replace(tensions=pulled)
        begun = equations.evaluate(wanted, z)
        found = newton(equations, begun, tolerance, system, system is not None and system.z is z)
        self._spending.add(found.iterations, part, found.state.residual)
        return self._accepted(last, found, tolerance), found

    def _accepted(
        self, last: Equilibrium, found: NewtonResult, tolerance: float
    ) -> Equilibrium | None:
        """What was ``found``, if it is stable and nothing says that it left its branch."""
        state, system, firm = found.state, found.factors, last.firm_state
        condition, equations = state.condition, self._equations(last.level)
        is_free = self.is_free(condition)
        if not state.residual <= max(tolerance, _MET):
            return None
        if found.corrected > MOST_CORRECTED and not is_free:
            return None
        if equations.problem.passes(last.state.z, state.z):
            return None
        if firm is None or not self._rod.is_near(equations.problem, firm, state):
            firm = None
        if firm is None and not is_free:
            verdict = judge(equations.problem, state)
            is_stable = verdict.stability.is_stable
            served = tolerance < _TURNING and found.iterations <= _SERVED
            if not (isinstance(system, BorderedSystem) and served and is_stable):
                system = equations.linearise(state, verdict.factors)
            if not (is_stable or equations.is_held(state, system)):
                return None
            firm = verdict.state if verdict.stability.is_firm else None
        return Equilibrium(state, last.level, system, firm, self._spending.iterations)

    def _from(self, wanted: Condition, start: Equilibrium) -> Equilibrium:
        """From an equilibrium nearby, in one step or by continuation."""
        begun, factors = start, start.factors
        if factors is not None and not isinstance(factors, BorderedSystem):
            system = self._equations(start.level).linearise(start.state, factors)
            begun = start._replace(factors=system)
        found = self._try(wanted, begun, self._spending.residual, 0.0)[0]
        return found or self._followed(wanted, start)

    def _held(self, start: Equilibrium) -> Condition:
        """What is held in ``start``."""
        equations, state = self._equations(start.level), start.state
        equations.problem.load_work(state)
        lengths, driven = equations.displacement(state), self._wanted.driven
        return state.condition._replace(lengths=lengths, driven=driven)

    def _followed(self, wanted: Condition, last: Equilibrium) -> Equilibrium:
        """By continuation from the equilibrium ``last``, of the same loads or of none."""
        known, jumps = self._held(last), 0
        is_loading = known.factor < wanted.factor
        on_the_way = _ON_THE_WAY if wanted.before is None else _TURNING

        def attempt(done: float, target: float, _: bool) -> tuple[NewtonResult, bool, bool]:
            nonlocal last
            tolerance = _TOLERANCE if target == 1.0 else on_the_way
            more, found = self._try(known.towards(wanted, target), last, tolerance, done)
            last = more or last
            return found, found.state.residual <= tolerance, more is not None

        def leap(done: float, found: NewtonResult) -> tuple[float, float]:
            nonlocal known, last, jumps
            jumps += 1
            if jumps > _MOST_JUMPS or self.is_free(wanted) or is_loading:
                raise self._error(found)
            # On with what the arm turns to under the tensions at the end of the branch.
            beyond, own = known.towards(wanted, min(1.0, done + BEYOND)), last.state.at_nodes
            pulled = np.where(beyond.driven, own.condition.tensions, beyond.tensions)
            last = self._pulled(pulled, beyond, last)
            known = self._held(last)
            return 0.0, _FIRST_STEP

        advance(attempt, leap, _FIRST_STEP, _SMALLEST_LOAD if is_loading else SMALLEST_STEP)
        return last

    def _pulled(
        self, tensions: FloatArray, condition: Condition, start: Equilibrium | None
    ) -> Equilibrium:
        """The arm under ``tensions`` (J,) [N] that are held, in a ``condition``."""
        held = Condition(tensions, condition.tip_wrench, before=condition.before)
        return self._rod.solve(held, start, self._spending)

    def _error(self, found: NewtonResult) -> ConvergenceError:
        what, count = 'the displacement of the tendons', self._spending.iterations
        return ConvergenceError(what, found.state.residual, count)

    def _cold(self) -> Equilibrium:
        """From the arm without loads, whose winches are wound before it bears them."""
        rod, wanted, level = self._rod, self._wanted, self._rod.first_level(None, self._wanted)
        condition, equations = rod.at_level(wanted, level), self._equations(level)
        if rod.has_obstacles:
            # Wound with its loads, as they and obstacles hold each other.
            return self._from(wanted, self._pulled(condition.tensions, condition, None))
        free = condition._replace(tip_wrench=np.zeros(6), factor=0.0)
        if condition.before is None and not condition.tensions.any():
            begun = Equilibrium(equations.slack[0], level, equations.slack[1], None, 0)
        else:
            begun = Equilibrium(equations.unloaded(free), level, None, None, 0)
        wound = self._from(free, begun)
        if self.is_free(wanted):
            return wound
        alone = wound._replace(factors=None)
        found = self._try(wanted, alone, _TOLERANCE, 0.0)[0]
        if found is not None:
            return found
        with self._failing():
            return self._followed(wanted, alone)
        with self._failing():
            tensions = wound.state.condition.tensions
            return self._from(wanted, self._pulled(tensions, condition, None))
        return self._from(wanted, self._pulled(condition.tensions, condition, None))

    def _resolved(self, found: Equilibrium) -> Equilibrium:
        """What was ``found``, on as many nodes as it takes."""
        while not self._equations(found.level).is_resolved(found.state):
            before, now = (self._equations(found.level + more).problem for more in (0, 1))
            state = found.state._replace(z=moved(found.state.z, before.elements, now.elements))
            start = Equilibrium(state, found.level + 1, None, None, 0)
            finer, last = self._try(self._wanted, start, _TOLERANCE, 1.0)
            if finer is None:
                raise self._error(last)
            found = finer
        return found._replace(firm_state=found.state) if self.is_free(self._wanted) else found
