"""Answers measurements with the estimate of an arm, for the plain and the managed node."""

from __future__ import annotations

import time

from rclpy.node import Node

from octo_arm_model.config.config import Config, parameters_as_yaml
from octo_arm_model.core.errors import MeasurementError, OctoArmError
from octo_arm_model.core.rod.kinematics import Pose
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.tracker import Tracked, Tracker
from octo_arm_model.ros.estimator.estimate_status import EstimateStatus
from octo_arm_model.ros.estimator.measurement_inputs import MeasurementInputs
from octo_arm_model.ros.estimator.prepared import TABLE, PreparedEstimator
from octo_arm_model.ros.estimator.publishers import EstimatePublishers
from octo_arm_model.ros.estimator.sensor_frames import SensorFrames
from octo_arm_model.ros.estimator.stamps import Stamps
from octo_arm_model.ros.live_parameters import LiveParameters
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.tension_inputs import TensionInputs, field_of
from octo_arm_model.ros.node.tension_subscription import TensionInput
from octo_arm_model.ros.node.work_queue import WorkQueue
from octo_arm_model.ros.qos import check_overrides
from octo_arm_model.ros.refusal_log import RefusalLog
from octo_arm_model.wire.measurement_messages import MeasuredArm, tensions_of
from octo_arm_model.wire.stamp import Stamp


