"""A simulated arm that is pushed, and what sensors besides load cells read of it."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.budget import Budget
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.base_wrench import BaseWrench
from octo_arm_model.estimation.measurements import Markers, Measurement
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk
from octo_arm_model.simulation.sensors import Noise, Push, Sensors

_ANY = Walk(1.0)  # the state of a simulation is known; its prior is not used


class PushedArm:
    """The shape of an arm under tensions and a push, and what sensors read of it."""

    def __init__(self, config: Config, push: Push, sensors: Sensors) -> None:
        """Of the arm of ``config``.

        Raises:
            OctoArmError: if the model has no loads, or does not cover the arm.
        """
        at = push.s or config.arm.length
        points = (PointForce(at, _ANY),) if any(push.force) else ()
        self._sensors = sensors
        self._model = ArmModel.of(
            config,
            Unknowns(_ANY, point_forces=points),
            config.model,
            has_history=True,
            budget=Budget(config.solve_budget.iterations),
        )
        self._noise = Noise(sensors)
        self._config = config
        self._at: Prediction | None = None

    def go_on_from(self, before: PushedArm) -> bool:
        """Be in the shape, and with the history of the tendons, of the same arm ``before``.

        Of another arm, or one that is pushed elsewhere than at the tip, nothing is known. Returns
        whether tendons with friction are therefore pulled anew.
        """
        # A push at the tip, or none, leaves the points of the arm as they are.
        mine, theirs = (one._model.solver.grid.s for one in (self, before))
        if np.array_equal(mine, theirs) and self._config.has_balance_of(before._config):
            self._at = before._at
            return False
        return before._at is not None and before.at.solved.point_tensions is not None

    def reset(self) -> None:
        """Forget the shape, and with it the history of tendons with friction."""
        self._at = None

    def advance(self, tensions: FloatArray, force: FloatArray, elapsed: float) -> None:
        """As `solve`, whatever time has ``elapsed``."""
        self.solve(tensions, force)

    def solve(self, tensions: FloatArray, force: FloatArray) -> None:
        """Be in the shape under ``tensions`` (tendons,) and the ``force`` of the push (3,) [N].

        Raises:
            SolveError: if there is no such shape; the last one stays.
        """
        state = self._model.state
        x = np.zeros(state.size)
        x[state.tension] = tensions
        if state.point_forces.stop > state.point_forces.start:
            x[state.point_forces] = force
        at = Prediction(self._model, x, None if self._at is None else self._at.shape)
        at.solved  # noqa: B018 - solves it, or raises
        self._at = at

    @property
    def at(self) -> Prediction:
        """The shape now; there is one after `solve`."""
        assert self._at is not None
        return self._at

    @property
    def base_position(self) -> FloatArray:
        """In base_frame [m], (3,)."""
        return np.array(self._config.base.position)

    def tip_pose(self) -> Pose:
        """Pose of the tip, as it is measured."""
        return self._noise.pose(self.at.solved)

    def markers(self) -> FloatArray:
        """Positions of the markers, as they are measured (markers, 3) [m]."""
        count = len(self._sensors.marker_s)
        seen = Markers(self._sensors.marker_s, np.zeros((count, 3)), 1.0)
        return self._noise.markers(self._predicted(seen).reshape(-1, 3))

    def base_wrench(self) -> FloatArray:
        """Force and moment of all loads about the base, as measured (6,) [N, N m]."""
        return self._noise.base_wrench(self._predicted(BaseWrench(np.zeros(6), 1.0)))

    def _predicted(self, zero: Measurement) -> FloatArray:
        """The value of a measurement without noise; ``zero`` is that measurement with value 0."""
        return -zero.innovation(self.at)
