"""The arm's frames on /tf; `FramesWriter` serialises them."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

# As in tf2_ros; frames of many nodes share the topic.
TF_TOPIC = '/tf'
TF_QOS = QoSProfile(depth=100)


def frames_class(node: Node) -> Any | None:
    """The class ``tf2_msgs/msg/TFMessage``; None, and a log line of ``node``, without tf2_msgs.

    tf2_msgs is in every ROS installation but has no Python wheel; ``tools/prepare.py`` builds it.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        node.get_logger().warning(
            'no frames on /tf: tf2_msgs cannot be imported (apt: ros-jazzy-tf2-msgs)'
        )
        return None
    return TFMessage
