"""The model exact under loads: from tensions and a wrench on the tip to strains."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.continuation import follow
from octo_arm_model.core.loaded.equilibrium import Condition, Equilibrium
from octo_arm_model.core.loaded.load_resultants import LoadTable
from octo_arm_model.core.models.exact import Exact, check_fibres, to_scaled
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame
from octo_arm_model.core.rod.solution import Solution


class LoadedArm:
    """One arm and the loads that act on it all the time."""

    def __init__(self, statics: Exact, grid: StationGrid, loads: LoadTable, base: Frame) -> None:
        """Prepare for the unloaded ``statics`` at the nodes of ``grid``."""
        self._statics, self._grid, self._loads, self._base = statics, grid, loads, base

    @functools.cached_property
    def equilibrium(self) -> Equilibrium:
        """The equations of the loaded arm."""
        return Equilibrium(self._statics.at_nodes, self._grid, self._loads, self._base)

    def solve(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Backbone | None
    ) -> Solution:
        """Balance under ``tensions`` (1, tendons) [N] and ``tip_wrench`` (6,) [N, N m].

        Followed from ``start``, a solution for the same nodes, or from the unloaded shape.

        Raises:
            SolveError: if there is no trustworthy answer.
        """
        if start is None or start.twist is None:
            known = Condition(tensions[0], np.zeros(6), 0.0)
            twist = self._statics.solve(tensions).twist[:, 0]
        else:
            known = Condition(start.tensions.ravel(), start.tip_wrench, 1.0)
            twist = start.twist
        wanted = Condition(tensions[0], tip_wrench, 1.0)
        state, iterations = follow(self.equilibrium, known, twist, wanted)
        energy = self._statics.at_nodes
        check_fibres(energy, to_scaled(energy.law, state.twist[:, np.newaxis]))
        return Solution(
            state.twist[:, np.newaxis], np.array([state.residual]), np.array([iterations])
        )
