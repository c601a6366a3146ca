"""Winches that are commanded by length, and what their encoders read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import Wound, displacements_of, solve_displacements
from octo_arm_model.rod.solver import Solver
from octo_arm_model.simulation.profiles.limits import check_command


class LengthControl:
    """Turns commanded lengths into the tensions that hold them, on an elastic arm.

    Attributes:
        displacements: length to reel in by tendon name [m]; empty for none.
    """

    def __init__(self, solver: Solver, limits: FloatArray) -> None:
        """Control the arm of ``solver``, whose tendons bear ``limits`` (tendons,) [N]."""
        self._solver, self._limits = solver, limits
        self.displacements: dict[str, float] = {}
        self._wound: Wound | None = None
        self._shape: Backbone | None = None

    def go_on_with(self, solver: Solver) -> None:
        """Solve by another ``solver`` of the same arm from now on, whose budget is another."""
        self._solver = solver

    def command(self, displacements: Mapping[str, float], tensions: FloatArray) -> None:
        """Hold ``displacements`` from now on, beside the commanded ``tensions`` (tendons,) [N].

        Raises:
            TensionError: if a tendon would be pulled beyond its limit.
            OctoArmError: as `solve_displacements`; what was held before still is.
        """
        wound = self._hold(displacements, tensions)
        check_command(self._solver.arm, wound.backbone.tensions, self._limits)
        self.displacements, self._wound = dict(displacements), wound

    def tensions(self, tensions: FloatArray) -> FloatArray:
        """Set points of all winches (tendons,) [N], beside those commanded by tension.

        Never beyond a limit: a winch gives way before that.

        Raises:
            OctoArmError: as `solve_displacements`.
        """
        if not self.displacements:
            return tensions
        self._wound = self._hold(self.displacements, tensions)
        return np.minimum(self._wound.backbone.tensions.ravel(), self._limits)

    def encoders(self, tensions: FloatArray) -> FloatArray:
        """Lengths that the winches have reeled in under ``tensions`` (tendons,) [m].

        Raises:
            OctoArmError: as `Solver.solve`.
        """
        shape = self._solver.arm.tension_shape
        self._shape = self._solver.follow(tensions.reshape(shape), self._shape)
        return displacements_of(self._solver, self._shape).ravel()

    def _hold(self, displacements: Mapping[str, float], tensions: FloatArray) -> Wound:
        names = self._solver.arm.tendon_names
        given = {
            name: float(tension)
            for name, tension in zip(names, tensions, strict=True)
            if name not in displacements
        }
        return solve_displacements(self._solver, displacements, given, self._wound)
