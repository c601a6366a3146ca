"""The node ``octo_arm_estimator``: estimates shape and contact from any measurements.

``octo_arm_lifecycle_estimator`` is the same as a managed node.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.measurements import Tensions
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS, PREFIX, EstimatorSettings
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.ros.estimator.outputs import EstimatePublishers, EstimateStatus
from octo_arm_model.ros.node.inputs import stamp_of
from octo_arm_model.ros.node.main import ManagedNode, ServedNode, run
from octo_arm_model.ros.node.server import Prepared, Server, described
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.measurements import (
    MEASUREMENT_TOPICS,
    MeasuredArm,
    displacements_of,
    tensions_of,
)
from octo_arm_model.wire.messages import Stamp

TABLE = (*PARAMETERS, *ESTIMATOR_PARAMETERS)
_MODEL_PARAMETER = next(parameter for parameter in PARAMETERS if parameter.name == 'model')
MODEL = 'exact'  # used whatever the parameter says, because it alone has loads


@dataclass(frozen=True)
class PreparedEstimator(Prepared):
    """An arm ready to be estimated; a change of parameters replaces it as a whole.

    Its description is that of the arm without the settings of the estimator; its solver is that of
    the first hypothesis.

    Attributes:
        settings: settings of the estimator.
        models: model of each hypothesis, by its name.
    """

    settings: EstimatorSettings
    models: Mapping[str, ArmModel]

    @classmethod
    def of(cls, values: dict[str, Any]) -> PreparedEstimator:
        """Prepare the arm and its estimator; OctoArmError if ``values`` do not describe them."""
        estimation = {name: value for name, value in values.items() if name.startswith(PREFIX)}
        arm = {name: value for name, value in values.items() if name not in estimation}
        _MODEL_PARAMETER.check(arm['model'])
        arm['model'] = MODEL
        description, config = described(arm)
        settings = EstimatorSettings.from_parameters(estimation, config)
        models = settings.models(config)
        solver = next(iter(models.values())).solver
        prepared = cls(description, config, solver, settings, models)
        # A first update compiles and loads what messages need, before the first one comes.
        rest = Tensions(np.zeros(len(config.arm.tendons)), settings.tension_stddev)
        prepared.estimator().add(0, [rest]).estimate.pose_covariance  # noqa: B018
        return prepared

    def estimates_as(self, other: PreparedEstimator) -> bool:
        """Whether the same measurements give the same estimate as with ``other``."""
        names = 'uncertainty', 'load_cells', 'encoders', 'base_frame'
        is_same = all(getattr(self.config, name) == getattr(other.config, name) for name in names)
        return (
            is_same
            and self.settings == other.settings
            and self.config.has_balance_of(other.config)
        )

    def estimator(self) -> Estimator:
        """Return an estimator of the arm in the state of the prior."""
        given = self.settings.given
        return Estimator(self.models, self.settings.rules, given.window, given.change_time)


_BACK = 1.0  # [s] beyond the window; stamps that run back further reset the estimate


class EstimatorServer(Server[PreparedEstimator, EstimatePublishers]):
    """Publishes an estimate after each measurement; activation resets it to the prior."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``; ConfigError if a value has the wrong type."""
        super().__init__(node, TABLE, PreparedEstimator.of, EstimatePublishers)
        self._estimator: Estimator | None = None
        self._newest: dict[str, Stamp] = {}  # of the measurements in the estimate, by topic
        self._status = EstimateStatus()
        self._diagnostics.parts.append(self._status.report)

    def _open(self) -> None:
        self._reset_estimate()
        for topic, message in MEASUREMENT_TOPICS.items():
            self._inputs.subscribe(
                message_class(message.type_name), topic, partial(self._measure, message.read)
            )

    def _measure(self, read: Callable[..., Measurement], topic: str, message: Any) -> None:
        self._take(topic, stamp_of(message), read(message, self._measured_arm()))

    def _close(self) -> None:
        self._estimator = None
        self._status.follow(None, None)

    def _change_arm(self, previous: PreparedEstimator | None, arm: PreparedEstimator) -> None:
        config, settings = arm.config, arm.settings
        if previous is not None and self._estimator is not None and not arm.estimates_as(previous):
            self._reset_estimate()
        self._node.get_logger().info(
            f'{config.arm.length} m in {config.base_frame}, contact: '
            + '; '.join([', '.join(arm.models), *settings.notes])
        )

    def _reset_estimate(self) -> Estimator:
        self._estimator = estimator = self._arm.estimator()
        self._newest = {}
        self._status.follow(estimator, self._arm.config)
        return estimator

    def _measured_arm(self) -> MeasuredArm:
        config = self._arm.config
        return MeasuredArm(
            config,
            self._arm.settings,
            lambda frame, stamp_ns: self._frames.pose_of(frame, config.base_frame, stamp_ns),
        )

    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        self._take(topic, stamp, tensions_of(readings, self._measured_arm()), is_tensions=True)

    def _on_motors(self, field: str, topic: str, message: Any) -> None:
        self._measure(partial(displacements_of, field=field), topic, message)

    def _take(
        self,
        topic: str,
        stamp: Stamp | None,
        measurement: Measurement,
        *,
        is_tensions: bool = False,
    ) -> None:
        """Update the estimate by a ``measurement`` and publish it; OctoArmError if refused."""
        estimator = self._estimator
        assert estimator is not None
        self._diagnostics.received(topic, stamp, is_tensions=is_tensions)
        resolved = self._resolved(stamp)
        step_back = 1e-9 * (self._newest.get(topic, resolved).ns - resolved.ns)
        if step_back > self._arm.settings.given.window + _BACK:  # as when a bag is played again
            words = f'stamps run back by {step_back:.3g} s; the estimate is reset'
            self._diagnostics.log.add(topic, words)
            self._status.ran_back(topic)
            estimator = self._reset_estimate()
        start = time.perf_counter()
        update = estimator.add(resolved.ns, [measurement])
        duration = time.perf_counter() - start
        arm, outbox = self._arm, self._publishers
        assert outbox is not None
        self._newest[topic] = max(resolved, self._newest.get(topic, resolved))
        newest = max(self._newest.values())
        if update.begins_anew:
            words = (
                'the estimate is reset: sensors have contradicted it for '
                f'{arm.settings.rules.recover_after:g} s (estimator.recover_after)'
            )
            self._diagnostics.log.add(topic, words)
        outbox.describe(arm.models[update.hypothesis].solver, arm.config)
        outbox.publish_estimate(update.estimate, newest)
        self._diagnostics.answered(update.estimate.backbone, duration)
        self._status.add(update, newest.ns)
        self._warn_of_rejected(update)

    def _resolved(self, stamp: Stamp | None) -> Stamp:
        """Return the ``stamp`` of a message, or the time of receipt if it has none.

        MessageError if it is no valid time; MeasurementError if it is ahead of the clock: all
        measurements until that time would then count as late.
        """
        clock, limit = self._diagnostics.clock, self._arm.config.diagnostic_limits.ahead_limit
        resolved = clock.time_of(stamp)
        if (ahead := clock.ahead(resolved, clock.now_ns)) > limit:
            raise MeasurementError(
                f'its stamp is {ahead:.6g} s ahead of the clock, expected at most {limit:g} s '
                '(diagnostics.ahead_limit)'
            )
        return resolved

    def _warn_of_rejected(self, update: EstimatorOutput) -> None:
        """Log each sensor whose measurement the gate has rejected."""
        for innovation in update.innovations:
            if not innovation.is_accepted:
                square, size = innovation.normalised_square, innovation.value.size
                is_beyond = square > chi_square_limit(self._arm.settings.rules.gate, size)
                why = 'contradicts the estimate by' if is_beyond else 'is still doubted, now with'
                words = f'it {why} a normalised square of {square:.3g} in {size} number(s)'
                self._diagnostics.log.add(f'{innovation.name} refused', words)


NAME = 'octo_arm_estimator'
# Both nodes publish an estimate for each measurement they receive.
EstimatorNode = partial(ServedNode, NAME, EstimatorServer)
ManagedEstimatorNode = partial(ManagedNode, NAME, EstimatorServer)
main = partial(run, NAME, EstimatorNode)
managed = partial(run, 'octo_arm_lifecycle_estimator', ManagedEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
