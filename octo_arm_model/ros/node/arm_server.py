"""Answers tensions with the shape of the arm, for the plain and the managed node."""

from __future__ import annotations

import contextlib
import time
from typing import Any, NamedTuple

from geometry_msgs.msg import WrenchStamped
from octo_arm_msgs.srv import FindTensions, Solve
from rclpy.node import Node
from sensor_msgs.msg import JointState

from octo_arm_model.config.config import Config, parameters_as_yaml
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ContinuationError, OctoArmError
from octo_arm_model.core.follower import FrictionMemory
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.solver import Solver
from octo_arm_model.ros.live_parameters import LiveParameters
from octo_arm_model.ros.messages import wrench_from_stamped
from octo_arm_model.ros.node.backbone_publishers import BackbonePublishers
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.queued_service import QueuedService, Steps
from octo_arm_model.ros.node.services import answer_find_tensions, answer_solve
from octo_arm_model.ros.node.tension_subscription import (
    FIELD_TOPIC,
    TOPICS,
    LatestSubscription,
    TensionInput,
    TensionSubscription,
    message_class,
)
from octo_arm_model.ros.node.winding import Winding
from octo_arm_model.ros.node.work_queue import WorkQueue
from octo_arm_model.ros.qos import check_overrides
from octo_arm_model.ros.refusal_log import RefusalLog
from octo_arm_model.wire import displacement_messages
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tension_messages import FieldMessage


