"""The paper's models as `Statics`: linear material, no loads but the tendons."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.models.unloaded import UnloadedStatics
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.sensitivity.analytic import (
    from_twist_changes,
    papers_twist_changes,
    tip_from_twist_changes,
)
from octo_arm_model.core.sensitivity.results import Sensitivity, Uncertainty


class Equations(Protocol):
    """Strains from tensions at certain nodes.

    They depend on tensions and E through their ratio alone, and analytically on the tensions.
    """

    def solve(self, tensions: FloatArray) -> Solution:
        """Solve for ``tensions`` (..., tendons) [N].

        Complex tensions give derivatives as imaginary parts. One arm, (tendons,), goes without
        the axis of a batch, which NumPy is quicker with.

        Raises:
            ConvergenceError: if the equations were not solved.
        """


class PapersModel(UnloadedStatics):
    """One of the paper's models on a grid.

    Attributes:
        equations: from tensions to strains at the nodes of the grid.
    """

    def __init__(
        self, equations: Callable[[Arm, FloatArray, IntArray], Equations], setup: Setup
    ) -> None:
        """Tabulate the ``equations`` of (arm, nodes, section of each node).

        Raises:
            ConfigError: if they do not cover the arm.
        """
        super().__init__(setup)
        grid = setup.grid
        self.equations = equations(setup.arm, grid.nodes, grid.node_section)

    def _solve(self, tensions: FloatArray, before: FloatArray | None) -> Solution:
        return self.equations.solve(tensions)

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip of ``backbone``, see `Statics`."""
        twist, frames = self._twist_and_frames(backbone)
        tip = tip_from_twist_changes(self._setup.grid, twist, frames, self._changes(backbone))
        by = {'tension': tip[:, :-1], 'youngs_modulus': tip[:, -1:]}
        return uncertainty.tip_covariance([by.get(name) for name in uncertainty.quantities])

    def sensitivity(self, backbone: Backbone, by_offsets: bool = True) -> Sensitivity:
        """First derivatives of ``backbone`` by tensions and E."""
        twist, frames = self._twist_and_frames(backbone)
        changes, count = self._changes(backbone), backbone.tensions.size
        grid = self._setup.grid
        return Sensitivity(
            *from_twist_changes(self.sections, grid, twist, frames, changes, [count])
        )

    def _changes(self, backbone: Backbone) -> FloatArray:
        """Changes of the twist of ``backbone``, see `papers_twist_changes`."""
        return papers_twist_changes(
            self.equations.solve, self.sections, backbone.tensions.ravel(), self._setup.batch
        )
