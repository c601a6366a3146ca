"""The inputs of a node; only the latest message of each topic is read."""

import collections
import time
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from octo_arm_model.arm.errors import MeasurementError, MessageError, OctoArmError
from octo_arm_model.ros.topics import create_subscription, decoded, take_all
from octo_arm_model.ros.work import guarded, steady_timer
from octo_arm_model.wire.messages import Stamp

# Called with the whole name of a topic and a message; an OctoArmError refuses the message.
Read: TypeAlias = Callable[[str, Any], None]

# A best-effort subscription receives from reliable publishers as well. All but the latest message
# in the queue are skipped; the depth limits how many of the skipped ones are counted.
INPUT_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
MOST_BYTES = 2**23  # of a message; to decode one of many small parts takes seconds by then
MOST_WAITING = 50  # messages, beyond which the oldest is refused
LARGEST = 50_000  # bytes of a message that waits
LONGEST = 2.0  # [s] that a message waits
_PERIOD = 0.5  # [s] between checks for messages that have waited for too long


class NotKnownYet(MeasurementError):
    """Raised if what a message needs may be known later, such as the transform at its stamp.

    Attributes:
        is_known: function that says whether it is known now.
    """

    def __init__(self, reason: str, is_known: Callable[[], bool]) -> None:
        """Refuse a message for this ``reason``, unless ``is_known`` soon returns True."""
        super().__init__(reason)
        self.is_known = is_known


class _WaitingMessage(NamedTuple):
    topic: str
    read: Callable[[], None]
    error: NotKnownYet
    until: float


class Inputs:
    """The subscriptions of a node, and the messages that wait for what they need.

    Attributes:
        node: the node.
        refuse: called with the whole name of a topic and why a message on it is refused.
        skipped: called with the number of messages skipped for a newer one, before that is read.
    """

    def __init__(
        self,
        node: Node,
        refuse: Callable[[str, OctoArmError], None],
        skipped: Callable[[int], None],
    ) -> None:
        """Create the inputs of ``node``, without subscriptions."""
        self.node, self.refuse, self.skipped = node, refuse, skipped
        self._open: dict[str, LatestSubscription] = {}
        self._last_subscribed = 0.0
        self._waiting: collections.deque[_WaitingMessage] = collections.deque()
        steady_timer(node, _PERIOD, self._expire)

    def subscribe(
        self, kind: Any, topic: str, read: Read, *, is_apart: bool = True, is_answered: bool = True
    ) -> 'LatestSubscription':
        """Call ``read`` with messages of type ``kind``; ConfigError for impossible QoS overrides.

        ``is_apart`` says that the topic is not a source of tensions, and ``is_answered`` that each
        message has its own answer.
        """
        self._last_subscribed = time.monotonic()
        subscription = LatestSubscription(self, kind, topic, read, is_apart, is_answered)
        self._open[topic] = subscription
        return subscription

    def is_open(self, topic: str) -> bool:
        """Whether the node is subscribed to ``topic``, by the name given to `subscribe`."""
        return topic in self._open

    def is_apart(self, topic: str) -> bool:
        """Whether ``topic``, by its whole name, is an input that is not a source of tensions."""
        return any(one.topic == topic and one.is_apart for one in self._open.values())

    def unsubscribe(self, topic: str) -> None:
        """Stop reading messages on ``topic``, if the node is subscribed to it."""
        if (subscription := self._open.pop(topic, None)) is not None:
            subscription.close()

    def close(self) -> None:
        """Unsubscribe from all topics, and drop the messages that wait."""
        for topic in list(self._open):
            self.unsubscribe(topic)
        self._waiting.clear()

    def answer_latest(self) -> None:
        """Answer the latest message of each topic, unless it is answered already."""
        for subscription in list(self._open.values()):
            subscription.answer_latest()

    def publishers(self) -> dict[str, int]:
        """Return the number of publishers of each answered input, by its whole name."""
        answered = [topic for topic in self._open.values() if topic.is_answered]
        return {one.topic: one.subscription.get_publisher_count() for one in answered}

    def silent(self, limit: float, is_used: Callable[[str], bool]) -> list[str]:
        """Return a sentence for each used input without a message for more than ``limit`` [s].

        The topics of tensions count as one input, as they may replace each other.
        """
        now, inputs = time.monotonic(), self._open.values()
        heard = [(topic.topic, topic.heard_at) for topic in inputs if topic.is_apart]
        tensions = [topic for topic in inputs if not topic.is_apart]
        if tensions:
            heard.append(max((topic.heard_at, topic.topic) for topic in tensions)[::-1])
        silent = [
            f'{topic} is silent for {now - heard_at:.1f} s'
            for topic, heard_at in sorted(heard)
            if heard_at and now - heard_at > limit and is_used(topic)
        ]
        is_answered = any(topic.heard_at and topic.is_answered for topic in inputs)
        if not is_answered and now - self._last_subscribed > limit:
            silent.append(f'silent for {now - self._last_subscribed:.1f} s')
        return silent

    def attempt(self, topic: str, read: Callable[[], None], size: int) -> None:
        """Call ``read`` for a message on ``topic`` of ``size`` bytes, or let the message wait.

        A message waits after a `NotKnownYet`, and is refused after any other OctoArmError, or once
        it is too large to wait or has waited for too long.
        """
        try:
            read()
        except NotKnownYet as error:
            if size > LARGEST:
                self.refuse(topic, error)
                return
            if len(self._waiting) >= MOST_WAITING:
                self._refuse_oldest()
            self._waiting.append(_WaitingMessage(topic, read, error, time.monotonic() + LONGEST))
        except OctoArmError as error:
            self.refuse(topic, error)

    def look_again(self) -> None:
        """Read the waiting messages whose needs are known by now."""
        for message in [message for message in self._waiting if message.error.is_known()]:
            self._waiting.remove(message)
            self.attempt(message.topic, message.read, 0)

    def _expire(self) -> None:
        while self._waiting and self._waiting[0].until < time.monotonic():
            self._refuse_oldest()

    def _refuse_oldest(self) -> None:
        oldest = self._waiting.popleft()
        self.refuse(oldest.topic, oldest.error)


