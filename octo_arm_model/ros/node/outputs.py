"""The publishers of the node: backbone, strains, tip, tendons, frames and markers."""

from collections.abc import Callable
from functools import partial
from typing import Any

from octo_arm_msgs.msg import TendonTensions
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.topics import create_publisher, message_class
from octo_arm_model.ros.work import steady_timer
from octo_arm_model.wire.backbone import (
    BACKBONE_TOPICS,
    TENDON_LENGTHS,
    TENSION_ESTIMATES,
    TENSION_PROFILES,
    BackboneWriter,
    TensionProfilesWriter,
)
from octo_arm_model.wire.markers import FramesWriter, MarkersWriter
from octo_arm_model.wire.messages import Stamp


def is_heard(publisher: Publisher) -> bool:
    """Whether a message published now will be received, or kept for later subscribers."""
    if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        return True
    # Every message needs this, and rclpy's own method takes three times as long.
    return int(publisher.handle.get_subscription_count()) > 0


MARKERS_TOPIC = 'markers'


class MarkerPublisher:
    """Publishes markers of the newest backbone at a limited rate, while somebody subscribes."""

    def __init__(self, node: Node, publisher: Publisher) -> None:
        """Publish by ``publisher`` of ``node``."""
        self._node, self._publisher = node, publisher
        self._writer: MarkersWriter | None = None
        self._timer = steady_timer(node, 1.0, self._on_time)  # runs since the last markers
        self._timer.cancel()
        self._waiting: Callable[[], None] | None = None
        self._is_clean, self._largest = False, 0.0
        self._arm: Arm | None = None
        self._rate = 0.0

    def describe(self, writer: MarkersWriter, rate: float, arm: Arm) -> None:
        """Draw ``arm`` with ``writer`` from now on, at ``rate`` [Hz] at most; 0 for every shape.

        Markers of another arm are deleted first. Markers of the same arm are replaced, for example
        when another hypothesis has become the most probable.
        """
        if arm is not self._arm:
            self._is_clean, self._largest = False, 0.0
        self.forget()
        self._writer, self._arm = writer, arm
        if rate != self._rate:
            self._timer.cancel()
            self._timer.timer_period_ns = round(1e9 / (rate or 1.0))
            self._rate = rate

    def close(self) -> None:
        """Publish nothing any more."""
        self._node.destroy_timer(self._timer)
        self._waiting = self._writer = None

    def forget(self) -> None:
        """Drop the backbone that waits for the timer."""
        self._waiting = None

    def publish(
        self, backbone: Backbone, stamp: Stamp, more: Callable[[], bytes] | None = None
    ) -> None:
        """Publish this backbone now, or when the timer fires unless there is a newer one by then.

        ``more`` makes a message with further markers of the same shape.
        """
        self._waiting = partial(self._draw, backbone, stamp, more)
        if not is_heard(self._publisher):
            self.forget()
        elif not self._rate:
            self._waiting()
        elif self._timer.is_canceled():
            self._timer.reset()
            self._on_time()

    def _on_time(self) -> None:
        """Publish the backbone that waits; if none waits, the next is published at once."""
        draw, self._waiting = self._waiting, None
        if draw is not None:
            draw()
        else:
            self._timer.cancel()

    def _draw(self, backbone: Backbone, stamp: Stamp, more: Callable[[], bytes] | None) -> None:
        if self._writer is None:
            return
        if not self._is_clean:
            # Markers of the previous arm may still be shown.
            self._publisher.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
            self._is_clean = True
        # Red is the largest tension so far, so that colours stay comparable over time.
        self._largest = max(self._largest, float(backbone.tensions.max()))
        self._publisher.publish(self._writer.write(backbone, *stamp, self._largest or None))
        if more is not None:
            self._publisher.publish(more())


OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
# Transient local: late subscribers receive the description too.
LATCHED_QOS = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# The same depth as in tf2_ros, because many nodes share the topic.
TF_TOPIC, TF_TYPE = '/tf', 'tf2_msgs/msg/TFMessage'
TF_QOS = QoSProfile(depth=100)


