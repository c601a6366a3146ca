"""Parts that the nodes of an arm share: parameters, diagnostics, tension inputs and publishers."""

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, TypeVar

from rclpy.node import Node

from octo_arm_model.arm.errors import ConfigError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.arm.loads import ZERO, FollowingWrench
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.live_parameters import LiveParameters
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.inputs import Inputs, stamp_of
from octo_arm_model.ros.node.outputs import BackbonePublishers
from octo_arm_model.ros.node.sensor_frames import SensorFrames
from octo_arm_model.ros.topics import check_overrides, message_class
from octo_arm_model.ros.work import guarded
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import TENSION_TOPICS, FieldMessage, TensionMessage


@dataclass(frozen=True)
class Prepared:
    """An arm ready to be solved; a change of parameters replaces it as a whole."""

    description: str  #: the parameters of the arm, as a parameter file
    config: Config  #: the configuration that the parameters describe
    solver: Solver  #: solver of the arm

    @functools.cached_property
    def followed(self) -> tuple[Solver, FollowingWrench]:
        """A solver of the arm under a wrench that turns with its tip, and that wrench.

        ConfigError if the model has no loads.
        """
        tip = FollowingWrench(self.config.arm.length, ZERO)
        loads = replace(self.config.loads, others=(*self.config.loads.others, tip))
        return replace(self.config, loads=loads).node_solver(), tip

    @classmethod
    def of(cls, values: dict[str, Any]) -> 'Prepared':
        """Prepare the arm that ``values`` describe; OctoArmError if they describe none."""
        description, config = described(values)
        return cls(description, config, config.node_solver())


def described(values: Mapping[str, Any]) -> tuple[str, Config]:
    """Return the parameter file of ``values``, and the arm that they describe.

    OctoArmError if they describe no arm, a type of messages is not installed, or the file would be
    too large to be read.
    """
    text, config = parameters_as_yaml(values), Config.from_parameters(values)
    if len(text) > MAX_YAML_BYTES:
        raise ConfigError(
            f'the description of the arm has {len(text)} bytes, expected at most {MAX_YAML_BYTES}'
        )
    for kind in filter(None, (config.tension_type, config.displacement_type)):
        message_class(kind)
    return text, config


# Topics of messages of any type.
TENSIONS_FIELD, MOTORS_FIELD = 'tendon_tensions/field', 'tendon_displacements/field'
ArmT = TypeVar('ArmT', bound=Prepared)
PublishersT = TypeVar('PublishersT', bound=BackbonePublishers)


