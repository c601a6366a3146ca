"""Subscriptions of which only the latest message counts, and those to tensions among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.ros.messages import decoded, message_class
from octo_arm_model.ros.qos import create_subscription
from octo_arm_model.ros.work.work_queue import WorkQueue
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tension_layout import TensionLayout
from octo_arm_model.wire.tension_messages import TENSION_TOPICS, FieldMessage, TensionMessage

# Called with a topic and why a message on it is refused.
Refuse: TypeAlias = Callable[[str, OctoArmError], None]

# A best-effort subscription receives from reliable publishers as well. All but the latest of the
# messages in the queue are skipped; its depth limits how many of these are counted.
INPUT_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
TOPICS = tuple(TENSION_TOPICS)
FIELD_TOPIC = 'tendon_tensions/field'


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
        self._layout: TensionLayout | None = None
        name = topic.replace('tendon_tensions', prefix, 1)
        kind = message_class(self._message.type_name)
        super().__init__(intake, kind, name, self._read_latest)

    def _read_latest(self, data: bytes) -> None:
        tensions, stamp = self._read(data, self._arm())
        self._take(self.topic, stamp, tensions)

    def _read(self, data: bytes, arm: Arm) -> tuple[FloatArray, Stamp | None]:
        """Tensions [N] and the stamp of a message, None where its type has none.

        Raises:
            MessageError: if it is no message of the type.
            TensionError: if it is not one for ``arm``.
        """
        layout, wanted = self._layout, self._names()
        if layout is not None and layout.arm is arm and not wanted:
            found = layout.read(data)
            if found is not None:
                return found
        message = decoded(data, self._kind)
        if wanted or isinstance(self._message, FieldMessage):
            tensions = self._message.read_named(message, arm, wanted)
        else:
            tensions = self._message.read(message, arm)
            self._layout = TensionLayout(self._message, data, message, arm)
        header = getattr(message, 'header', None)
        if not isinstance(header, Header):
            return tensions, None
        return tensions, Stamp.of(header.stamp)
