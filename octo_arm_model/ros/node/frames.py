"""Frames of the arm for TF: its tip and its anchorages, in the frame of the backbone."""

from __future__ import annotations

from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from octo_arm_model.analysis.arm_mesh import anchorage_stations
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.ros.qos import create_publisher

# What tf2_ros publishes and listens with; frames of many nodes share the topic.
TF_TOPIC = '/tf'
TF_QOS = QoSProfile(depth=100)


def transforms(
    backbone: Backbone, arm: Arm, base_frame: str, prefix: str, stamp: Time
) -> list[TransformStamped]:
    """Frames ``<prefix>tip`` and ``<prefix>anchorage_<i>``, numbered from the tip, of one shape.

    Few on purpose: every listener on ``/tf`` pays for each of them, so stations have none. Their
    x axis is along the tangent, y along n and z along b, like the poses of the backbone. The tip
    and an anchorage at it are two frames in one place.

    Args:
        backbone: a single solution of ``arm``.
        arm: the arm.
        base_frame: frame the backbone is expressed in, parent of all.
        prefix: what the names begin with, to tell several arms apart.
        stamp: time of the shape.
    """
    header = Header(stamp=stamp, frame_id=base_frame)
    stations = anchorage_stations(arm, backbone.s)
    names = ['tip', *(f'anchorage_{number}' for number in range(1, len(stations) + 1))]
    chosen = np.append(-1, stations)
    return [
        TransformStamped(
            header=header,
            child_frame_id=prefix + name,
            transform=Transform(
                translation=Vector3(x=x, y=y, z=z),
                rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
            ),
        )
        for name, (x, y, z), (qx, qy, qz, qw) in zip(
            names, backbone.position[chosen].tolist(), backbone.quaternion[chosen].tolist()
        )
    ]


def make_broadcaster(node: Node) -> Publisher | None:
    """Publisher of ``tf2_msgs/msg/TFMessage`` on ``/tf``; None, and a log line, without tf2_msgs.

    tf2_msgs is in every ROS installation but not among its Python wheels. Publish with
    ``broadcast``.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        node.get_logger().warning(
            'no frames on /tf: tf2_msgs cannot be imported (apt: ros-jazzy-tf2-msgs)'
        )
        return None
    return create_publisher(node, TFMessage, TF_TOPIC, TF_QOS)


def broadcast(broadcaster: Publisher, frames: list[TransformStamped]) -> None:
    """Publish ``frames`` with what `make_broadcaster` made."""
    # The type comes along with the publisher, so that nothing else has to import tf2_msgs.
    message_type: Any = broadcaster.msg_type
    broadcaster.publish(message_type(transforms=frames))
