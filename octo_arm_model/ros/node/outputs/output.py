"""A publisher whose messages need only be made where somebody receives them."""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from octo_arm_model.ros.qos import create_publisher

_STILL_HEARD = 0.1  # [s] after it was, that who is gone may still be published to


class Output:
    """A publisher of a node, and whether what it publishes reaches anybody.

    Attributes:
        publisher: the publisher.
    """

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile) -> None:
        """Publish messages of type ``kind`` on ``topic``, see `create_publisher`.

        Raises:
            ConfigError: if an override of a QoS policy cannot be.
        """
        self.publisher: Publisher = create_publisher(node, kind, topic, qos)
        durability = self.publisher.qos_profile.durability
        # What it keeps, a later subscriber receives as well.
        self._keeps = durability == DurabilityPolicy.TRANSIENT_LOCAL
        # For every message: rclpy's own methods take three times as long.
        self._count = self.publisher.handle.get_subscription_count
        self._publish_bytes = self.publisher.handle.publish_raw
        self._heard_until = 0.0

    @property
    def is_heard(self) -> bool:
        """Whether a message published now will be received."""
        if self._keeps:
            return True
        now = time.monotonic()
        if now >= self._heard_until and self._count() > 0:
            self._heard_until = now + _STILL_HEARD
        return now < self._heard_until

    def publish(self, message: Any) -> None:
        """Publish a ``message``, or the bytes of one."""
        if isinstance(message, bytes):
            self._publish_bytes(message)
        else:
            self.publisher.publish(message)