class Prepared(NamedTuple):
    """An arm ready to be solved, swapped as a whole.

    Attributes:
        values: the parameters it was made from.
        config: what they say.
        solver: its solver.
    """

    values: dict[str, Any]
    config: Config
    solver: Solver

    @property
    def field(self) -> FieldMessage | None:
        """Where further messages hold tensions; None where no type of messages is named."""
        config = self.config
        given = FieldMessage(config.tension_type, config.tension_field)
        return given if config.tension_type else None

    @classmethod
    def of(cls, values: dict[str, Any]) -> Prepared:
        """Prepare the arm that ``values`` describe.

        Raises:
            OctoArmError: if they do not describe one; the message says why.
        """
        config = Config.from_parameters(values)
        if config.tension_type:
            message_class(config.tension_type)
        solver = config.solver(budget=config.solve_budget)
        # What is tabulated or loaded at its first use is so before messages come. Whether a solve
        # keeps to its budget is told when they do.
        with contextlib.suppress(ContinuationError):
            backbone = solver.solve(0.0 * solver.rest_lengths)
            solver.tendon_lengths(backbone)
            solver.sensitivity(backbone)
        return cls(values, config, solver)


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
        self._inputs: list[TensionSubscription] = []
        self._is_active = False
        self._field_input: TensionSubscription | None = None
        self._wrenches: LatestSubscription | None = None
        self._services: list[QueuedService] = []
        self._work = WorkQueue(node)
        self._publishers: BackbonePublishers | None = None
        self._winches: LatestSubscription | None = None
        self._tip_wrench: FloatArray | None = None
        self._memory = self._diagnostics.memory = FrictionMemory()
        self._winding = Winding(self._memory)

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
        self._inputs = [self._subscribe(topic) for topic in TOPICS]
        self._is_active = True
        self._subscribe_to_field()
        self._diagnostics.begin()
        self._wrenches = LatestSubscription(
            node, WrenchStamped, 'tip_wrench', self._on_wrench, self._work
        )
        self._winches = LatestSubscription(
            node, JointState, displacement_messages.TOPIC, self._on_displacements, self._work
        )
        self._diagnostics.apart = self._winches.topic
        self._services = [
            QueuedService(node, Solve, 'solve', self._on_solve, self._work),
            QueuedService(node, FindTensions, 'find_tensions', self._on_find_tensions, self._work),
        ]
        check_overrides(node)

    def deactivate(self) -> None:
        """Stop answering."""
        self._is_active = False
        for subscription in self._inputs:
            subscription.close()
        self._unsubscribe_from_field()
        for latest in (self._wrenches, self._winches):
            if latest is not None:
                latest.close()
        for service in self._services:
            service.close()
        self._work.clear()
        self._inputs, self._services = [], []
        self._wrenches = self._winches = None
        if self._publishers is not None:
            self._publishers.pause()
        self._diagnostics.end('inactive')
        self._tip_wrench, self._winding = None, Winding(self._memory)

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
        self._check_wrench_of_before(prepared)
        if (
            self._is_active
            and self._prepared is not None
            and prepared.field != self._prepared.field
        ):
            # A topic may have another type once the executor has let go of the subscription.
            self._unsubscribe_from_field()
            self._work.add(self._subscribe_to_field)
        self._prepared = prepared
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

    def _subscribe(self, topic: str, message: FieldMessage | None = None) -> TensionSubscription:
        return TensionSubscription(
            self._node, topic, self._current_arm, self._answer, self._work,
            names=self._current_names, message=message,
        )  # fmt: skip

    def _subscribe_to_field(self) -> bool:
        """Subscribe to messages of the type that the parameters name, if they name one."""
        assert self._prepared is not None
        if (field := self._prepared.field) is not None and self._field_input is None:
            try:
                self._field_input = self._subscribe(FIELD_TOPIC, field)
            except OctoArmError as error:
                self._node.get_logger().error(f'{FIELD_TOPIC} is not subscribed to: {error}')
        self._count_publishers()
        return False

    def _unsubscribe_from_field(self) -> None:
        if self._field_input is not None:
            self._field_input.close()
        self._field_input = None
        self._count_publishers()

    def _count_publishers(self) -> None:
        inputs = [*self._inputs, *filter(None, [self._field_input])]
        self._diagnostics.publishers = {one.topic: one.count_publishers for one in inputs}

    # Messages -----------------------------------------------------------------------------------

    def _current_names(self) -> tuple[str, ...]:
        return self._prepared.config.load_cells.names if self._prepared is not None else ()

    def _current_arm(self) -> Arm:
        assert self._prepared is not None  # it subscribes only while configured
        return self._prepared.config.arm

    def _answer(self, given: TensionInput) -> None:
        if given.older:
            self._diagnostics.skipped(given.older)
        if self._wrenches is not None:
            self._wrenches.answer_latest()
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
                prepared.solver, config, self._tip_wrench, at.ns, tensions, displacements
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
        if self._wrenches is not None:
            self._wrenches.answer_latest()
        try:
            message = winches.decode(data)
            found = displacement_messages.read_displacements(message, prepared.config.arm)
        except OctoArmError as error:
            self._refuse(winches.topic, error)
            return
        stamp = Stamp(message.header.stamp.sec, message.header.stamp.nanosec)
        self._publish_shape(winches.topic, stamp, displacements=found)

    def _on_wrench(self, data: bytes, older: int) -> None:
        """Keep the wrench for the tensions to come."""
        prepared, wrenches = self._prepared, self._wrenches
        if prepared is None or wrenches is None:
            return
        try:
            message = wrenches.decode(data)
            wrench = wrench_from_stamped(message, prepared.config.base_frame)
            prepared.solver.check_tip_wrench(wrench)
        except OctoArmError as error:
            self._refuse(wrenches.topic, error)
            return
        self._tip_wrench = wrench if wrench.any() else None

    def _check_wrench_of_before(self, prepared: Prepared) -> None:
        """Drop the wrench on the tip, with a warning, where it does not go with another arm."""
        if self._tip_wrench is None or self._prepared is None:
            return
        try:
            prepared.solver.check_tip_wrench(self._tip_wrench)
            problem = ''
        except OctoArmError as error:
            problem = str(error)
        before, now = self._prepared.config.base_frame, prepared.config.base_frame
        if now != before:
            problem = f'it was given in {before!r}, and base_frame is {now!r}'
        if problem:
            self._tip_wrench = None
            self._node.get_logger().warning(f'tip_wrench dropped: {problem}')

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
