"""The inputs of a node, of each of which only the latest message counts."""

import collections
import time
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from octo_arm_model.arm.errors import MeasurementError, OctoArmError
from octo_arm_model.ros.topics import create_subscription, decoded
from octo_arm_model.ros.work import WorkQueue, steady_timer
from octo_arm_model.wire.messages import Stamp

# Called with the whole name of a topic and a message on it, which an OctoArmError refuses.
Read: TypeAlias = Callable[[str, Any], None]

# A best-effort subscription receives from reliable publishers as well. All but the latest of the
# messages in the queue are skipped; its depth limits how many of these are counted.
INPUT_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
MOST_WAITING = 50  # messages, beyond which the oldest is refused
LARGEST = 50_000  # bytes of a message that waits
LONGEST = 2.0  # [s] that a message waits
_PERIOD = 0.5  # [s] between looks for those that have waited for too long


class NotKnownYet(MeasurementError):
    """What a message needs is known later, as the transform of its time usually is.

    Attributes:
        is_known: whether it is now.
    """

    def __init__(self, reason: str, is_known: Callable[[], bool]) -> None:
        """Refuse a message for this ``reason``, unless it is known soon."""
        super().__init__(reason)
        self.is_known = is_known


class _Waiting(NamedTuple):
    topic: str
    read: Callable[[], None]
    error: NotKnownYet
    until: float


class Inputs:
    """The subscriptions of a node, and its messages that wait for what they need.

    Attributes:
        node: the node.
        work: has the turns in which messages are read.
        refuse: called with the whole name of a topic and why a message on it is refused.
        skipped: called with the number of messages left out for a newer one, before that is read.
    """

    def __init__(
        self,
        node: Node,
        refuse: Callable[[str, OctoArmError], None],
        skipped: Callable[[int], None],
    ) -> None:
        """Subscribe ``node`` to nothing yet."""
        self.node, self.refuse, self.skipped = node, refuse, skipped
        self.work = WorkQueue(node)
        self._open: dict[str, LatestSubscription] = {}
        self._began = 0.0
        self._waiting: collections.deque[_Waiting] = collections.deque()
        self._is_due = False
        steady_timer(node, _PERIOD, self._expire)

    def subscribe(
        self, kind: Any, topic: str, read: Read, *, is_apart: bool = True, is_answered: bool = True
    ) -> 'LatestSubscription':
        """Have messages of type ``kind`` on ``topic`` read from now on.

        ``is_apart`` says that they are no further source of tensions, and ``is_answered`` that
        each has an answer of its own.

        Raises:
            ConfigError: if an override of a QoS policy cannot be.
        """
        self._began = time.monotonic()
        made = LatestSubscription(self, kind, topic, read, is_apart, is_answered)
        self._open[topic] = made
        return made

    def is_open(self, topic: str) -> bool:
        """Whether ``topic`` is subscribed to, by the name that was given."""
        return topic in self._open

    def is_apart(self, topic: str) -> bool:
        """Whether messages on ``topic``, by its whole name, are no source of tensions."""
        return any(one.topic == topic and one.is_apart for one in self._open.values())

    def unsubscribe(self, topic: str) -> None:
        """Read no more messages on ``topic``, if any were."""
        if (subscription := self._open.pop(topic, None)) is not None:
            subscription.close()

    def close(self) -> None:
        """Unsubscribe from all, and forget what waits."""
        for topic in list(self._open):
            self.unsubscribe(topic)
        self.work.clear()
        self.forget()
        self._is_due = False

    def publishers(self) -> dict[str, int]:
        """How many publishers each input has that is answered, by its whole name."""
        return {
            one.topic: one.count_publishers() for one in self._open.values() if one.is_answered
        }

    def silent(self, limit: float, is_used: Callable[[str], bool]) -> list[str]:
        """A sentence for each used input without a message for more than ``limit`` [s].

        Those of tensions are one, as they may replace each other.
        """
        now = time.monotonic()
        heard = [(one.topic, one.heard_at) for one in self._open.values() if one.is_apart]
        of_tensions = [one for one in self._open.values() if not one.is_apart]
        if of_tensions:
            heard.append(max((one.heard_at, one.topic) for one in of_tensions)[::-1])
        silent = [
            f'{topic} is silent for {now - heard_at:.1f} s'
            for topic, heard_at in sorted(heard)
            if heard_at and now - heard_at > limit and is_used(topic)
        ]
        is_answered = any(one.heard_at and one.is_answered for one in self._open.values())
        if not is_answered and now - self._began > limit:
            silent.append(f'silent for {now - self._began:.1f} s')
        return silent

    def attempt(self, topic: str, read: Callable[[], None], size: int) -> None:
        """Call ``read`` for a message on ``topic`` of so many bytes, once what it needs is known.

        It is refused by the OctoArmError that it raises then, or as it has waited for too long.
        """
        try:
            read()
        except NotKnownYet as error:
            if size > LARGEST:
                self.refuse(topic, error)
                return
            if len(self._waiting) >= MOST_WAITING:
                self._refuse_oldest()
            self._waiting.append(_Waiting(topic, read, error, time.monotonic() + LONGEST))
        except OctoArmError as error:
            self.refuse(topic, error)

    def forget(self) -> None:
        """Forget what waits; it is of another arm."""
        self._waiting.clear()

    def look_again(self) -> None:
        """Read, in their turns, messages that wait for what is known by now."""
        if self._waiting and not self._is_due:
            self._is_due = True
            self.work.add(self._read_next)

    def _read_next(self) -> bool:
        """Read the oldest message for which all is known; whether there was one."""
        known = next((one for one in self._waiting if one.error.is_known()), None)
        self._is_due = known is not None
        if known is not None:
            self._waiting.remove(known)
            try:
                known.read()
            except OctoArmError as error:
                self.refuse(known.topic, error)
        return self._is_due

    def _expire(self) -> None:
        while self._waiting and self._waiting[0].until < time.monotonic():
            self._refuse_oldest()

    def _refuse_oldest(self) -> None:
        oldest = self._waiting.popleft()
        self.refuse(oldest.topic, oldest.error)


