"""Shapes as they go out: every topic the node publishes its answers on."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from octo_arm_model.backbone import Backbone
from octo_arm_model.hints import FloatArray
from octo_arm_model.ros.messages import backbone_messages, lengths_message, tip_message
from octo_arm_model.solver import Solver

OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
# Whoever comes late still hears what the arm is.
LATCHED_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_TOPICS = (
    (Path, 'backbone/path'),
    (PoseArray, 'backbone/poses'),
    (SectionStrains, 'strains'),
    (PoseWithCovarianceStamped, 'tip_pose'),
    (JointState, 'tendon_lengths'),
)


class Outbox:
    """Publishers of one node."""

    def __init__(self, node: Node) -> None:
        """Open them on ``node``."""
        self._node = node
        self._publishers = [self._open(kind, topic, OUTPUT_QOS) for kind, topic in _TOPICS]
        self._description = self._open(String, 'arm_description', LATCHED_QOS)
        self._solver: Solver | None = None
        self._frame = ''

    def _open(self, kind: Any, topic: str, qos: QoSProfile) -> Any:
        return self._node.create_publisher(
            kind,
            topic,
            qos,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def close(self) -> None:
        """Close them."""
        for publisher in (*self._publishers, self._description):
            self._node.destroy_publisher(publisher)

    def describe(self, solver: Solver, frame: str, prefix: str) -> None:
        """Answers to come are those of ``solver`` in ``frame``."""
        self._solver, self._frame = solver, frame

    def announce(self, description: str) -> None:
        """Publish what the arm is, as a ROS parameter file."""
        self._description.publish(String(data=description))

    def publish(
        self, backbone: Backbone, lengths: FloatArray, covariance: FloatArray, stamp: Time
    ) -> None:
        """Publish one answer on every topic."""
        assert self._solver is not None
        arm, frame = self._solver.arm, self._frame
        messages = (
            *backbone_messages(backbone, stamp, frame),
            tip_message(backbone, covariance, stamp, frame),
            lengths_message(lengths, backbone.tensions, arm, stamp, frame),
        )
        for publisher, message in zip(self._publishers, messages, strict=True):
            publisher.publish(message)
