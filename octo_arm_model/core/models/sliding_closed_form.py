"""`closed_form` for tendons with friction: the same balance, at the local tension."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.rod import CUTS, LoadedRod
from octo_arm_model.core.loaded.sliding.friction import Friction
from octo_arm_model.core.loaded.sliding.friction_changes import FrictionChanges
from octo_arm_model.core.loaded.sliding.sliding_response import tension_changes
from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.sliding import Rods
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.models.unloaded import UnloadedStatics
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.sensitivity.analytic import from_twist_changes
from octo_arm_model.core.sensitivity.results import Sensitivity, Uncertainty


class SlidingClosedForm(UnloadedStatics):
    """The closed form along a rod whose tendons have friction.

    Attributes:
        rods: at whose points it is solved.
    """

    def __init__(self, setup: Setup) -> None:
        """Tabulate the arm.

        Raises:
            ConfigError: if tendons dig into the body.
        """
        super().__init__(setup)
        arm, grid, base, *_ = setup
        self._rod = functools.lru_cache(
            lambda level: LoadedRod(arm, grid, base, self.law, False, Loads(), CUTS[level])
        )
        self.rods = Rods(self._rod)
        self._rod(0)

    @functools.cached_property
    def _at_nodes(self) -> ClosedForm:
        return ClosedForm(self._setup.arm, self._setup.grid.nodes, self._setup.grid.node_section)

    def _solve(self, tensions: FloatArray, before: FloatArray | None) -> Solution:
        solution = self.rods.slide(self._answer, tensions, before)
        assert solution.tendons is not None
        along = solution.tendons.points
        rod = self._rod(self.rods.level_of(along))
        rows = along.reshape(len(along), -1, rod.points)
        twist = self._at_nodes.local_twist(rod.nodes.interpolate(rows))
        return solution._replace(twist=twist.reshape(solution.twist.shape))

    def _answer(self, rod: LoadedRod, friction: Friction) -> _Sections:
        return _Sections(self._closed_form(rod), friction)

    def _closed_form(self, rod: LoadedRod) -> ClosedForm:
        own = rod.equilibrium.collocation
        return ClosedForm(self._setup.arm, own.s, own.section)

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """See `Statics`."""
        return self.rods.at_nodes(backbone)

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip of ``backbone``, see `Statics`."""
        return self.sensitivity(backbone).tip_covariance(uncertainty)

    def sensitivity(self, backbone: Backbone, by_offsets: bool = True) -> Sensitivity:
        """First derivatives of ``backbone`` by tensions, E and friction.

        Raises:
            SolveError: if there are none, see `Friction.require_derivatives`.
        """
        before = backbone.point_tensions
        if before is None:
            raise ConfigError('the backbone was solved without friction')
        rod = self._rod(self.rods.level_of(before))
        friction = rod.equilibrium.friction
        assert friction is not None
        tensions = backbone.tensions.ravel()
        closed_form = self._closed_form(rod)
        rows = closed_form.local_twist(before[:, np.newaxis])
        sliding = friction.slide_along(rows, tensions[np.newaxis], before)
        own_changes = FrictionChanges(friction, sliding, rows[:, 0])
        own_changes.require_derivatives(tensions)
        along = _by_tensions(closed_form, sliding.tensions)
        # Scaling E is scaling all tensions the other way.
        count = tensions.size
        direct = np.zeros((count, 2 * count + 1, along.shape[-1]))
        own = np.arange(count)
        direct[own, own] = own_changes.by_base_tension()
        direct[:, count] = -sliding.tensions[:, 0]
        direct[own, count + 1 + own] = own_changes.by_coefficient()
        change = tension_changes(
            own_changes, lambda change: np.einsum('ijn,jcn->icn', along, change), direct
        )
        at_nodes = _by_tensions(self._at_nodes, rod.nodes.interpolate(sliding.tensions))
        changes = np.einsum('ijn,jcn->icn', at_nodes, rod.nodes.interpolate(change))
        at_node, frames = self._twist_and_frames(backbone)
        tension, young, mu = from_twist_changes(
            self.sections, self._setup.grid, at_node, frames, changes, [count, 1],
            rod.mean_along_tendons(change),
        )  # fmt: skip
        return Sensitivity(tension, young, by_friction=mu)


def _by_tensions(closed_form: ClosedForm, local_tensions: FloatArray) -> FloatArray:
    """Derivative of the twist by the local tension of each tendon, (4, tendons, points).

    At ``local_tensions`` (tendons, 1, points) [N]. By a complex step, as the closed form is
    analytic in the tensions; see `papers_twist_changes`.
    """
    step = 1e-6 * max(float(local_tensions.max()), 1e-3 * float(closed_form.stiffness.axial.min()))
    moved = local_tensions + 1j * step * np.eye(len(local_tensions))[..., np.newaxis]
    return np.asarray(closed_form.local_twist(moved).imag / step)


class _Sections:
    """`Sections` of the closed form under tendons of some ``friction``; its residual is zero."""

    def __init__(self, closed_form: ClosedForm, friction: Friction) -> None:
        self._closed_form, self._friction = closed_form, friction
        self.residual: FloatArray = np.zeros(1)

    def begin(self, twist: FloatArray) -> None:
        """Do nothing: the closed form needs no start."""

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """See `Sections`."""
        self.residual = np.zeros(local_tensions.shape[1])
        return self._closed_form.local_twist(self._friction.of_all(local_tensions))
