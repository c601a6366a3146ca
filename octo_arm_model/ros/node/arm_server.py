"""Answers tensions with the shape of the arm, for the plain and the managed node."""

from __future__ import annotations

import time

from octo_arm_msgs.srv import FindTensions, Solve
from rclpy.node import Node
from sensor_msgs.msg import JointState

from octo_arm_model.analysis.wound_sequence import WoundSequence
from octo_arm_model.config.config import Config, parameters_as_yaml
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.core.friction_memory import FrictionMemory
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.ros.live_parameters import LiveParameters
from octo_arm_model.ros.node.backbone_publishers import BackbonePublishers
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.prepared_arm import Prepared
from octo_arm_model.ros.node.queued_service import QueuedService, Steps
from octo_arm_model.ros.node.services import answer_find_tensions, answer_solve
from octo_arm_model.ros.node.tension_inputs import TensionInputs, field_of
from octo_arm_model.ros.node.tension_subscription import LatestSubscription, TensionInput
from octo_arm_model.ros.node.tip_wrench import TipWrench
from octo_arm_model.ros.node.work_queue import WorkQueue
from octo_arm_model.ros.qos import check_overrides
from octo_arm_model.ros.refusal_log import RefusalLog
from octo_arm_model.wire import displacement_messages
from octo_arm_model.wire.stamp import Stamp


