"""The publisher of the arm's frames on /tf; `FramesWriter` serialises them."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from octo_arm_model.ros.qos import create_publisher

# As in tf2_ros; frames of many nodes share the topic.
TF_TOPIC = '/tf'
TF_QOS = QoSProfile(depth=100)


def make_broadcaster(node: Node) -> Publisher | None:
    """Publisher of ``tf2_msgs/msg/TFMessage`` on ``/tf``; None, and a log line, without tf2_msgs.

    tf2_msgs is in every ROS installation but has no Python wheel; ``tools/prepare.py`` builds it.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        node.get_logger().warning(
            'no frames on /tf: tf2_msgs cannot be imported (apt: ros-jazzy-tf2-msgs)'
        )
        return None
    return create_publisher(node, TFMessage, TF_TOPIC, TF_QOS)
