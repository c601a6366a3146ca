"""The inputs of a node, of which only the latest message counts: tensions and a wrench."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.messages import decoded, message_class
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.qos import create_subscription
from octo_arm_model.ros.work import WorkQueue
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tensions import TENSION_TOPICS, FieldMessage, TensionMessage

# Called with a topic and why a message on it is refused.
Refuse: TypeAlias = Callable[[str, OctoArmError], None]

# A best-effort subscription receives from reliable publishers as well. All but the latest of the
# messages in the queue are skipped; its depth limits how many of these are counted.
INPUT_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
TOPICS = tuple(TENSION_TOPICS)
FIELD_TOPIC, MOTORS_TOPIC = 'tendon_tensions/field', 'tendon_displacements/field'


class Intake(NamedTuple):
    """What the subscriptions of a node share.

    Attributes:
        node: the node.
        work: has the turns in which messages are read.
        refuse: called with a topic and why a message on it is refused.
        skipped: called with the number of messages left out for a newer one, before that is read.
    """

    node: Node
    work: WorkQueue
    refuse: Refuse
    skipped: Callable[[int], None] = lambda older: None


class LatestSubscription:
    """Subscription to one topic, of which only the latest message is answered.

    To answer may take longer than the time between two messages. It is a piece of a `WorkQueue`:
    in the callback of a message every message that came meanwhile would be answered before any
    request for parameters is.

    Attributes:
        topic: its whole name, as remapped.
    """

    def __init__(
        self, intake: Intake, kind: Any, topic: str, read: Callable[[bytes], None]
    ) -> None:
        """Subscribe to messages of type ``kind`` on ``topic``.

        ``read`` is called with the bytes of the latest; a message is refused by the OctoArmError
        that it raises.
        """
        self._intake, self._kind, self._read_data = intake, kind, read
        self._latest: bytes | None = None
        self._older = 0
        self._is_due, self._is_open = False, True
        self._subscription = create_subscription(
            intake.node, kind, topic, self._keep, INPUT_QOS, raw=True
        )
        self.topic = self._subscription.topic_name

    def close(self) -> None:
        """Destroy the subscription."""
        self._is_open = False
        self._intake.node.destroy_subscription(self._subscription)

    def count_publishers(self) -> int:
        """How many publishers of the topic there are."""
        return int(self._subscription.get_publisher_count())

    def _keep(self, message: bytes) -> None:
        self._older += self._latest is not None
        self._latest = message
        if not self._is_due:
            self._is_due = True
            self._intake.work.add(self._answer_due)

    def _answer_due(self) -> bool:
        self._is_due = False
        self.answer_latest()
        return False

    def answer_latest(self) -> None:
        """Answer the latest message, if it is not answered yet."""
        if not self._is_open:
            return
        with self._subscription.handle:
            while (taken := self._subscription.handle.take_message(self._kind, True)) is not None:
                self._older += self._latest is not None
                self._latest = taken[0]
        latest, older = self._latest, self._older
        self._latest, self._older = None, 0
        if latest is None:
            return
        self._intake.skipped(older)
        try:
            self._read_data(latest)
        except OctoArmError as error:
            self._intake.refuse(self.topic, error)


class TensionSubscription(LatestSubscription):
    """Subscription to one topic of tensions, which reads its messages."""

    def __init__(
        self,
        intake: Intake,
        topic: str,
        arm: Callable[[], Arm],
        take: Callable[[str, Stamp | None, FloatArray], None],
        *,
        prefix: str = 'tendon_tensions',
        names: Callable[[], Sequence[str]] = tuple,
        message: TensionMessage | FieldMessage | None = None,
    ) -> None:
        """Subscribe.

        The ``topic`` is one of `TENSION_TOPICS`, which says of what type messages are, or another
        with messages of the type ``message``; ``prefix`` replaces 'tendon_tensions' in its name.
        ``arm`` returns the arm that they are for, and ``names`` what its tendons are called there,
        empty for their own names. ``take`` is called with the whole name of the topic, the stamp,
        None where the type has none, and the tensions, of `Arm.tension_shape` [N]; what it raises
        is refused too.
        """
        self._message = TENSION_TOPICS[topic] if message is None else message
        self._arm, self._take, self._names = arm, take, names
        name = topic.replace('tendon_tensions', prefix, 1)
        kind = message_class(self._message.type_name)
        super().__init__(intake, kind, name, self._read_latest)

    def _read_latest(self, data: bytes) -> None:
        message, arm, wanted = decoded(data, self._kind), self._arm(), self._names()
        if wanted or isinstance(self._message, FieldMessage):
            tensions = self._message.read_named(message, arm, wanted)
        else:
            tensions = self._message.read(message, arm)
        self._take(self.topic, stamp_of(message), tensions)


def stamp_of(message: Any) -> Stamp | None:
    """The stamp of a ``message``; None where its type has none."""
    header = getattr(message, 'header', None)
    return Stamp.of(header.stamp) if isinstance(header, Header) else None


class FieldInput:
    """A subscription to messages of a type that parameters name, while they name one."""

    def __init__(
        self,
        intake: Intake,
        diagnostics: Diagnostics,
        topic: str,
        wanted: Callable[[], FieldMessage],
        subscribe: Callable[[str, FieldMessage], LatestSubscription],
    ) -> None:
        """Subscribe to nothing yet.

        ``wanted`` returns the type of the messages, empty for none, and their field; ``subscribe``
        subscribes to them on ``topic``.
        """
        self._intake, self._diagnostics, self._topic = intake, diagnostics, topic
        self._wanted, self._make = wanted, subscribe
        self._input: LatestSubscription | None = None
        self._message = FieldMessage('', '')
        self._is_active = False

    def open(self) -> None:
        """Subscribe, if the parameters name a type."""
        self._is_active = True
        self._subscribe()

    def close(self) -> None:
        """Unsubscribe."""
        self._is_active = False
        self._unsubscribe()

    def update(self) -> None:
        """Subscribe to messages of another type in the place of the last, where parameters do."""
        if self._is_active and self._wanted() != self._message:
            # A topic may have another type once the executor has let go of the subscription.
            self._unsubscribe()
            self._intake.work.add(self._subscribe)

    def _subscribe(self) -> bool:
        self._message = self._wanted()
        if self._message.type_name and self._input is None and self._is_active:
            try:
                made = self._input = self._make(self._topic, self._message)
                self._diagnostics.publishers[made.topic] = made.count_publishers
            except OctoArmError as error:
                logger = self._intake.node.get_logger()
                logger.error(f'{self._topic} is not subscribed to: {error}')
        return False

    def _unsubscribe(self) -> None:
        if self._input is not None:
            self._input.close()
            self._diagnostics.publishers.pop(self._input.topic, None)
        self._input, self._message = None, FieldMessage('', '')


class TensionInputs:
    """The subscriptions of a node to tensions while it is active.

    Attributes:
        field: that to a field of any type of messages.
    """

    def __init__(
        self,
        intake: Intake,
        diagnostics: Diagnostics,
        current: Callable[[], Config],
        take: Callable[[str, Stamp | None, FloatArray], None],
    ) -> None:
        """Subscribe to nothing yet; ``current`` returns the arm that tensions are for.

        Others as in `TensionSubscription`.
        """
        self._intake, self._diagnostics = intake, diagnostics
        self._current, self._take = current, take
        self._inputs: list[TensionSubscription] = []
        self.field = FieldInput(
            intake, diagnostics, FIELD_TOPIC,
            lambda: FieldMessage(current().tension_type, current().tension_field),
            self._subscribe,
        )  # fmt: skip

    def open(self) -> None:
        """Subscribe."""
        for topic in TOPICS:
            # One by one: where the next cannot be, `close` ends those before it.
            self._inputs.append(made := self._subscribe(topic))
            self._diagnostics.publishers[made.topic] = made.count_publishers
        self.field.open()

    def close(self) -> None:
        """Unsubscribe from all."""
        for subscription in self._inputs:
            subscription.close()
        self._inputs = []
        self.field.close()

    def _subscribe(self, topic: str, message: FieldMessage | None = None) -> TensionSubscription:
        return TensionSubscription(
            self._intake, topic, lambda: self._current().arm, self._take,
            names=lambda: self._current().load_cells.names, message=message,
        )  # fmt: skip