class LatestSubscription:
    """A subscription to one topic, of which only the latest message is answered.

    An answer may take longer than the time between two messages. It is a task of the executor, of
    which there is one at a time: if the callback answered, all messages that came meanwhile would
    be answered before any request for parameters.

    Attributes:
        subscription: the subscription of rclpy.
        topic: whole name of the topic, as remapped.
        is_apart: whether the topic is not a source of tensions.
        is_answered: whether each message has its own answer.
        heard_at: time when the last message was read [s]; 0 if there was none.
    """

    def __init__(
        self, inputs: Inputs, kind: Any, topic: str, read: Read, is_apart: bool, is_answered: bool
    ) -> None:
        """Subscribe the node of ``inputs``; the other arguments are those of its `subscribe`."""
        self._inputs, self._kind, self._read = inputs, kind, read
        self.is_apart, self.is_answered = is_apart, is_answered
        self.heard_at = self._read_at = 0.0
        self._latest: bytes | None = None
        self._older, self._is_open, self._is_due = 0, True, False
        self._answer = guarded(inputs.node, self._answer_due)
        self.subscription = create_subscription(
            inputs.node, kind, topic, self._keep, INPUT_QOS, raw=True
        )
        self.topic = self.subscription.topic_name

    def close(self) -> None:
        """Destroy the subscription."""
        self._is_open = False
        self._inputs.node.destroy_subscription(self.subscription)

    def _keep(self, message: bytes) -> None:
        self._older += self._latest is not None
        self._latest = message
        if not self._is_due and (executor := self._inputs.node.executor):
            self._is_due = True
            executor.create_task(self._answer)

    def _answer_due(self) -> None:
        self._is_due = False
        self.answer_latest()

    def answer_latest(self) -> None:
        """Answer the latest message, unless it is answered already."""
        if not self._is_open:
            return
        for message, _ in take_all(self.subscription, self._kind):
            self._older += self._latest is not None
            self._latest = message
        latest, older = self._latest, self._older
        self._latest, self._older = None, 0
        if latest is None:
            return
        if self.is_answered:
            self._inputs.skipped(older)
        heard_at = self.heard_at = time.monotonic()

        def read() -> None:
            if len(latest) > MOST_BYTES:
                raise MessageError(f'{len(latest)} bytes, expected at most {MOST_BYTES}')
            # One that has waited is out of date if a newer one was read meanwhile.
            if self.is_answered or heard_at >= self._read_at:
                self._read(self.topic, decoded(latest, self._kind))
                self._read_at = heard_at

        self._inputs.attempt(self.topic, read, len(latest))


def stamp_of(message: Any) -> Stamp | None:
    """Return the stamp of a ``message``; None if its type has no stamp."""
    header = getattr(message, 'header', None)
    return Stamp.of(header.stamp) if isinstance(header, Header) else None
