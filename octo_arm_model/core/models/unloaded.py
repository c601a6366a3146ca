"""What models of linear material that take no loads but the tendons have in common."""

from __future__ import annotations

import abc
import functools
from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.numerics.floating_point import silenced
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.kinematics import node_frames
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.section.elastic_laws import LAWS
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.sensitivity.results import Change


class UnloadedStatics(abc.ABC):
    """`Statics` without loads but the tendons.

    Attributes:
        takes_loads: never.
        law: the linear one.
        strains: four.
    """

    takes_loads = False
    law = LAWS['linear']
    strains = 4

    def __init__(self, setup: Setup) -> None:
        """Keep the ``setup``.

        Raises:
            ConfigError: if tendons dig into the body.
        """
        if setup.arm.sheath_stiffness:
            raise ConfigError(
                "tendons.sheath_stiffness goes with model exact: the paper's models keep tendons "
                'in their places'
            )
        self._setup = setup

    @functools.cached_property
    def sections(self) -> SectionEnergy:
        """The cross sections at the nodes; for the lengths of tendons alone."""
        arm, grid = self._setup.arm, self._setup.grid
        return SectionEnergy(arm, grid.nodes, grid.node_section, self.law)

    def is_loaded(self, tip_wrench: FloatArray) -> bool:
        """False: these models take no loads."""
        return False

    def solve(
        self,
        tensions: FloatArray,
        tip_wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None = None,
    ) -> Solution:
        """Solve for ``tensions``, see `Statics.solve`; ``tip_wrench`` and ``start`` are not used.

        Raises:
            ConvergenceError: if the equations were not solved.
        """
        with silenced():
            return self._solve(tensions, before)

    @abc.abstractmethod
    def _solve(self, tensions: FloatArray, before: FloatArray | None) -> Solution:
        """Solve for ``tensions`` (..., tendons) [N]; for ``before`` see `Statics.solve`."""

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon at every node, see `Statics`."""
        return self.sections.local_tensions(backbone.tensions.reshape(1, -1))[:, 0]

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Never called, as no loads are taken."""
        raise NotImplementedError

    def _twist_and_frames(self, backbone: Backbone) -> tuple[FloatArray, Quaternions]:
        """Twist (4, nodes) of a single ``backbone``, and the frames that follow from it."""
        twist = backbone.twist
        assert twist is not None
        _, frames = node_frames(twist[:, np.newaxis], self._setup.grid, self._setup.base)
        return twist, frames