class ArmServer:
    """Answers tensions on behalf of a node.

    ``configure`` loads the arm, ``activate`` starts answering, ``deactivate`` stops and
    ``cleanup`` frees what ``configure`` took.
    """

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``."""
        self._node = node
        self._live = LiveParameters(node, PARAMETERS, Prepared.of, self._use)
        self._prepared: Prepared | None = None
        self._diagnostics = Diagnostics(node)
        self._diagnostics.end('unconfigured')
        self._refusal_log = RefusalLog(node)
        self._services: list[QueuedService] = []
        self._work = WorkQueue(node)
        self._inputs = TensionInputs(
            node, self._work, self._diagnostics, self._config, self._answer
        )
        self._tip_wrench = TipWrench(node, self._work, self._current, self._refuse)
        self._publishers: BackbonePublishers | None = None
        self._winches: LatestSubscription | None = None
        self._memory = self._diagnostics.memory = FrictionMemory()
        self._winding = WoundSequence(self._memory)

    def configure(self) -> None:
        """Load and validate the arm.

        Raises:
            ConfigError: if a parameter is missing, unknown or of the wrong type, or they do not go
                together.
            ArmDefinitionError: if the arm cannot exist.
        """
        self._publishers = BackbonePublishers(self._node)
        self._live.begin()
        self._diagnostics.end('inactive')

    def activate(self) -> None:
        """Start answering.

        Raises:
            ConfigError: if an override of a QoS policy cannot be.
        """
        node = self._node
        self._inputs.open()
        self._diagnostics.begin()
        self._tip_wrench.open()
        self._winches = LatestSubscription(
            node, JointState, displacement_messages.TOPIC, self._on_displacements, self._work
        )
        self._diagnostics.apart = frozenset({self._winches.topic})
        self._services = [
            QueuedService(node, Solve, 'solve', self._on_solve, self._work),
            QueuedService(node, FindTensions, 'find_tensions', self._on_find_tensions, self._work),
        ]
        check_overrides(node)

    def deactivate(self) -> None:
        """Stop answering."""
        self._inputs.close()
        self._tip_wrench.close()
        if self._winches is not None:
            self._winches.close()
        for service in self._services:
            service.close()
        self._work.clear()
        self._services, self._winches = [], None
        if self._publishers is not None:
            self._publishers.pause()
        self._diagnostics.end('inactive')
        self._winding = WoundSequence(self._memory)

    def cleanup(self) -> None:
        """Free the arm and its publishers."""
        self._live.end()
        if self._publishers is not None:
            self._publishers.close()
        self._publishers = self._prepared = None
        self._diagnostics.end('unconfigured')

    def _use(self, prepared: Prepared, names: set[str]) -> None:
        """Answer with the arm ``prepared`` from now on, between two messages."""
        assert self._publishers is not None
        config = prepared.config
        self._tip_wrench.change_arm(self._prepared, prepared)
        before, self._prepared = self._prepared, prepared
        if before is not None and field_of(before.config) != field_of(config):
            self._inputs.change_field()
        if gone := self._winding.change_arm(config.arm):
            self._node.get_logger().warning(
                f'displacements dropped: this arm has no tendon {gone[0]}'
            )
        self._diagnostics.model, self._diagnostics.limits = config.model, config.diagnostic_limits
        self._diagnostics.is_compiled = prepared.solver.is_compiled
        self._publishers.describe(prepared.solver, config)
        self._publishers.announce(parameters_as_yaml(prepared.values))
        how = ' (compiled)' if prepared.solver.is_compiled else ''
        self._node.get_logger().info(
            f'{config.model}{how}, {len(config.arm.sections)} section(s), {config.arm.length} m, '
            f'{config.stations} stations in {config.base_frame}; tendons from the tip: '
            + ' '.join(config.arm.tendon_names)
        )

    def _current(self) -> Prepared | None:
        return self._prepared

    def _config(self) -> Config | None:
        return None if self._prepared is None else self._prepared.config

    def _answer(self, given: TensionInput) -> None:
        if given.older:
            self._diagnostics.skipped(given.older)
        self._tip_wrench.update()
        prepared, outbox = self._prepared, self._publishers
        if prepared is None or outbox is None:
            return
        if isinstance(given.tensions, OctoArmError):
            self._refuse(given.topic, given.tensions)
            return
        self._publish_shape(given.topic, given.stamp, readings=given.tensions)

    def _publish_shape(
        self,
        topic: str,
        stamp: Stamp | None,
        readings: FloatArray | None = None,
        displacements: dict[str, float] | None = None,
    ) -> None:
        """Answer ``readings`` of load cells or ``displacements`` that came on ``topic``."""
        prepared, outbox, winding = self._prepared, self._publishers, self._winding
        assert prepared is not None and outbox is not None
        config = prepared.config
        try:
            self._diagnostics.received(topic, stamp)
            at = self._stamp(stamp)
            began = time.perf_counter()
            tensions = None
            if readings is not None:
                tensions = config.load_cells.tensions(config.arm, readings)
            answer = winding.answer(
                prepared.solver, config, self._tip_wrench.value, at.ns, tensions, displacements
            )
            duration = time.perf_counter() - began
        except OctoArmError as error:
            self._refuse(topic, error)
            return
        outbox.publish(answer.backbone, answer.covariance, at)
        if winding.displacements:
            outbox.publish_estimates(answer.backbone, at)
        self._diagnostics.answered(answer.backbone, duration)

    def _on_displacements(self, data: bytes, older: int) -> None:
        """Drive the named tendons by length from now on, and the others by tension."""
        prepared, winches = self._prepared, self._winches
        if prepared is None or winches is None:
            return
        if older:
            self._diagnostics.skipped(older)
        self._tip_wrench.update()
        try:
            message = winches.decode(data)
            found = displacement_messages.read_displacements(message, prepared.config.arm)
        except OctoArmError as error:
            self._refuse(winches.topic, error)
            return
        self._publish_shape(winches.topic, Stamp.of(message.header.stamp), displacements=found)

    def _on_solve(self, request: Solve.Request, response: Solve.Response) -> Steps:
        assert self._prepared is not None
        frame = self._prepared.config.base_frame
        return answer_solve(request, response, self._prepared.solver, frame)

    def _on_find_tensions(
        self, request: FindTensions.Request, response: FindTensions.Response
    ) -> Steps:
        assert self._prepared is not None
        now = self._node.get_clock().now().to_msg()
        frame = self._prepared.config.base_frame
        return answer_find_tensions(request, response, self._prepared.solver, frame, now)

    def _refuse(self, topic: str, error: OctoArmError) -> None:
        self._diagnostics.refused(topic, error)
        self._refusal_log.warn(topic, error)

    def _stamp(self, stamp: Stamp | None) -> Stamp:
        """The ``stamp`` of the input; the time of receipt where it has none or an unset one."""
        if stamp is not None and any(stamp):
            return stamp
        return Stamp(*self._node.get_clock().now().seconds_nanoseconds())
