"""Equilibria of an arm of which winches hold some tendons at a length.

Found by `reeling` from an equilibrium nearby, in one step or by continuation of what is held. From
the unloaded arm winches are wound before it bears its loads.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.budget import Spending
from octo_arm_model.arm.errors import ContinuationError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.checks import check_solution
from octo_arm_model.rod.continuation import MOST_CORRECTED, ON_THE_WAY, growth, judge
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.reeling import TOLERANCE, Aim, Border, Found, Reached, Reeling
from octo_arm_model.rod.rod import Equilibrium, Rod, moved

# Of continuation, see `rod.continuation`: the first step, the smallest, iterations of one that may
# grow, and factors on one that was not accepted or not found.
_FIRST_STEP, _SMALLEST_STEP, _QUICKLY, _SHORTER, _MUCH_SHORTER = 0.3, 1e-3, 5, 0.7, 0.25
_SMALLEST_LOAD = 0.03  # where loads begin to act
_SERVED = 3  # steps up to which a border from nearby will do for the next search too
_BEYOND = 0.05  # the end of a branch
_MOST_JUMPS = 4  # to what an arm whose branch ends turns to under tensions that are held


class Held(NamedTuple):
    """An equilibrium that winches hold.

    Attributes:
        equilibrium: of the rod.
        reached: what winches have reeled in there.
    """

    equilibrium: Equilibrium
    reached: Reached


class Winches:
    """Equilibria of an arm of which winches hold some tendons at a length."""

    def __init__(self, rod: Rod, reeling: Callable[[int], Reeling] | None = None) -> None:
        """Of ``rod``, or of another model of its arm with its ``reeling`` of each level."""
        self._rod = rod
        self.reeling = functools.cache(reeling or functools.partial(Reeling, rod))

    def solve(
        self,
        displacements: FloatArray,
        driven: NDArray[np.bool_],
        condition: Condition,
        start: Equilibrium | None = None,
        spending: Spending | None = None,
    ) -> Held:
        """What holds ``displacements`` (J,) [m] of the ``driven`` tendons (J,).

        And the tensions of the others, in ``condition``; neither counts for the rest. From
        ``start``, or from the unloaded arm. Tendons with friction slide from `Condition.before`,
        at the fine points of any level.

        Raises:
            SolveError: if no tensions were found that hold these lengths.
            ContinuationError: if it would take more than the budget.
        """
        wanted = np.where(driven, displacements, 0.0)
        given = condition._replace(tensions=np.where(driven, 0.0, condition.tensions))
        search = _Search(self._rod, self.reeling, spending or self._rod.spending())
        with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
            aim = Aim(given, wanted, driven)
            held = search.find(aim, self._rod.at_least(start, given.before))
            problem = self.reeling(held.equilibrium.level).problem
            check_solution(problem, held.equilibrium.state, not search.is_free(aim))
        return held

    def displacements(self, equilibrium: Equilibrium) -> FloatArray:
        """What winches have reeled in [m], (J,); of slack tendons what would make them taut."""
        reeling, state = self.reeling(equilibrium.level), equilibrium.state
        reeling.problem.load_work(state)
        return reeling.displacement(state)


class _Search:
    """One search for tensions."""

    def __init__(self, rod: Rod, reeling: Callable[[int], Reeling], spending: Spending) -> None:
        """On a ``rod`` with its equations of each level."""
        self._rod, self._reeling, self._spending = rod, reeling, spending

    def find(self, aim: Aim, start: Equilibrium | None) -> Held:
        """See `Winches.solve`."""
        if start is not None:
            try:
                held = self._from(aim, start)
            except ContinuationError:
                raise  # Its budget is spent.
            except SolveError:
                pass
            else:
                is_known = held.equilibrium.judged is start.judged is not None
                return held if is_known else self._resolved(held, aim)
        return self._resolved(self._cold(aim), aim)

    def is_free(self, aim: Aim) -> bool:
        """Whether nothing but tendons acts, so that there is one equilibrium."""
        condition = aim.condition
        is_loaded = condition.factor > 0.0 and self._rod.is_loaded
        return not (is_loaded or condition.tip_wrench.any())

    def _try(
        self, aim: Aim, last: Equilibrium, tolerance: float, part: float
    ) -> tuple[Held | None, Found]:
        """What holds ``aim`` near the ``last`` equilibrium, if it is stable, and what was found.

        ``part`` of the way has been followed.
        """
        border = last.factors if isinstance(last.factors, Border) else None
        tensions = aim.begin(last.state.acting.condition.tensions)
        aim = aim._replace(condition=self._rod.at_level(aim.condition, last.level))
        found = self._reeling(last.level).settle(aim, last.state.z, tensions, tolerance, border)
        state = found.reached.state
        self._spending.add(found.iterations, part, state.residual)
        return self._accepted(aim, last, found, tolerance), found

    def _accepted(
        self, aim: Aim, last: Equilibrium, found: Found, tolerance: float
    ) -> Held | None:
        """What was ``found``, if it is stable and nothing says that it left its branch."""
        state, border, firm = found.reached.state, found.border, last.judged
        reeling, is_free = self._reeling(last.level), self.is_free(aim)
        if not found.is_met or (found.corrected > MOST_CORRECTED and not is_free):
            return None
        if firm is None or not self._rod.is_near(reeling.problem, firm, state):
            firm = None
        if firm is None and not is_free:
            try:
                judged = judge(reeling.problem, state)
            except ConvergenceError:
                return None
            is_stable = judged.stability.is_stable
            served = tolerance < ON_THE_WAY and found.iterations <= _SERVED
            if border is None or not (served and is_stable):
                border = reeling.border(state, judged.factors)
            if not (is_stable or reeling.is_held(aim, state, border)):
                return None
            firm = judged.state if judged.stability.is_firm else None
        total = self._spending.iterations
        return Held(Equilibrium(state, last.level, border, firm, total), found.reached)

    def _from(self, aim: Aim, start: Equilibrium) -> Held:
        """From an equilibrium nearby, in one step or by continuation."""
        near, factors = start, start.factors
        if factors is not None and not isinstance(factors, Border):
            border = self._reeling(start.level).border(start.state, factors)
            near = start._replace(factors=border)
        return self._try(aim, near, self._spending.residual, 0.0)[0] or self._followed(aim, start)

    def _begun(self, aim: Aim, start: Equilibrium) -> tuple[Held, Aim]:
        """Where continuation begins, and what is held there."""
        reeling, state = self._reeling(start.level), start.state
        reeling.problem.load_work(state)
        held = Held(start, reeling.reached(aim, state))
        return held, Aim(state.acting.condition, held.reached.displacement, aim.driven)

    def _followed(self, aim: Aim, start: Equilibrium) -> Held:
        """By continuation from the equilibrium ``start``, of the same loads or of none."""
        held, known = self._begun(aim, start)
        done, step, jumps = 0.0, _FIRST_STEP, 0
        is_loading = known.condition.factor < aim.condition.factor
        smallest = _SMALLEST_LOAD if is_loading else _SMALLEST_STEP
        while True:
            target = min(1.0, done + step)
            tolerance = TOLERANCE if target == 1.0 else ON_THE_WAY
            last = held.equilibrium
            more, found = self._try(known.towards(aim, target), last, tolerance, done)
            if more is not None:
                if target == 1.0:
                    return more
                longer = growth(found.corrected) if found.iterations <= _QUICKLY else 1.0
                held, done, step = more, target, longer * (target - done)
            elif step > smallest:
                shorter = min(growth(found.corrected), _SHORTER) if found.is_met else _MUCH_SHORTER
                step = max(shorter * (target - done), smallest)
            else:
                jumps += 1
                if jumps > _MOST_JUMPS or self.is_free(aim) or is_loading:
                    raise self._error(found)
                # The branch ends: on with what the arm turns to under the tensions there.
                beyond = known.towards(aim, min(1.0, done + _BEYOND))
                pulled, wrench = beyond.begin(held.reached.tensions), beyond.condition.tip_wrench
                turned = self._rod.solve(
                    pulled, wrench, last, self._spending, beyond.condition.before
                )
                held, known = self._begun(aim, turned)
                done, step = 0.0, _FIRST_STEP

    def _error(self, found: Found) -> ConvergenceError:
        left, count = found.reached.left / self._rod.arm.length, self._spending.iterations
        what = 'the displacement of the tendons'
        return ConvergenceError(what, left, count)

    def _cold(self, aim: Aim) -> Held:
        """From the arm without loads, whose winches are wound before it bears them."""
        rod, level = self._rod, self._rod.first_level(None, aim.condition)
        condition, reeling = rod.at_level(aim.condition, level), self._reeling(level)
        wrench = condition.tip_wrench
        free = aim._replace(condition=condition._replace(tip_wrench=np.zeros(6), factor=0.0))
        if condition.before is None and not condition.tensions.any():
            begun = Equilibrium(reeling.slack[0], level, reeling.slack[1], None, 0)
        else:
            begun = Equilibrium(reeling.unloaded(free.condition), level, None, None, 0)
        wound = self._from(free, begun)
        if self.is_free(aim):
            return wound
        alone = wound.equilibrium._replace(factors=None)
        held = self._try(aim, alone, TOLERANCE, 0.0)[0]
        if held is not None:
            return held
        for begin in (
            lambda: self._followed(aim, alone),
            lambda: self._from(
                aim,
                rod.solve(wound.reached.tensions, wrench, None, self._spending, condition.before),
            ),
        ):
            try:
                return begin()
            except ContinuationError:
                raise  # Its budget is spent.
            except SolveError:
                pass
        pulled = rod.solve(condition.tensions, wrench, None, self._spending, condition.before)
        return self._from(aim, pulled)

    def _resolved(self, held: Held, aim: Aim) -> Held:
        """What is ``held``, on as many nodes as it takes."""
        last = held.equilibrium
        while not self._reeling(last.level).is_resolved(last.state):
            before, now = (self._reeling(last.level + more).problem for more in (0, 1))
            state = last.state._replace(z=moved(last.state.z, before.elements, now.elements))
            finer, found = self._try(
                aim, Equilibrium(state, last.level + 1, None, None, 0), TOLERANCE, 1.0
            )
            if finer is None:
                raise self._error(found)
            held, last = finer, finer.equilibrium
        if not self.is_free(aim):
            return held
        return held._replace(equilibrium=last._replace(judged=last.state))
