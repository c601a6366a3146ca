"""Arms under tendons with friction and no loads, on rods cut as finely as their strains need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.core.errors import ConfigError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.kept_balances import KeptBalances
from octo_arm_model.core.loaded.rod import CUTS, LoadedRod
from octo_arm_model.core.loaded.sliding.friction import Friction
from octo_arm_model.core.loaded.sliding.sliding_balance import Sections, Slid, balance
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.section.strain_measures import to_scaled


class Rods:
    """The rods of one arm, of levels 0 to ``len(CUTS) - 1``, each finer than the one before.

    Attributes:
        rod: returns the rod of a level.
    """

    def __init__(self, rod: Callable[[int], LoadedRod]) -> None:
        """``rod`` returns the rod of a level, always the same one."""
        self.rod = rod
        self._kept: KeptBalances[tuple[Friction, Slid]] = KeptBalances()

    def level_of(self, values: FloatArray) -> int:
        """Level of the rod at whose points ``values`` (..., points) are.

        Raises:
            ConfigError: if they are at those of no rod of this arm.
        """
        for level in range(len(CUTS)):
            if self.rod(level).points == values.shape[-1]:
                return level
        raise ConfigError('the backbone was solved by another solver')

    def at_level(self, before: FloatArray | None, level: int) -> FloatArray | None:
        """Interpolate tensions ``before`` (tendons, points) [N] to the points of a ``level``.

        They may be at the points of any level; None stays None.
        """
        if before is None or (given := self.level_of(before)) == level:
            return before
        return self.rod(level).read_from(self.rod(given)).interpolate(before)

    def at_nodes(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon of a single ``backbone`` at every node [N], (tendons, nodes).

        Raises:
            ConfigError: if its history was forgotten.
        """
        along = backbone.point_tensions
        if along is None:
            raise ConfigError('the backbone has no tensions along its tendons')
        return self.rod(self.level_of(along)).nodes.interpolate(along)

    def slide(
        self,
        sections: Callable[[LoadedRod, Friction], Sections],
        tensions: FloatArray,
        before: FloatArray | None,
    ) -> Solution:
        """Balance under ``tensions`` (batch, tendons) or (tendons,) [N] alone, with friction.

        ``sections`` makes the `Sections` of a rod for those tendons that are under tension;
        ``before`` is as in `Friction.slide`.

        Raises:
            SolveError: if there is none.
        """
        level, rows = 0 if before is None else self.level_of(before), np.atleast_2d(tensions)
        last = None
        if before is not None and tensions.ndim == 1:
            last = self._kept.about(before)
        while True:
            rod = self.rod(level)
            assert rod.equilibrium.friction is not None
            friction = rod.equilibrium.friction.pulled(rows)
            answer, pull = sections(rod, friction), rows[:, friction.pull]
            at_level, known = self.at_level(before, level), None
            held = None if at_level is None else at_level[friction.pull]
            if last is not None and last[0] is friction and last[1].is_near(pull[0]):
                known = last[1]
            try:
                slid = balance(friction, answer, pull, held, known)
            except SolveError:
                if known is None:
                    raise
                slid = balance(friction, answer, pull, held)
            if rod.resolves_twist(slid.twist, slid.sliding):
                break
            level += 1
        energy, local_tensions = friction.energy, slid.sliding.tensions
        strain = to_scaled(energy.law, slid.twist)
        energy.check_tendons(strain, local_tensions)
        energy.check_stable(strain, local_tensions)
        iterations = np.full(len(rows), slid.steps)
        tendons = rod.along_tendons(friction.of_all(local_tensions))
        solution = Solution(
            rod.nodes.interpolate(slid.twist), answer.residual, iterations, tendons=tendons
        )
        if tensions.ndim > 1:
            return solution
        one = solution.one()
        assert one.tendons is not None
        self._kept.keep(one.tendons.points, (friction, slid))
        return one
