"""Subscriptions polled for their newest message, and rates of topics."""

from __future__ import annotations

import collections
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from octo_arm_model.ros.messages import decoded

# Best effort: a slow reader never blocks the publisher.
NEWEST_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_WINDOW = 2.0  # [s] over which rates are counted


class Topic:
    """The newest message of a topic; older ones are never taken from the middleware."""

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile = NEWEST_QOS) -> None:
        """Subscribe on ``node``, which need not be spun."""
        self._kind = kind
        self._subscription = node.create_subscription(kind, topic, _never, qos, raw=True)

    def close(self, node: Node) -> None:
        """Unsubscribe."""
        node.destroy_subscription(self._subscription)

    @property
    def publishers(self) -> int:
        """Number of publishers of the topic."""
        return int(self._subscription.get_publisher_count())

    def take_raw(self) -> list[tuple[bytes, dict[str, Any]]]:
        """Serialised messages since the last call, at most the queue's depth, oldest first."""
        taken = []
        handle = self._subscription.handle
        with handle:
            while (message := handle.take_message(self._kind, True)) is not None:
                taken.append(message)
        return taken

    def take(self) -> list[Any]:
        """As `take_raw`, deserialised.

        Raises:
            MessageError: if bytes are no message of the type.
        """
        return [decoded(data, self._kind) for data, _ in self.take_raw()]


class Meter:
    """Rate of events over the last two seconds."""

    def __init__(self) -> None:
        """Start with no events."""
        self._seen: collections.deque[tuple[float, int]] = collections.deque()

    def count(self, now: float, number: int) -> None:
        """Record that ``number`` events have happened by ``now`` [s]; fewer means a restart."""
        if self._seen and number < self._seen[-1][1]:
            self._seen.clear()
        self._seen.append((now, number))

    def rate(self, now: float) -> float:
        """Events per second [Hz] at ``now`` [s]."""
        while self._seen and self._seen[0][0] < now - _WINDOW:
            self._seen.popleft()
        if len(self._seen) < 2:
            return 0.0
        (first, before), (last, after) = self._seen[0], self._seen[-1]
        return (after - before) / max(last - first, 1e-3)


def _never(message: bytes) -> None:
    """Callback that is never called, because the node's messages are taken by `take_raw`."""