class LatestSubscription:
    """Subscription to one topic, of which only the latest message is answered.

    To answer may take longer than the time between two messages. It is a piece of a `WorkQueue`:
    in the callback of a message every message that came meanwhile would be answered before any
    request for parameters is.

    Attributes:
        topic: its whole name, as remapped.
        is_apart: see `Inputs.subscribe`.
        is_answered: see there.
        heard_at: when the last message was read [s]; 0 where none was.
    """

    def __init__(
        self, inputs: Inputs, kind: Any, topic: str, read: Read, is_apart: bool, is_answered: bool
    ) -> None:
        """Subscribe, see `Inputs.subscribe`."""
        self._inputs, self._kind, self._read = inputs, kind, read
        self.is_apart, self.is_answered, self.heard_at = is_apart, is_answered, 0.0
        self._latest: bytes | None = None
        self._older, self._is_open = 0, True
        self._subscription = create_subscription(
            inputs.node, kind, topic, self._keep, INPUT_QOS, raw=True
        )
        self.topic = self._subscription.topic_name

    def close(self) -> None:
        """Destroy the subscription."""
        self._is_open = False
        self._inputs.node.destroy_subscription(self._subscription)

    def count_publishers(self) -> int:
        """How many publishers of the topic there are."""
        return int(self._subscription.get_publisher_count())

    def _keep(self, message: bytes) -> None:
        if self._latest is None:
            self._inputs.work.add(self.answer_latest)
        else:
            self._older += 1
        self._latest = message

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
        if self.is_answered:
            self._inputs.skipped(older)
        self.heard_at = time.monotonic()
        self._inputs.attempt(
            self.topic, lambda: self._read(self.topic, decoded(latest, self._kind)), len(latest)
        )


def stamp_of(message: Any) -> Stamp | None:
    """The stamp of a ``message``; None where its type has none."""
    header = getattr(message, 'header', None)
    return Stamp.of(header.stamp) if isinstance(header, Header) else None
