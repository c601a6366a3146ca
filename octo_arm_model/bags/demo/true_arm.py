"""The arm of a simulated experiment as it is, and not as the bag describes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from octo_arm_model.analysis.winding.tendon_displacement import displacements_of
from octo_arm_model.bags.demo.experiment import Experiment
from octo_arm_model.config.config import Config
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone

_LEVELS = 41  # tensions that encoders are computed at, between which they are interpolated


class TrueArm:
    """Its shapes and lengths while the first tendon is pulled.

    Attributes:
        config: what it is.
        solver: of its shape.
    """

    def __init__(self, parameters: Mapping[str, Any], experiment: Experiment) -> None:
        """Change the arm of ``parameters`` as the ``experiment`` says."""
        changed: dict[str, Any] = {'model': 'exact'}
        for name in ('material.youngs_modulus', 'material.table_youngs_modulus'):
            if parameters.get(name):
                changed[name] = (experiment.stiffness * np.array(parameters[name])).tolist()
        for name, value in (
            ('tendons.sheath_stiffness', experiment.sheath),
            ('tendons.axial_stiffness', experiment.axial_stiffness),
            ('tendons.friction', experiment.friction),
        ):
            if value:
                changed[name] = [value]
        self.config = Config.from_parameters({**parameters, **changed})
        self.solver = self.config.solver()

    def reeled_in(self, pulls: FloatArray) -> FloatArray:
        """Lengths that the winches of all tendons have reeled in, (pulls, tendons) [m].

        Under one pull after another [N].
        """
        if self.config.arm.friction:
            # They depend on the pulls before.
            shapes = self.shapes(pulls, np.zeros((pulls.size, 3)))
            return np.array([displacements_of(self.solver, shape).ravel() for shape in shapes])
        levels = np.linspace(0.0, pulls.max(), _LEVELS)
        known = [
            displacements_of(self.solver, self.solver.solve(self._tensions(level))).ravel()
            for level in levels
        ]
        return np.asarray(CubicSpline(levels, known)(pulls))

    def shapes(self, pulls: FloatArray, forces: FloatArray) -> list[Backbone]:
        """Shapes under one pull after another [N], with ``forces`` (pulls, 3) on the tip [N]."""
        last: Backbone | None = None
        found: list[Backbone] = []
        for pull, force in zip(pulls, forces, strict=True):
            tensions, wrench = self._tensions(pull), np.append(force, np.zeros(3))
            if (
                last is None
                or (tensions != last.tensions).any()
                or (wrench != last.tip_wrench).any()
            ):
                last = self.solver.follow(tensions, last, wrench if wrench.any() else None)
            found.append(last)
        return found

    def _tensions(self, pull: float) -> FloatArray:
        arm = self.config.arm
        tensions = np.zeros(len(arm.tendons))
        tensions[0] = pull
        return tensions.reshape(arm.tension_shape)
