"""The model exact under loads: balances of a rod, near known ones or followed from these."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.core.errors import ContinuationError, ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Allowance, Spending
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED, ON_THE_WAY, TOLERANCE, follow
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.settle import Settling
from octo_arm_model.core.loaded.stability import stability_of
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.models.sliding import Rods
from octo_arm_model.core.numerics.floating_point import silenced
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Shape, Solution
from octo_arm_model.core.section.strain_measures import check_fibres, to_scaled

_FIRST_STEP = 0.1  # of continuation, where the whole way is too far for one
_COARSE = 3  # points in each of the elements in which an arm is followed from its unloaded shape


class LoadedExact:
    """Balances of one arm under loads."""

    def __init__(self, rod: Callable[..., LoadedRod], rods: Rods, allowance: Allowance) -> None:
        """``rod`` returns the rod of a level, or one with fewer points in each element.

        ``rods`` are the same without fewer points, and ``allowance`` is what solves may take.
        """
        self._rod, self._rods, self._allowance = rod, rods, allowance

    def settle_all(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Backbone | None
    ) -> list[Solution | None]:
        """Solutions of many arms by Newton's method alone, all at once.

        ``tensions`` are (arms, tendons) [N] and ``tip_wrench`` (arms, 6) [N, N m].

        Returns:
            None for arms that it does not lead to a stable equilibrium, or not within the budget:
            `solve` has to follow them one by one.
        """
        rod = self._rod(self._level_of(start))
        nothing: list[Solution | None] = [None] * len(tensions)
        if not isinstance(rod.settle, Settling) or _needs_start(rod):
            return nothing
        wanted = Condition(tensions, tip_wrench, 1.0)
        found = rod.settle.settle_all(wanted, _near(start, rod, wanted))
        most = self._allowance.budget.iterations
        return [one if one is not None and one.iterations <= most else None for one in found]

    def _level_of(self, start: Backbone | None) -> int:
        """Level of the rod on which ``start`` was solved; 0 without one."""
        shape = None if start is None else start.shape
        return 0 if shape is None else self._rods.level_of(shape.twist)

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None,
    ) -> Solution:
        """Equilibrium of one arm, with arguments as of `Exact.solve`.

        Raises:
            SolveError: if there is no trustworthy answer.
        """
        level = self._level_of(start)
        wanted = Condition(tensions, tip_wrench, 1.0, self._rods.at_level(before, level))
        spending, rod = self._allowance.spending(), self._rod(level)
        shape, found = None if start is None else start.shape, None
        if rod.settle is not None and not (shape is None and _needs_start(rod)):
            if shape is None:
                with silenced():
                    shape = _near(start, rod, wanted)
            settled = rod.settle(wanted, shape, spending)
            if isinstance(settled, Solution):
                return settled
            found = settled
        with silenced():
            return self._solve(level, wanted, start, before, found, spending)

    def _solve(
        self,
        level: int,
        wanted: Condition,
        start: Backbone | None,
        before: FloatArray | None,
        found: Shape | None,
        spending: Spending,
    ) -> Solution:
        """As `solve`, where the shape of ``start`` has not led there.

        Or to the shape ``found``, which the rod of this ``level`` does not resolve.
        """
        rod, tensions = self._rod(level), wanted.tensions
        if found is not None:
            known, shape = wanted, found
        elif start is None:
            known, shape = self._nearly(wanted, spending)
        else:
            shape = _near(start, rod, wanted)
            known = wanted._replace(tensions=start.tensions.ravel(), tip_wrench=start.tip_wrench)
        state = follow(rod.equilibrium, rod.newton, known, shape, wanted, spending)
        while not rod.resolves(state.shape, state.sliding):
            level, coarser = level + 1, rod
            rod = self._rod(level)
            shape = rod.from_coarser(coarser, state.shape)
            wanted = wanted._replace(before=self._rods.at_level(before, level))
            state = follow(rod.equilibrium, rod.newton, wanted, shape, wanted, spending)
        energy = rod.equilibrium.energy
        strain = to_scaled(energy.law, state.shape.twist[:, np.newaxis])
        check_fibres(energy, strain)
        local_tensions, tendons = energy.local_tensions(tensions[np.newaxis]), None
        if state.sliding is not None:
            local_tensions = state.sliding.tensions
            tendons = rod.along_tendons(local_tensions[:, 0])
        energy.check_tendons(strain, local_tensions)
        twist, position, quaternion = rod.read_out(state)
        return Solution(
            twist, state.residual, spending.iterations, state.shape, (position, quaternion),
            tendons,
        )  # fmt: skip

    def _nearly(self, wanted: Condition, spending: Spending) -> tuple[Condition, Shape]:
        """A condition, and a shape near its equilibrium, from which to follow the arm.

        The condition is ``wanted`` itself where Newton's method, or continuation with few points,
        leads there; else it is that of the unloaded shape.

        Raises:
            SolveError: if there is no unloaded shape.
        """
        known = wanted._replace(tip_wrench=np.zeros(6), factor=0.0)
        fine, coarse = self._rod(0), self._rod(0, _COARSE)
        problem, is_quicker = fine.equilibrium, coarse.points < fine.points
        if problem.friction is not None:
            # By NumPy few points take as long as many; a history is given at the fine ones.
            is_quicker &= not _needs_start(fine) and wanted.before is None
        if problem.loads.without_tangent or not is_quicker:
            return known, fine.unloaded(wanted.tensions, wanted.before)
        if fine.settle is None:
            found = fine.newton(wanted, fine.unloaded(wanted.tensions), TOLERANCE)
            state = found.state
            spending.add(found.iterations, 0.0, state.residual, state.shape.twist)
            if state.residual <= TOLERANCE and found.corrected <= MOST_CORRECTED:
                stability = stability_of(problem, state, found.system)
                if stability.is_stable or (stability.is_stable is None and stability.sign > 0):
                    return wanted, state.shape
        shape = coarse.unloaded(wanted.tensions)
        try:
            state = follow(
                coarse.equilibrium, coarse.newton, known, shape, wanted, spending, ON_THE_WAY,
                _FIRST_STEP,
            )  # fmt: skip
        except ContinuationError:
            raise  # Its budget is spent.
        except ConvergenceError:
            return known, fine.unloaded(wanted.tensions)  # Too few points, perhaps.
        return wanted, fine.from_coarser(coarse, state.shape)


def _near(start: Backbone | None, rod: LoadedRod, wanted: Condition) -> Shape:
    """The shape of ``start`` at the points of ``rod``; the unloaded one where it has none.

    Without a ``start`` nearly the unloaded one of what is ``wanted``.

    Raises:
        SolveError: if there is no unloaded shape.
    """
    if start is None:
        return rod.near_unloaded(wanted.tensions, wanted.before)
    return start.shape or rod.unloaded(start.tensions.ravel(), wanted.before)


def _needs_start(rod: LoadedRod) -> bool:
    """Whether a balance of ``rod`` is settled from known ones alone, see `Settling`."""
    return rod.equilibrium.friction is not None and isinstance(rod.settle, Settling)