class Server(ABC, Generic[ArmT, PublishersT]):
    """Answers the tensions and the other inputs of a node.

    `configure` loads the arm, `activate` starts answering, `deactivate` stops and `cleanup` frees
    what `configure` created.
    """

    def __init__(
        self,
        node: Node,
        table: Sequence[Parameter],
        prepare: Callable[[dict[str, Any]], ArmT],
        publishers: Callable[[Node], PublishersT],
    ) -> None:
        """Declare the parameters ``table`` of ``node``; ConfigError if a value has the wrong type.

        ``prepare`` makes an arm from their values; ``publishers`` creates the publishers.
        """
        self._node, self._make_publishers = node, publishers
        self._live = LiveParameters(node, table, prepare, self._use)
        self._prepared: ArmT | None = None
        self._publishers: PublishersT | None = None
        self._inputs = Inputs(
            node,
            lambda topic, error: self._diagnostics.refused(topic, error),
            lambda older: self._diagnostics.count('skipped', older),
        )
        self._frames = SensorFrames(node, self._inputs.look_again)
        self._diagnostics = Diagnostics(node, self._inputs)
        self._diagnostics.enter('unconfigured')
        # While the server is active: the messages whose types parameters name, by topic.
        self._fields: dict[str, FieldMessage] = {}

    def configure(self) -> None:
        """Load the arm; OctoArmError if a parameter is missing, unknown, wrong or impossible."""
        self._publishers = self._make_publishers(self._node)
        self._live.begin()
        self._diagnostics.enter('inactive')

    def activate(self) -> None:
        """Start answering; ConfigError if an override of a QoS policy has an impossible value."""
        self._fields = self._field_messages()
        self._subscribe()
        self._frames.open()
        self._open()
        self._diagnostics.enter('')
        check_overrides(self._node)

    def deactivate(self) -> None:
        """Stop answering."""
        self._close()
        self._inputs.close()
        self._frames.close()
        self._fields = {}
        if self._publishers is not None:
            self._publishers.pause()
        self._diagnostics.enter('inactive')

    def cleanup(self, state: str = 'unconfigured') -> None:
        """Free the arm and its publishers; the node is in the lifecycle ``state`` from now on."""
        self._live.end()
        if self._publishers is not None:
            self._publishers.close()
        self._publishers = self._prepared = None
        self._diagnostics.describe(None)
        self._diagnostics.enter(state)

    @abstractmethod
    def _open(self) -> None:
        """Create the services, and the subscriptions besides those to tensions."""

    @abstractmethod
    def _close(self) -> None:
        """Destroy what `_open` has created, also if it failed halfway."""

    @abstractmethod
    def _change_arm(self, before: ArmT | None, now: ArmT) -> None:
        """Replace the arm ``before``, if there was one, by the arm ``now``."""

    @abstractmethod
    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        """Answer load cell readings [N] of `Arm.tension_shape`; OctoArmError if refused."""

    @abstractmethod
    def _on_motors(self, field: str, topic: str, message: Any) -> None:
        """Answer the encoder readings in the ``field`` of a message; OctoArmError if refused."""

    def _on_tensions(self, kind: TensionMessage | FieldMessage, topic: str, message: Any) -> None:
        config = self._arm.config
        readings = kind.read(message, config.arm, config.load_cells.names)
        self._on_readings(topic, stamp_of(message), readings)

    def _field_messages(self) -> dict[str, FieldMessage]:
        config = self._arm.config
        return {
            TENSIONS_FIELD: FieldMessage(config.tension_type, config.tension_field),
            MOTORS_FIELD: FieldMessage(config.displacement_type, config.displacement_field),
        }

    def _update_fields(self) -> None:
        before, now = self._fields, self._field_messages()
        if before and now != before:
            self._fields = now
            for topic in (topic for topic in now if now[topic] != before[topic]):
                self._inputs.unsubscribe(topic)
            # A topic can change its type only after the executor releases the subscription.
            if executor := self._node.executor:
                executor.create_task(guarded(self._node, self._subscribe_anew))

    def _subscribe_anew(self) -> None:
        if self._fields:  # the server is still active
            self._subscribe()

    def _subscribe(self) -> None:
        """Subscribe to tensions, and to the topics of messages whose types parameters name."""
        topics: dict[str, TensionMessage | FieldMessage] = {**TENSION_TOPICS, **self._fields}
        for topic, message in topics.items():
            if not message.type_name or self._inputs.is_open(topic):
                continue
            read, is_motors = partial(self._on_tensions, message), topic == MOTORS_FIELD
            if is_motors:
                read = partial(self._on_motors, self._fields[topic].field)
            try:
                kind = message_class(message.type_name)
                self._inputs.subscribe(kind, topic, read, is_apart=is_motors)
            except OctoArmError as error:
                if topic in TENSION_TOPICS:
                    raise
                self._node.get_logger().error(f'{topic} is not subscribed to: {error}')

    def _use(self, prepared: ArmT, names: set[str]) -> None:
        """Use the arm ``prepared`` from now on; called between two messages."""
        assert self._publishers is not None
        config, solver = prepared.config, prepared.solver
        before, self._prepared = self._prepared, prepared
        if before is not None and before.config.base_frame != config.base_frame:
            self._frames.close()  # its own frames have another parent
        self._update_fields()
        self._diagnostics.describe(solver, config.diagnostic_limits)
        self._publishers.describe(solver, config)
        self._publishers.announce(prepared.description)
        self._change_arm(before, prepared)
        # Parameters that change faster than the arm is prepared would keep all inputs waiting.
        self._inputs.answer_latest()

    @property
    def _arm(self) -> ArmT:
        """The present arm, which is set while messages are answered."""
        assert self._prepared is not None
        return self._prepared
