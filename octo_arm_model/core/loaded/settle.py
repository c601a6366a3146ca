"""Balances of loaded arms near known shapes, of many arms at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.errors import ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED, TOLERANCE
from octo_arm_model.core.loaded.kept_balances import KeptBalances
from octo_arm_model.core.loaded.known_balance import KnownBalance, Margin, margin_under
from octo_arm_model.core.loaded.linearised import Linearised
from octo_arm_model.core.loaded.newton import Iterate, newton, newton_of_all
from octo_arm_model.core.loaded.read_out import read_out
from octo_arm_model.core.loaded.stability import LeastEnergy, least_energy
from octo_arm_model.core.loaded.state import Condition, Stability
from octo_arm_model.core.numerics.floating_point import silenced
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape, Solution
from octo_arm_model.core.section.strain_measures import have_fibres, to_scaled

if TYPE_CHECKING:
    from octo_arm_model.core.loaded.rod import LoadedRod

_TOGETHER = 16  # arms: enough that calls cost little, few enough for arrays to stay in cache


class Settled(NamedTuple):
    """What became of one arm.

    Attributes:
        outcome: as of `Settle`.
        iterations: made.
        residual: of the state it ended in.
        twist: of this.
    """

    outcome: Solution | Shape | None
    iterations: int
    residual: float
    twist: FloatArray


class Settling:
    """`Settle` of one rod under dead loads; with friction near balances that are known alone."""

    def __init__(self, rod: LoadedRod) -> None:
        """Of ``rod``."""
        self._rod = rod
        self._kept: KeptBalances[KnownBalance] = KeptBalances()

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """`Newton` of the rod."""
        problem = self._rod.equilibrium
        found = newton(problem, condition, shape, tolerance)
        if tolerance <= TOLERANCE and isinstance(found.system, Linearised):
            has_energy = problem.loads.has_energy(condition.tip_wrench)
            least = self._least_energy(found.system) if has_energy else None
            margin = margin_under(
                condition.tip_wrench, is_firm=least is not None and bool(least.are_firm[0])
            )
            known = KnownBalance(problem, found.state, found.system, margin)
            self._kept.keep(found.state.shape.twist, known)
            if least is not None and least.are_least[0]:
                return found._replace(system=Stability(True, 1, None))
        return found

    def __call__(
        self, wanted: Condition, shape: Shape, spending: Spending
    ) -> Solution | Shape | None:
        """`Settle` of the rod."""
        known = self._kept.about(shape.twist)
        if known is None and self._rod.equilibrium.friction is not None:
            return None
        condition = wanted._replace(
            tensions=wanted.tensions[np.newaxis], tip_wrench=wanted.tip_wrench[np.newaxis]
        )
        with silenced():
            found = self._settle(condition, shape, known)[0]
        spending.add(found.iterations, 0.0, found.residual, found.twist)
        if isinstance(found.outcome, Solution):
            return found.outcome._replace(iterations=spending.iterations)
        return found.outcome

    def settle_all(self, wanted: Condition, shape: Shape) -> list[Solution | None]:
        """As `Settle` of many arms, ``wanted`` for each, from one ``shape`` or from one of each.

        None for arms that have to be solved one by one.
        """
        found: list[Solution | None] = []
        known = self._kept.about(shape.twist)
        for first in range(0, len(wanted.tensions), _TOGETHER):
            part = slice(first, first + _TOGETHER)
            condition = wanted._replace(
                tensions=wanted.tensions[part], tip_wrench=wanted.tip_wrench[part]
            )
            begin = shape
            if shape.twist.ndim == 3:
                a, b = shape.orientation
                begin = Shape(shape.twist[:, part], Quaternions(a[part], b[part]))
            try:
                settled = self._settle(condition, begin, known)
                outcomes = [one.outcome for one in settled]
            except SolveError:
                outcomes = [None] * len(condition.tensions)
            found += [one if isinstance(one, Solution) else None for one in outcomes]
        return found

    def _settle(
        self, wanted: Condition, shape: Shape, known: KnownBalance | None
    ) -> list[Settled]:
        """As `settle_all`, of few arms, from a balance that is ``known``, if any.

        Raises:
            SolveError: if a tendon is pressed out of the body.
        """
        arms = len(wanted.tensions)
        if shape.twist.ndim == 2:
            a, b = (part[np.newaxis] for part in shape.orientation)
            shape = Shape(shape.twist[:, np.newaxis], Quaternions(a, b))
            if arms > 1:
                a, b = (part.repeat(arms, axis=0) for part in shape.orientation)
                shape = Shape(shape.twist.repeat(arms, axis=1), Quaternions(a, b))
        found: dict[int, Settled] = {}
        for numbers, group in newton_of_all(
            self._rod.equilibrium, wanted, shape, TOLERANCE, known
        ):
            found.update(zip(numbers.tolist(), self._settled(group, known, arms == 1)))
        return [found[number] for number in range(arms)]

    def _settled(self, found: Iterate, known: KnownBalance | None, is_kept: bool) -> list[Settled]:
        """What became of arms that Newton's method led the same way; raises as `_settle`.

        They were led from the balance that is ``known``, if any. That of one arm is kept.
        """
        state, rod = found.state, self._rod
        energy, (twist, (a, b)) = rod.equilibrium.energy, state.shape
        residual = state.residual.tolist()
        shapes = [Shape(twist[:, i], Quaternions(a[i], b[i])) for i in range(len(a))]
        outcomes: list[Solution | Shape | None] = [None] * len(shapes)
        tested = self._tested(found, known)
        if tested is not None:
            are_stable, system, margin = tested
            is_stable = (found.corrected <= MOST_CORRECTED) & are_stable
            strain = to_scaled(energy.law, twist)
            is_resolved = rod.are_resolved(twist)
            if state.sliding is not None:
                is_resolved = np.array([rod.resolves_twist(twist, state.sliding)])
            is_read = is_stable & is_resolved & have_fibres(energy, strain)
            numbers = [number for number, one in enumerate(is_read.tolist()) if one]
            if numbers:
                part, hessian = state, system.hessian
                if hessian.shape[2] < len(shapes):  # of the one that all were led from
                    hessian = hessian.repeat(len(shapes), axis=2)
                if len(numbers) < len(shapes):
                    part, strain = state.of(np.array(numbers)), strain[:, numbers]
                    hessian = hessian[:, :, numbers]
                sliding, tendons = part.sliding, None
                if sliding is not None:
                    tendons = rod.along_tendons(sliding.tensions[:, 0])
                if energy.displaces_tendons:
                    pull = part.condition.tensions
                    local = energy.local_tensions(pull) if sliding is None else sliding.tensions
                    energy.check_tendons(strain, local)
                read = read_out(rod, part, hessian)
                for i, number in enumerate(numbers):
                    outcomes[number] = Solution(
                        read[0][:, i], residual[number], found.iterations, shapes[number],
                        (read[1][i], read[2][i]), tendons,
                    )  # fmt: skip
            if len(numbers) < len(shapes):
                for number in np.flatnonzero(is_stable > is_read).tolist():
                    outcomes[number] = shapes[number]
            if is_kept:
                kept = KnownBalance(rod.equilibrium, state, system, margin, found.tendons)
                self._kept.keep(shapes[0].twist, kept)
        return [
            Settled(outcome, found.iterations, left, shape.twist)
            for outcome, left, shape in zip(outcomes, residual, shapes, strict=True)
        ]

    def _tested(
        self, found: Iterate, known: KnownBalance | None
    ) -> tuple[NDArray[np.bool_], Linearised, Margin] | None:
        """Whether balances are seen to be of least energy, and what to keep with that of one arm.

        Where loads have no energy the sign of the determinant is all that is known. None where no
        balances were found.
        """
        if not (found.state.residual <= TOLERANCE).all():
            return None
        problem, wrenches = self._rod.equilibrium, found.state.condition.tip_wrench
        system, margin = found.system, None
        if known is not None:
            margin = known.margin_left(found.state, found.moved, found.changed)
            if margin is None and system is known.system and found.iterations:
                # It tells of the loads that it was linearised under.
                system = None
        if system is None:
            try:
                system = problem.linearised(found.state)
            except ConvergenceError:
                return None
        assert isinstance(system, Linearised)
        if margin is not None:
            return np.ones(len(wrenches), bool), system, margin
        has_energy = [problem.loads.has_energy(wrench) for wrench in wrenches]
        if all(has_energy):
            least = self._least_energy(system)
            margin = margin_under(wrenches[0], is_firm=bool(least.are_firm[0]))
            return least.are_least, system, margin
        are_stable = system.signs == problem.unloaded_sign
        if any(has_energy):
            are_stable = np.where(has_energy, self._least_energy(system).are_least, are_stable)
        return are_stable, system, margin_under(wrenches[0], is_firm=False)

    def _least_energy(self, system: Linearised) -> LeastEnergy:
        return least_energy(system, self._rod.equilibrium.collocation.rule.weights)
