"""Tendons driven by length or by tension, message by message, for the node and for replay."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import Wound, solve_displacements, wound_sensitivity
from octo_arm_model.rod.solver import Solver


class Answer(NamedTuple):
    """A shape and the covariance of its tip."""

    backbone: Backbone
    #: covariance of the pose of the tip, (6, 6); None if not asked for or unknown
    covariance: FloatArray | None
    #: error because of which it is unknown, such as tendons that stick by friction
    unknown: OctoArmError | None = None


class DrivenArm:
    """An arm of which winches drive some tendons by length and the others by tension.

    Attributes:
        displacements: length reeled in [m] for each tendon that is driven by length, by name.
        tensions: last tensions of all tendons [N]; None before the first tensions.
        forgotten: number of times that the history of friction was discarded after a gap in time.
    """

    def __init__(self) -> None:
        """Drive all tendons by tension, without tensions so far."""
        self._newest_ns: dict[str, int] = {}  # newest stamp of tensions and of displacements
        self.forgotten = 0
        self.reset()

    def reset(self) -> None:
        """Forget tensions, displacements and shapes, but not the newest stamps."""
        self.displacements: dict[str, float] = {}
        self.tensions: FloatArray | None = None
        self._shape: Backbone | None = None  # the last one

    def change_config(self, before: Config, now: Config) -> list[str]:
        """Go on with the arm of ``now`` after the arm of ``before``.

        The shape is kept if both have the same balance, and tensions if both have the same
        tendons. Return a sentence about each input that is not used any more.
        """
        dropped = []
        unknown = [name for name in self.displacements if name not in now.arm.tendon_names]
        if unknown:
            self.displacements = {}
            dropped.append(f'displacements dropped: this arm has no tendon {unknown[0]}')
        elif self.displacements and before.displacement_type and not now.displacement_type:
            self.displacements = {}
            dropped.append('displacements dropped: displacement_type is not given any more')
        if self.tensions is not None:
            if now.arm.tendon_names == before.arm.tendon_names:
                self.tensions = self.tensions.reshape(now.arm.tension_shape)
            else:
                self.tensions = None
                if self.displacements:
                    dropped.append('tensions dropped: this arm has other tendons')
        if not now.has_balance_of(before):
            if self.has_history:
                dropped.append(
                    'friction history forgotten: arm, model, base, loads or stations have changed'
                )
            self._shape = None
        return dropped

    def answer(
        self,
        solver: Solver,
        config: Config,
        tip_wrench: FloatArray | None,
        time_ns: int,
        tensions: FloatArray | None = None,
        displacements: dict[str, float] | None = None,
        *,
        has_covariance: bool = True,
    ) -> Answer:
        """Return the shape after new ``tensions`` or ``displacements`` at ``time_ns`` [ns].

        They replace the last ones. The covariance of the tip is computed if ``has_covariance`` is
        true.

        Raises:
            OctoArmError: if there is no shape; everything stays as it was.
        """
        before = vars(self).copy()
        source = 'tensions' if displacements is None else 'displacements'
        self._recall(time_ns, config.friction_memory, source)
        if tensions is not None:
            self.tensions = tensions
        if displacements is not None:
            self.displacements = displacements
        try:
            return self._answer(solver, config, tip_wrench, has_covariance)
        except OctoArmError:
            vars(self).update(before)
            raise

    @property
    def has_history(self) -> bool:
        """Whether the last shape has a history of friction."""
        return self._shape is not None and self._shape.point_tensions is not None

    def _recall(self, time_ns: int, seconds: float, source: str) -> None:
        """Discard the last shape or its history if they are not valid at ``time_ns`` [ns].

        The shape is discarded if the time of a ``source`` goes back, as when a sequence starts
        over; stamps of tensions and displacements need not be ordered. After a gap of more than
        ``seconds`` [s] without stamps (0: no limit) the motion of the tendons in between is
        unknown: the shape is kept without its history, as if pulled from slack.
        """
        newest = self._newest_ns
        if time_ns < newest.get(source, time_ns):
            self._newest_ns, self._shape = {source: time_ns}, None
            return
        gap = time_ns - max(newest.values(), default=time_ns)
        self._newest_ns = {**newest, source: time_ns}
        if self._shape is not None and self.has_history and 0.0 < seconds < 1e-9 * gap:
            self.forgotten += 1
            # The shape is still the start of the continuation of a loaded arm.
            self._shape = replace(self._shape, point_tensions=None)

    def _answer(
        self, solver: Solver, config: Config, tip_wrench: FloatArray | None, has_covariance: bool
    ) -> Answer:
        tensions = np.zeros(config.arm.tension_shape) if self.tensions is None else self.tensions
        wound: Wound | None = None
        if not self.displacements:
            self._shape = shape = solver.follow(tensions, self._shape, tip_wrench)
        else:
            pairs = zip(config.arm.tendon_names, tensions.ravel().tolist(), strict=True)
            driven = {name: one for name, one in pairs if name not in self.displacements}
            wound = solve_displacements(
                solver, self.displacements, driven, self._shape, tip_wrench
            )
            self._shape = shape = wound.backbone
        if not has_covariance:
            return Answer(shape, None)
        try:
            if wound is None or not config.uncertainty.is_any:
                return Answer(shape, solver.tip_covariance(shape, config.uncertainty))
            sensitivity = wound_sensitivity(solver, wound)
            return Answer(shape, sensitivity.tip_covariance(config.uncertainty))
        except OctoArmError as error:
            return Answer(shape, None, error)
