"""What the nodes of an arm share: parameters, diagnostics, tensions and the publishers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from rclpy.node import Node

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.ros.live_parameters import LiveParameters
from octo_arm_model.ros.messages import decoded, message_class
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.inputs import (
    MOTORS_TOPIC,
    FieldInput,
    Intake,
    LatestSubscription,
    TensionInputs,
    stamp_of,
)
from octo_arm_model.ros.node.outputs import BackbonePublishers
from octo_arm_model.ros.node.prepared_arm import Prepared
from octo_arm_model.ros.qos import check_overrides
from octo_arm_model.ros.refusal_log import RefusalLog
from octo_arm_model.ros.work import WorkQueue
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tensions import FieldMessage

ArmT = TypeVar('ArmT', bound=Prepared)
PublishersT = TypeVar('PublishersT', bound=BackbonePublishers)


class Server(ABC, Generic[ArmT, PublishersT]):
    """Answers tensions, and the other inputs of a node, on behalf of that node.

    `configure` loads the arm, `activate` starts answering, `deactivate` stops and `cleanup` frees
    what `configure` took.
    """

    def __init__(
        self,
        node: Node,
        table: Sequence[Parameter],
        prepare: Callable[[dict[str, Any]], ArmT],
        publishers: Callable[[Node], PublishersT],
    ) -> None:
        """Declare the parameters ``table`` of ``node``.

        ``prepare`` makes an arm of them, see `LiveParameters`, and ``publishers`` what publishes.

        Raises:
            ConfigError: if a value is of another type than ROS needs.
        """
        self._node, self._make_publishers = node, publishers
        self._live = LiveParameters(node, table, prepare, self._use)
        self._prepared: ArmT | None = None
        self._publishers: PublishersT | None = None
        self._diagnostics = Diagnostics(node)
        self._diagnostics.end('unconfigured')
        self._refusal_log = RefusalLog(node)
        self._work = WorkQueue(node)
        self._intake = Intake(node, self._work, self._refuse, self._diagnostics.skipped)
        self._tensions = TensionInputs(
            self._intake, self._diagnostics, lambda: self._arm.config, self._on_readings
        )
        self._motors = FieldInput(
            self._intake, self._diagnostics, MOTORS_TOPIC, self._field_of_motors,
            self._subscribe_to_motors,
        )  # fmt: skip

    def configure(self) -> None:
        """Load and validate the arm.

        Raises:
            OctoArmError: if a parameter is missing, unknown, of the wrong type or impossible, or
                they do not go together.
        """
        self._publishers = self._make_publishers(self._node)
        self._live.begin()
        self._diagnostics.end('inactive')

    def activate(self) -> None:
        """Start answering; ConfigError if an override of a QoS policy cannot be."""
        self._tensions.open()
        self._open()
        self._motors.open()
        self._diagnostics.begin()
        check_overrides(self._node)

    def deactivate(self) -> None:
        """Stop answering."""
        self._tensions.close()
        self._motors.close()
        self._close()
        self._work.clear()
        if self._publishers is not None:
            self._publishers.pause()
        self._diagnostics.end('inactive')

    def cleanup(self) -> None:
        """Free the arm and its publishers."""
        self._live.end()
        if self._publishers is not None:
            self._publishers.close()
        self._publishers = self._prepared = None
        self._diagnostics.end('unconfigured')

    @abstractmethod
    def _open(self) -> None:
        """Offer and subscribe to what there is besides tensions."""

    @abstractmethod
    def _close(self) -> None:
        """End what `_open` began, or as much of it as was."""

    @abstractmethod
    def _change_arm(self, before: ArmT | None, now: ArmT) -> None:
        """Go on with the arm ``now``, after that ``before`` if there was one."""

    @abstractmethod
    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        """Answer readings of load cells [N], of `Arm.tension_shape`; OctoArmError if refused."""

    @abstractmethod
    def _on_motors(self, topic: str, stamp: Stamp | None, message: Any, field: str) -> None:
        """Answer a ``field`` of what encoders of winches read; OctoArmError if refused."""

    def _field_of_motors(self) -> FieldMessage:
        config = self._arm.config
        return FieldMessage(config.displacement_type, config.displacement_field)

    def _subscribe_to_motors(self, topic: str, message: FieldMessage) -> LatestSubscription:
        kind = message_class(message.type_name)

        def read(data: bytes) -> None:
            given = decoded(data, kind)
            self._on_motors(made.topic, stamp_of(given), given, message.field)

        made = LatestSubscription(self._intake, kind, topic, read)
        self._diagnostics.heard.apart |= {made.topic}
        return made

    def _use(self, prepared: ArmT, names: set[str]) -> None:
        """Answer with the arm ``prepared`` from now on, between two messages."""
        assert self._publishers is not None
        config, solver = prepared.config, prepared.solver
        before, self._prepared = self._prepared, prepared
        self._tensions.field.update()
        self._motors.update()
        self._diagnostics.describe(solver, config.diagnostic_limits)
        self._publishers.describe(solver, config)
        self._publishers.announce(prepared.description)
        self._change_arm(before, prepared)

    @property
    def _arm(self) -> ArmT:
        """The present arm, which there is while anything is answered."""
        assert self._prepared is not None
        return self._prepared

    def _refuse(self, topic: str, error: OctoArmError) -> None:
        self._diagnostics.refused(topic, error)
        self._refusal_log.warn(topic, error)
