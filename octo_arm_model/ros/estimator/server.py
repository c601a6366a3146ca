"""Answers measurements with the estimate of an arm, for the plain and the managed node."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from octo_arm_model.arm.errors import MeasurementError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.tracker import Tracked, Tracker
from octo_arm_model.ros.estimator.estimate_status import EstimateStatus
from octo_arm_model.ros.estimator.prepared import TABLE, PreparedEstimator
from octo_arm_model.ros.estimator.publishers import EstimatePublishers
from octo_arm_model.ros.estimator.sensor_frames import SensorFrames
from octo_arm_model.ros.estimator.stamps import Stamps
from octo_arm_model.ros.estimator.waiting_messages import WaitingMessages
from octo_arm_model.ros.messages import decoded, message_class
from octo_arm_model.ros.node.inputs import LatestSubscription
from octo_arm_model.ros.node.server import Server
from octo_arm_model.ros.work import SLICE, SlicedCall, Steps
from octo_arm_model.wire.measurements import (
    MEASUREMENT_TOPICS,
    MeasuredArm,
    MeasurementMessage,
    tensions_of,
)
from octo_arm_model.wire.stamp import Stamp


class EstimatorServer(Server[PreparedEstimator, EstimatePublishers]):
    """Answers measurements with estimates, of an arm of which nothing is known when activated."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``.

        Raises:
            ConfigError: if a value is of another type than ROS needs.
        """
        super().__init__(node, TABLE, PreparedEstimator.of, EstimatePublishers)
        self._tracker: Tracker | None = None
        self._measured: MeasuredArm | None = None
        self._newest = Stamp(0, 0)
        self._status = EstimateStatus(node)
        self._diagnostics.parts.append(self._status.report)
        self._stamps = Stamps(self._diagnostics.clock)
        self._others: list[LatestSubscription] = []
        self._frames = SensorFrames(node)
        self._waiting = WaitingMessages(self._intake, self._frames)
        self._under_way: tuple[str, Steps] | None = None

    def _open(self) -> None:
        self._begin_anew()
        self._frames.open()
        self._waiting.open()
        for topic, message in MEASUREMENT_TOPICS.items():
            # One by one: where the next cannot be, `_close` ends those before it.
            self._others.append(self._subscribe(topic, message))
        publishers = {one.topic: one.count_publishers for one in self._others}
        self._diagnostics.publishers |= publishers
        self._diagnostics.heard.apart = frozenset(publishers)

    def _subscribe(self, topic: str, message: MeasurementMessage) -> LatestSubscription:
        kind = message_class(message.type_name)

        def read(data: bytes) -> None:
            given = decoded(data, kind)
            measurement = message.read(given, self._measured_arm())
            self._take(made.topic, Stamp.of(given.header.stamp), measurement)

        def take(data: bytes) -> None:
            self._waiting.take(made.topic, data, read)

        made = LatestSubscription(self._intake, kind, topic, take)
        return made

    def _close(self) -> None:
        for subscription in self._others:
            subscription.close()
        self._others = []
        self._waiting.close()
        self._frames.close()
        self._drop_under_way()
        self._tracker = None
        self._status.follow(None, None)

    def _change_arm(self, before: PreparedEstimator | None, now: PreparedEstimator) -> None:
        config, settings = now.config, now.settings

        def pose_of(frame: str, stamp_ns: int) -> Pose:
            return self._frames.pose_of(frame, config.base_frame, stamp_ns)

        self._measured = MeasuredArm(config, settings.noise, pose_of)
        self._stamps.ahead = config.diagnostic_limits.ahead_limit
        if before is None or not now.estimates_as(before):
            self._waiting.forget()
            if self._tracker is not None:
                self._begin_anew()
        self._node.get_logger().info(
            f'{config.arm.length} m in {config.base_frame}, contact: '
            + '; '.join([', '.join(now.models), *settings.notes])
        )

    def cleanup(self) -> None:
        """Free the arm and what is known of it."""
        super().cleanup()
        self._measured = None

    def _begin_anew(self) -> Tracker:
        self._drop_under_way()
        self._tracker = tracker = self._arm.tracker()
        self._newest = Stamp(0, 0)
        self._stamps.forget()
        self._status.follow(tracker, self._arm.config)
        return tracker

    def _measured_arm(self) -> MeasuredArm:
        assert self._measured is not None  # of the present arm
        return self._measured

    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        self._take(topic, stamp, tensions_of(readings, self._measured_arm()))

    def _take(self, topic: str, stamp: Stamp | None, measurement: Measurement) -> None:
        """Begin to correct the estimate by a ``measurement``; OctoArmError if refused at once."""
        tracker = self._tracker
        assert tracker is not None and self._under_way is None
        self._diagnostics.received(topic, stamp)
        at = self._stamps.resolve(stamp)
        if back := self._stamps.runs_back(topic, at, self._arm.settings.window):
            words = f'stamps run back by {back:.3g} s; the estimate begins anew'
            self._refusal_log.say(topic, words)
            self._status.ran_back(topic)
            tracker = self._begin_anew()
        self._under_way = topic, self._correct(tracker, topic, at, measurement)
        self._go_on()

    def _go_on(self) -> bool:
        """Do the next slice of the correction under way, before what else is due.

        Sensors contradict each other in such ways that one takes many seconds. The next message
        waits for all of it, requests for parameters only for a slice.
        """
        if self._under_way is None:
            return False  # dropped meanwhile
        topic, steps = self._under_way
        self._under_way = None
        try:
            next(steps)
        except StopIteration:
            return False
        except OctoArmError as error:
            self._refuse(topic, error)
            return False
        self._under_way = topic, steps
        self._work.add_first(self._go_on)
        return False

    def _drop_under_way(self) -> None:
        """End a correction in the midst of it: its tracker is given up."""
        if self._under_way is not None:
            _, steps = self._under_way
            self._under_way = None
            steps.close()

    def _correct(self, tracker: Tracker, topic: str, at: Stamp, measurement: Measurement) -> Steps:
        """Correct the estimate and publish it, yielding in the midst; OctoArmError if refused."""

        def add(pause: Callable[[], None]) -> Tracked:
            return tracker.add(at.ns, [measurement], pause)

        began = time.perf_counter()
        tracked = yield from SlicedCall(add, SLICE).steps()
        duration = time.perf_counter() - began
        arm, outbox = self._arm, self._publishers  # perhaps changed meanwhile
        assert outbox is not None
        self._newest = max(self._newest, at)
        if tracked.begins_anew:
            words = (
                'the estimate begins anew: sensors have contradicted it for '
                f'{arm.settings.recover_after:g} s, and agree with each other '
                '(estimator.recover_after)'
            )
            self._refusal_log.say(topic, words)
        outbox.describe(arm.models[tracked.hypothesis].solver, arm.config)
        outbox.publish_estimate(tracked.estimate, self._newest)
        self._diagnostics.answered(tracked.estimate.backbone, duration)
        self._status.add(tracked)
        self._tell_of_refused(topic, tracked)

    def _refuse(self, topic: str, error: OctoArmError) -> None:
        super()._refuse(topic, error)
        self._status.refused(topic, error)

    def _tell_of_refused(self, topic: str, tracked: Tracked) -> None:
        """Warn of measurements that the gate refused."""
        for one in tracked.innovations:
            if not one.is_accepted:
                error = MeasurementError(
                    f'it contradicts the estimate: {one.name} off by a normalised square of '
                    f'{one.normalised_square:.3g} in {one.value.size} number(s) (estimator.gate)'
                )
                self._refusal_log.warn(topic, error)