class EstimatorServer:
    """Answers measurements on behalf of a node; its methods are those of `ArmServer`."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``."""
        self._node = node
        self._live = LiveParameters(node, TABLE, PreparedEstimator.of, self._use)
        self._prepared: PreparedEstimator | None = None
        self._tracker: Tracker | None = None
        self._measured: MeasuredArm | None = None
        self._newest = Stamp(0, 0)
        self._diagnostics = Diagnostics(node)
        self._diagnostics.end('unconfigured')
        self._status = EstimateStatus(node)
        self._diagnostics.parts.append(self._status.report)
        self._refusal_log = RefusalLog(node)
        self._stamps = Stamps(node)
        self._work = WorkQueue(node)
        self._tensions = TensionInputs(
            node, self._work, self._diagnostics, self._config, self._on_tensions
        )
        self._others = MeasurementInputs(node, self._work, self._arm, self._take, self._refuse)
        self._frames = SensorFrames(node)
        self._publishers: EstimatePublishers | None = None

    def configure(self) -> None:
        """Load and validate the arm and what is estimated of it.

        Raises:
            OctoArmError: if a parameter is missing, unknown, of the wrong type or impossible, or
                they do not go together.
        """
        self._publishers = EstimatePublishers(self._node)
        self._live.begin()
        self._diagnostics.end('inactive')

    def activate(self) -> None:
        """Start answering, knowing nothing.

        Raises:
            ConfigError: if an override of a QoS policy cannot be.
        """
        self._begin_anew()
        self._tensions.open()
        self._others.open()
        others = self._others.publishers
        self._diagnostics.apart = frozenset(others)
        self._diagnostics.publishers |= others
        self._diagnostics.begin()
        check_overrides(self._node)

    def deactivate(self) -> None:
        """Stop answering."""
        self._tensions.close()
        self._others.close()
        self._frames.close()
        self._work.clear()
        self._tracker = None
        self._status.follow(None, None)
        if self._publishers is not None:
            self._publishers.backbone.pause()
        self._diagnostics.end('inactive')

    def cleanup(self) -> None:
        """Free the arm and its publishers."""
        self._live.end()
        if self._publishers is not None:
            self._publishers.close()
        self._publishers = self._prepared = self._measured = None
        self._diagnostics.end('unconfigured')

    def _use(self, prepared: PreparedEstimator, names: set[str]) -> None:
        """Estimate the arm ``prepared`` from now on, anew."""
        assert self._publishers is not None
        config, settings = prepared.config, prepared.settings
        before, self._prepared = self._prepared, prepared
        if before is not None and field_of(before.config) != field_of(config):
            self._tensions.change_field()

        def pose_of(frame: str, stamp_ns: int) -> Pose:
            return self._frames.pose_of(frame, config.base_frame, stamp_ns)

        self._measured = MeasuredArm(config, settings.noise, pose_of)
        self._stamps.ahead = config.diagnostic_limits.ahead
        solver = next(iter(prepared.models.values())).solver
        self._diagnostics.model = solver.model
        self._diagnostics.limits = config.diagnostic_limits
        self._diagnostics.is_compiled = solver.is_compiled
        self._publishers.describe(solver, config)
        self._publishers.backbone.announce(parameters_as_yaml(prepared.description))
        if self._tracker is not None:
            self._begin_anew()
        self._node.get_logger().info(
            f'{config.arm.length} m in {config.base_frame}, contact: '
            + '; '.join([', '.join(prepared.models), *settings.notes])
        )

    def _begin_anew(self) -> Tracker:
        assert self._prepared is not None
        self._tracker = tracker = self._prepared.tracker()
        self._newest = Stamp(0, 0)
        self._stamps.forget()
        self._status.follow(tracker, self._prepared.config)
        return tracker

    def _config(self) -> Config | None:
        return None if self._prepared is None else self._prepared.config

    def _arm(self) -> MeasuredArm | None:
        return self._measured

    def _on_tensions(self, given: TensionInput) -> None:
        measured = self._measured
        if measured is None:
            return
        if isinstance(given.tensions, OctoArmError):
            self._refuse(given.topic, given.tensions)
            return
        try:
            measurement = tensions_of(given.tensions, measured)
        except OctoArmError as error:
            self._refuse(given.topic, error)
            return
        self._take(given.topic, given.stamp, measurement, given.older)

    def _take(self, topic: str, stamp: Stamp | None, measurement: Measurement, older: int) -> None:
        """Correct the estimate by a ``measurement`` that came on ``topic`` and publish it."""
        if older:
            self._diagnostics.skipped(older)
        tracker, prepared, outbox = self._tracker, self._prepared, self._publishers
        if tracker is None or prepared is None or outbox is None:
            return
        try:
            self._diagnostics.received(topic, stamp)
            at = self._stamps.resolve(topic, stamp)
            if back := self._stamps.runs_back(topic, at, prepared.settings.window):
                self._node.get_logger().warning(
                    f'{topic}: stamps run back by {back:.3g} s; the estimate begins anew'
                )
                tracker = self._begin_anew()
            began = time.perf_counter()
            tracked = tracker.add(at.ns, [measurement])
            duration = time.perf_counter() - began
        except OctoArmError as error:
            self._refuse(topic, error)
            return
        self._newest = max(self._newest, at)
        if tracked.begins_anew:
            self._node.get_logger().warning(
                f'{topic}: the estimate begins anew: sensors have contradicted it for '
                f'{prepared.settings.recover_after:g} s, and agree with each other '
                '(estimator.recover_after)'
            )
        outbox.describe(prepared.models[tracked.hypothesis].solver, prepared.config)
        outbox.publish(tracked.estimate, self._newest)
        self._diagnostics.answered(tracked.estimate.backbone, duration)
        self._status.add(topic, tracked)
        self._tell_of_refused(topic, tracked)

    def _tell_of_refused(self, topic: str, tracked: Tracked) -> None:
        """Warn of measurements that the gate refused."""
        for one in tracked.innovations:
            if not one.is_accepted:
                error = MeasurementError(
                    f'it contradicts the estimate: {one.name} off by a normalised square of '
                    f'{one.normalised_square:.3g} in {one.value.size} number(s) (estimator.gate)'
                )
                self._refusal_log.warn(topic, error)

    def _refuse(self, topic: str, error: OctoArmError) -> None:
        self._diagnostics.refused(topic, error)
        self._refusal_log.warn(topic, error)
