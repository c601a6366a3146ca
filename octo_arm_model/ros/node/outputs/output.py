"""A publisher whose messages need only be made where somebody receives them."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from octo_arm_model.ros.qos import create_publisher


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
        # Asked for every message: rclpy's own method takes three times as long.
        self._count = self.publisher.handle.get_subscription_count

    @property
    def is_heard(self) -> bool:
        """Whether a message published now will be received."""
        return self._keeps or self._count() > 0

    def publish(self, message: Any) -> None:
        """Publish a ``message``, or the bytes of one."""
        self.publisher.publish(message)
