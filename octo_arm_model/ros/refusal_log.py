"""Warnings of what comes on topics, at most one a second of each."""

from __future__ import annotations

import time

from rclpy.node import Node

from octo_arm_model.arm.errors import OctoArmError, in_short

WARNING_PERIOD = 1.0  # [s] between warnings of one topic


class RefusalLog:
    """Warns of refused messages.

    Every topic has a period of its own, so that what is refused often does not hide what is
    refused seldom. The logger's own throttle looks up the calling line, which takes longer than to
    solve an arm.
    """

    def __init__(self, node: Node) -> None:
        """Warn by the logger of ``node``."""
        self._node = node
        self._next: dict[str, float] = {}

    def warn(self, topic: str, error: OctoArmError) -> None:
        """Say why a message on ``topic``, a subscribed one, is refused; nothing if too soon."""
        if self._is_time(topic):
            self._node.get_logger().warning(f'{topic} refused: {in_short(error)}')

    def say(self, topic: str, words: str) -> None:
        """Warn of what a message on ``topic`` led to, besides those refused."""
        if self._is_time(f'{topic}:'):
            self._node.get_logger().warning(f'{topic}: {words}')

    def _is_time(self, key: str) -> bool:
        now = time.monotonic()
        if now < self._next.get(key, now):
            return False
        self._next[key] = now + WARNING_PERIOD
        return True
