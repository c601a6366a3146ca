"""The publishers of the node: backbone, strains, tip, tendons, frames and markers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from octo_arm_msgs.msg import TendonTensions
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.messages import message_class
from octo_arm_model.ros.node.outputs.markers import MARKERS_TOPIC, MarkerPublisher
from octo_arm_model.ros.node.outputs.output import Output
from octo_arm_model.wire.cdr.backbone import (
    BACKBONE_TOPICS,
    TENDON_LENGTHS,
    TENSION_ESTIMATES,
    BackboneWriter,
)
from octo_arm_model.wire.cdr.drawing import FramesWriter, MarkersWriter
from octo_arm_model.wire.cdr.tension_profiles import TENSION_PROFILES, TensionProfilesWriter
from octo_arm_model.wire.stamp import Stamp

OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
# Transient local: late subscribers receive the description too.
LATCHED_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# As in tf2_ros; frames of many nodes share the topic.
TF_TOPIC = '/tf'
TF_QOS = QoSProfile(depth=100)


class BackbonePublishers:
    """Publishes solved backbones on all topics of one node that somebody receives."""

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``.

        Raises:
            ConfigError: if an override of a QoS policy cannot be; then there are none.
        """
        self._node = node
        self._opened: list[Output] = []
        self._path, self._poses, self._strains, self._tip = (
            self._open(message_class(kind), topic) for topic, kind in BACKBONE_TOPICS.items()
        )
        self._lengths = self._open(JointState, TENDON_LENGTHS)
        self._estimates = self._open(TendonTensions, TENSION_ESTIMATES)
        self._profiles = self._open(PointCloud2, TENSION_PROFILES)
        self._description = self._open(String, 'arm_description', LATCHED_QOS)
        self._drawing = MarkerPublisher(node, self._open(MarkerArray, MARKERS_TOPIC))
        kind = frames_class(node)
        self._transforms = None if kind is None else self._open(kind, TF_TOPIC, TF_QOS)
        self._solver: Solver | None = None  # until `describe`, as all writers

    def _open(self, kind: Any, topic: str, qos: QoSProfile = OUTPUT_QOS) -> Output:
        """Create a publisher; a bad QoS override is a ConfigError, and leaves no publishers."""
        try:
            output = Output(self._node, kind, topic, qos)
        except ConfigError:
            self._destroy()
            raise
        self._opened.append(output)
        return output

    def close(self) -> None:
        """Destroy the publishers."""
        self._drawing.stop()
        self._destroy()

    def _destroy(self) -> None:
        for output in self._opened:
            self._node.destroy_publisher(output.publisher)

    def pause(self) -> None:
        """Drop the backbone that waits for the markers' timer."""
        self._drawing.forget()

    def describe(self, solver: Solver, config: Config) -> None:
        """Prepare the messages for backbones of ``solver``, with the frames of ``config``."""
        arm, grid, frame = solver.arm, solver.grid, config.base_frame
        self._solver = solver
        self._writer = BackboneWriter(frame, solver.model, grid.s, grid.section, arm.tendon_names)
        self._profiles_writer = TensionProfilesWriter(frame, grid.s, arm.tendon_names)
        self._frames = FramesWriter(arm, grid.s, frame, config.frame_prefix)
        markers = MarkersWriter(arm, grid.s, frame, widen=solver.law.widens)
        self._drawing.describe(markers, config.markers_rate, config.arm)

    def announce(self, description: str) -> None:
        """Publish ``description``, the arm as a ROS parameter file."""
        self._description.publish(String(data=description))

    @property
    def is_tip_heard(self) -> bool:
        """Whether somebody receives the pose of the tip, with its covariance."""
        return self._tip.is_heard

    def publish(
        self,
        backbone: Backbone,
        covariance: FloatArray | None,
        stamp: Stamp,
        more: Callable[[], bytes] | None = None,
    ) -> None:
        """Publish one backbone.

        ``covariance`` (6, 6) is that of the tip; None where `is_tip_heard` has said that it need
        not be known. ``more`` makes a message of further markers.
        """
        assert self._solver is not None
        writer = self._writer
        # Published before the next one is written, for the least latency of each.
        if self._path.is_heard:
            self._path.publish(writer.path(backbone, *stamp))
        if self._poses.is_heard:
            self._poses.publish(writer.poses(backbone, *stamp))
        if self._strains.is_heard:
            self._strains.publish(writer.strains(backbone, *stamp))
        if covariance is not None:
            self._tip.publish(writer.tip_pose(backbone, covariance, *stamp))
        if self._transforms is not None and self._transforms.is_heard:
            self._transforms.publish(self._frames.write(backbone, *stamp))
        if self._lengths.is_heard:
            lengths = self._solver.tendon_lengths(backbone)
            self._lengths.publish(writer.tendon_lengths(lengths, backbone.tensions, *stamp))
        if self._profiles.is_heard:
            self._profiles.publish(self._profiles_writer.write(backbone, *stamp))
        self._drawing.publish(backbone, stamp, more)

    def publish_tensions(self, backbone: Backbone, stamp: Stamp) -> None:
        """Publish the tensions that hold the tendons driven by length, and those of the others."""
        if self._estimates.is_heard:
            self._estimates.publish(self._writer.tensions(backbone.tensions, *stamp))


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