class BackbonePublishers:
    """Publishes solved backbones on all topics of one node that somebody receives."""

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``; ConfigError if a QoS override is impossible."""
        self._node = node
        self._opened: list[Publisher] = []
        self._path, self._poses, self._strains, self._tip = (
            self._open(message_class(kind), topic) for topic, kind in BACKBONE_TOPICS.items()
        )
        self._lengths = self._open(JointState, TENDON_LENGTHS)
        self._estimates = self._open(TendonTensions, TENSION_ESTIMATES)
        self._profiles = self._open(PointCloud2, TENSION_PROFILES)
        self._description = self._open(String, 'arm_description', LATCHED_QOS)
        self._drawing = MarkerPublisher(node, self._open(MarkerArray, MARKERS_TOPIC))
        self._transforms: Publisher | None = None
        try:
            kind = message_class(TF_TYPE)
        except ConfigError:  # it is in every ROS installation, but in no wheel
            node.get_logger().warning(
                'no frames on /tf: tf2_msgs cannot be imported (apt: ros-jazzy-tf2-msgs)'
            )
        else:
            self._transforms = self._open(kind, TF_TOPIC, TF_QOS)
        self._solver: Solver | None = None  # set by `describe`, as all writers are

    def _open(self, kind: Any, topic: str, qos: QoSProfile = OUTPUT_QOS) -> Publisher:
        """Create a publisher; an impossible QoS override destroys all and is a ConfigError."""
        try:
            publisher = create_publisher(self._node, kind, topic, qos)
        except ConfigError:
            self._destroy()
            raise
        self._opened.append(publisher)
        return publisher

    def close(self) -> None:
        """Destroy the publishers."""
        self._drawing.close()
        self._destroy()

    def _destroy(self) -> None:
        for publisher in self._opened:
            self._node.destroy_publisher(publisher)

    def pause(self) -> None:
        """Drop the backbone that waits for the markers' timer."""
        self._drawing.forget()

    def describe(self, solver: Solver, config: Config) -> None:
        """Prepare the messages for backbones of ``solver``, with the frames of ``config``."""
        arm, grid, frame = solver.arm, solver.grid, config.base_frame
        self._solver = solver
        self._writer = BackboneWriter.of(frame, solver)
        profiles = TensionProfilesWriter(frame, grid.s, arm.tendon_names)
        frames = FramesWriter(arm, grid.s, frame, config.frame_prefix)
        self._written = [
            (self._path, self._writer.path),
            (self._poses, self._writer.poses),
            (self._strains, self._writer.strains),
            (self._lengths, self._write_lengths),
            (self._profiles, profiles.write),
        ]
        if self._transforms is not None:
            self._written.append((self._transforms, frames.write))
        markers = MarkersWriter(arm, grid.s, frame, solver.law.number)
        self._drawing.describe(markers, config.markers_rate, config.arm)

    def announce(self, description: str) -> None:
        """Publish ``description``, the arm as a ROS parameter file."""
        self._description.publish(String(data=description))

    @property
    def is_tip_heard(self) -> bool:
        """Whether somebody receives the pose of the tip, with its covariance."""
        return is_heard(self._tip)

    def publish(
        self,
        backbone: Backbone,
        covariance: FloatArray | None,
        stamp: Stamp,
        more: Callable[[], bytes] | None = None,
    ) -> None:
        """Publish one backbone.

        ``covariance`` (6, 6) is that of the tip pose, or None, which publishes no tip pose.
        ``more`` makes a message with further markers.
        """
        if covariance is not None:
            self._tip.publish(self._writer.tip_pose(backbone, covariance, *stamp))
        # Each message is published before the next one is written, for the least latency.
        for publisher, write in self._written:
            if is_heard(publisher):
                publisher.publish(write(backbone, *stamp))
        self._drawing.publish(backbone, stamp, more)

    def _write_lengths(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        assert self._solver is not None
        lengths = self._solver.tendon_lengths(backbone)
        return self._writer.tendon_lengths(lengths, backbone.tensions, sec, nanosec)

    def publish_tensions(self, backbone: Backbone, stamp: Stamp) -> None:
        """Publish the tensions of all tendons, also of those driven by length."""
        if is_heard(self._estimates):
            self._estimates.publish(self._writer.tensions(backbone.tensions, *stamp))
