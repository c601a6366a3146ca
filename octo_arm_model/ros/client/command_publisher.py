"""Publisher of commanded tensions, which refuses those beyond a tendon's limit."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike
from octo_arm_msgs.msg import TendonTensions
from rclpy.node import Node

from octo_arm_model.config.config import Config
from octo_arm_model.ros.messages import tensions_message
from octo_arm_model.ros.node.outputs.backbone_publishers import OUTPUT_QOS
from octo_arm_model.simulation.profiles.limits import check_command, tendon_limits


class CommandPublisher:
    """Publishes tensions for the tendons of one arm at a time.

    Attributes:
        publisher: the ROS publisher, to count its subscriptions.
    """

    def __init__(self, node: Node, topic: str, config: Config | None = None) -> None:
        """Publish on ``topic`` of ``node``, for the arm of ``config`` or that of `use`."""
        self.publisher: Any = node.create_publisher(TendonTensions, topic, OUTPUT_QOS)
        self._config: Config | None = None
        if config is not None:
            self.use(config)

    def use(self, config: Config) -> None:
        """Command the tendons of ``config`` from now on, up to their limits."""
        self._config, self._limits = config, tendon_limits(config)

    def publish(self, tensions: ArrayLike, stamp: Time, frame: str = '') -> None:
        """Publish ``tensions`` (tendons,) or as `Arm.tension_shape` [N] of all tendons.

        Raises:
            TensionError: if they do not fit this arm, or one is beyond its limit; then nothing is
                published.
        """
        assert self._config is not None
        arm = self._config.arm
        checked = check_command(arm, tensions, self._limits)
        self.publisher.publish(tensions_message(checked, arm, stamp, frame))
