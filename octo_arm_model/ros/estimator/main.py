"""The node ``octo_arm_estimator``: whatever is measured in, estimated shape and contact out.

As a managed node too, ``octo_arm_lifecycle_estimator``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node

from octo_arm_model.arm.errors import MeasurementError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.measurements import Tensions
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS, PREFIX, EstimatorSettings
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.ros.estimator.outputs import EstimatePublishers, EstimateStatus
from octo_arm_model.ros.node.diagnostics import SteppedClock
from octo_arm_model.ros.node.inputs import stamp_of
from octo_arm_model.ros.node.main import ManagedNode, ServedNode, run
from octo_arm_model.ros.node.server import Prepared, Server, describe
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.measurements import (
    MEASUREMENT_TOPICS,
    MeasuredArm,
    MeasurementMessage,
    displacements_of,
    tensions_of,
)
from octo_arm_model.wire.messages import Stamp

TABLE = (*PARAMETERS, *ESTIMATOR_PARAMETERS)
MODEL = 'exact'  # solves whatever the parameter says: it alone has loads


@dataclass(frozen=True)
class PreparedEstimator(Prepared):
    """An arm ready to be estimated, swapped as a whole.

    Its description is that of the arm alone, as it is solved; its solver is that of one
    hypothesis.

    Attributes:
        settings: what is estimated.
        models: of each hypothesis, by its name.
    """

    settings: EstimatorSettings
    models: Mapping[str, ArmModel]

    @classmethod
    def of(cls, values: dict[str, Any]) -> PreparedEstimator:
        """Prepare what ``values`` describe.

        Raises:
            OctoArmError: if they do not describe one; the message says why.
        """
        own = {name: value for name, value in values.items() if name.startswith(PREFIX)}
        arm = {name: value for name, value in values.items() if name not in own}
        arm['model'] = MODEL
        config, description = Config.from_parameters(arm), describe(arm)
        for kind in filter(None, (config.tension_type, config.displacement_type)):
            message_class(kind)
        settings = EstimatorSettings.from_parameters(own, config)
        models = settings.models(config)
        solver = next(iter(models.values())).solver
        prepared = cls(description, config, solver, settings, models)
        # What is compiled or loaded at its first use is so before messages come.
        rest = Tensions(np.zeros(len(config.arm.tendons)), settings.noise.tension)
        prepared.estimator().add(0, [rest]).estimate.pose_covariance  # noqa: B018
        return prepared

    def estimates_as(self, other: PreparedEstimator) -> bool:
        """Whether it makes of measurements what ``other`` does."""
        mine, theirs = (
            (one.settings, one.config.load_cells, one.config.base_frame) for one in (self, other)
        )
        return mine == theirs and self.config.has_balance_of(other.config)

    def estimator(self) -> Estimator:
        """An estimator of the arm that begins with the prior."""
        return Estimator.from_settings(self.settings, self.models, self.settings.window)


_BACK = 1.0  # [s] beyond the window by which the stamps of one sensor run back, to begin anew


class Stamps:
    """Resolves the stamps of measurements, and finds stamps that run back.

    Attributes:
        ahead: how far a stamp may be ahead of the clock [s].
    """

    def __init__(self, clock: SteppedClock) -> None:
        """Compare with ``clock``."""
        self._clock = clock
        self._newest: dict[str, Stamp] = {}
        self.ahead = 0.0

    def forget(self) -> None:
        """Begin anew."""
        self._newest.clear()

    def resolve(self, stamp: Stamp | None) -> Stamp:
        """The ``stamp`` of a message; the time of receipt where it has none.

        Raises:
            MessageError: if it is no time.
            MeasurementError: if it is ahead of the clock: all that is measured until then would be
                late.
        """
        at = self._clock.time_of(stamp)
        ahead = self._clock.ahead(at, self._clock.now_ns)
        if ahead > self.ahead:
            raise MeasurementError(
                f'its stamp is {ahead:.6g} s ahead of the clock, expected at most '
                f'{self.ahead:g} s (diagnostics.ahead_limit)'
            )
        return at

    def runs_back(self, topic: str, stamp: Stamp, window: float) -> float:
        """By how much the stamps of ``topic`` run back [s]; 0 where they are at most late.

        As they do where a bag is played again.
        """
        newest = self._newest.get(topic, stamp)
        self._newest[topic] = max(stamp, newest)
        back = 1e-9 * (newest.ns - stamp.ns)
        return back if back > window + _BACK else 0.0


class EstimatorServer(Server[PreparedEstimator, EstimatePublishers]):
    """Answers measurements with estimates, of an arm of which nothing is known when activated."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``.

        Raises:
            ConfigError: if a value is of another type than ROS needs.
        """
        super().__init__(node, TABLE, PreparedEstimator.of, EstimatePublishers)
        self._estimator: Estimator | None = None
        self._measured: MeasuredArm | None = None
        self._newest = Stamp(0, 0)
        self._status = EstimateStatus(node)
        self._diagnostics.parts.append(self._status.report)
        self._stamps = Stamps(self._diagnostics.clock)

    def _open(self) -> None:
        self._begin_anew()
        for topic, message in MEASUREMENT_TOPICS.items():
            self._inputs.subscribe(
                message_class(message.type_name), topic, partial(self._measure, message)
            )

    def _measure(self, message: MeasurementMessage, topic: str, given: Any) -> None:
        measurement = message.read(given, self._measured_arm())
        self._take(topic, Stamp.of(given.header.stamp), measurement)

    def _close(self) -> None:
        self._estimator = None
        self._status.follow(None, None)

    def _change_arm(self, before: PreparedEstimator | None, now: PreparedEstimator) -> None:
        config, settings = now.config, now.settings

        def pose_of(frame: str, stamp_ns: int) -> Pose:
            return self._frames.pose_of(frame, config.base_frame, stamp_ns)

        self._measured = MeasuredArm(config, settings.noise, pose_of)
        self._stamps.ahead = config.diagnostic_limits.ahead_limit
        if before is None or not now.estimates_as(before):
            self._inputs.forget()
            if self._estimator is not None:
                self._begin_anew()
        self._node.get_logger().info(
            f'{config.arm.length} m in {config.base_frame}, contact: '
            + '; '.join([', '.join(now.models), *settings.notes])
        )

    def cleanup(self, state: str = 'unconfigured') -> None:
        """Free the arm and what is known of it."""
        super().cleanup(state)
        self._measured = None

    def _begin_anew(self) -> Estimator:
        self._estimator = estimator = self._arm.estimator()
        self._newest = Stamp(0, 0)
        self._stamps.forget()
        self._status.follow(estimator, self._arm.config)
        return estimator

    def _measured_arm(self) -> MeasuredArm:
        assert self._measured is not None  # of the present arm
        return self._measured

    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        measurement = tensions_of(readings, self._measured_arm())
        self._take(topic, stamp, measurement, is_tensions=True)

    def _on_motors(self, field: str, topic: str, message: Any) -> None:
        measurement = displacements_of(message, self._measured_arm(), field)
        self._take(topic, stamp_of(message), measurement)

    def _take(
        self,
        topic: str,
        stamp: Stamp | None,
        measurement: Measurement,
        *,
        is_tensions: bool = False,
    ) -> None:
        """Correct the estimate by a ``measurement`` and publish it; OctoArmError if refused."""
        estimator = self._estimator
        assert estimator is not None
        self._diagnostics.received(topic, stamp, is_tensions=is_tensions)
        at = self._stamps.resolve(stamp)
        if back := self._stamps.runs_back(topic, at, self._arm.settings.window):
            words = f'stamps run back by {back:.3g} s; the estimate begins anew'
            self._refusal_log.say(topic, words)
            self._status.ran_back(topic)
            estimator = self._begin_anew()
        began = time.perf_counter()
        found = estimator.add(at.ns, [measurement])
        duration = time.perf_counter() - began
        arm, outbox = self._arm, self._publishers
        assert outbox is not None
        self._newest = max(self._newest, at)
        if found.begins_anew:
            words = (
                'the estimate begins anew: sensors have contradicted it for '
                f'{arm.settings.rules.recover_after:g} s (estimator.recover_after)'
            )
            self._refusal_log.say(topic, words)
        outbox.describe(arm.models[found.hypothesis].solver, arm.config)
        outbox.publish_estimate(found.estimate, self._newest)
        self._diagnostics.answered(found.estimate.backbone, duration)
        self._status.add(found, self._newest.ns)
        self._tell_of_refused(found)

    def _refuse(self, topic: str, error: OctoArmError) -> None:
        super()._refuse(topic, error)
        self._status.refused(topic, error)

    def _tell_of_refused(self, found: EstimatorOutput) -> None:
        """Warn of sensors that are not believed, by their names."""
        for one in found.innovations:
            if not one.is_accepted:
                limit = chi_square_limit(self._arm.settings.rules.gate, one.value.size)
                is_now = one.normalised_square > limit
                why = 'contradicts the estimate by' if is_now else 'is still doubted, now with'
                error = MeasurementError(
                    f'it {why} a normalised square of {one.normalised_square:.3g} in '
                    f'{one.value.size} number(s)'
                )
                self._refusal_log.warn(one.name, error)


NAME = 'octo_arm_estimator'
# Publish the estimate of the arm for the measurements they receive.
EstimatorNode = partial(ServedNode, NAME, EstimatorServer)
ManagedEstimatorNode = partial(ManagedNode, NAME, EstimatorServer)
main = partial(run, NAME, EstimatorNode)
managed = partial(run, 'octo_arm_lifecycle_estimator', ManagedEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
