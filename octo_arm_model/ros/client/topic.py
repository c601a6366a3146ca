"""Topics as whoever watches reads them: the newest, taken when asked for."""

from __future__ import annotations

import collections
import struct
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from octo_arm_model.core.hints import FloatArray

# Best effort, so that nobody ever waits for who only looks.
NEWEST_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_START = 4  # bytes that say how the rest is written
_WINDOW = 2.0  # [s] over which rates are counted


class Topic:
    """The newest message of a topic.

    Nothing is done for a message that is passed over: it is not even taken from the middleware.
    """

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile = NEWEST_QOS) -> None:
        """Listen on ``node``; it need not be spun."""
        self._kind = kind
        self._subscription = node.create_subscription(kind, topic, _never, qos, raw=True)

    def close(self, node: Node) -> None:
        """Stop listening."""
        node.destroy_subscription(self._subscription)

    def take_raw(self) -> list[tuple[bytes, dict[str, Any]]]:
        """What has arrived since the last time, at most the depth of the queue, oldest first."""
        taken = []
        handle = self._subscription.handle
        with handle:
            while (message := handle.take_message(self._kind, True)) is not None:
                taken.append(message)
        return taken

    def take(self) -> list[Any]:
        """The same as messages."""
        return [deserialize_message(data, self._kind) for data, _ in self.take_raw()]


class Meter:
    """Counts how often something happens."""

    def __init__(self) -> None:
        """Begin."""
        self._seen: collections.deque[tuple[float, int]] = collections.deque()

    def count(self, now: float, number: int) -> None:
        """At ``now`` [s], ``number`` have happened; fewer than before where it began anew."""
        if self._seen and number < self._seen[-1][1]:
            self._seen.clear()
        self._seen.append((now, number))

    def rate(self, now: float) -> float:
        """How many a second lately [Hz]."""
        while self._seen and self._seen[0][0] < now - _WINDOW:
            self._seen.popleft()
        if len(self._seen) < 2:
            return 0.0
        (first, before), (last, after) = self._seen[0], self._seen[-1]
        return (after - before) / max(last - first, 1e-3)


def read_poses(data: bytes) -> tuple[float, FloatArray]:
    """Stamp [s] and poses (poses, 7) of a serialised geometry_msgs/PoseArray.

    In a tenth of the time that it takes to make an object of each of its numbers.
    """
    order = '<' if data[1] else '>'
    sec, nanosec, length = struct.unpack_from(f'{order}iII', data, _START)
    place = _START + _aligned(12 + length, 4)
    (count,) = struct.unpack_from(f'{order}I', data, place)
    place = _START + _aligned(place + 4 - _START, 8)
    poses = np.frombuffer(data[place : place + 56 * count], f'{order}f8')
    return sec + 1e-9 * nanosec, poses.astype(np.float64).reshape(count, 7)


def _aligned(size: int, step: int) -> int:
    return -(-size // step) * step


def _never(message: bytes) -> None:
    """Messages are taken, not handed over."""
