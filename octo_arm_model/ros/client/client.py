"""What an arm's node publishes, as whoever watches sees it, and commands for its tendons."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from octo_arm_msgs.msg import SectionStrains
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from octo_arm_model.config.config import Config, parse_parameters
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.ros.client.command_publisher import CommandPublisher
from octo_arm_model.ros.client.topic import Meter, Topic, read_poses
from octo_arm_model.ros.node.backbone_publishers import LATCHED_QOS
from octo_arm_model.simulation.commands import TOPIC
from octo_arm_model.wire.tension_messages import JOINT_STATE

# What to listen to: shapes, and what else is known of them.
POSES: dict[str, Any] = {'backbone/poses': PoseArray}
DETAILS: dict[str, Any] = {
    'strains': SectionStrains,
    'tendon_lengths': JointState,
    'tip_pose': PoseWithCovarianceStamped,
}
_DIAGNOSTICS_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)


class Shape(NamedTuple):
    """One shape as the node published it.

    Attributes:
        position: of the stations in `base_frame`, base first, (stations, 3) [m].
        quaternion: their orientation x, y, z, w, (stations, 4).
        stamp: time of the tensions it belongs to [s].
        received: time it arrived here [s].
    """

    position: FloatArray
    quaternion: FloatArray
    stamp: float
    received: float


class Strains(NamedTuple):
    """Strains as the node published them, each (stations,); see `Backbone`."""

    model: str
    s: FloatArray
    tau: FloatArray
    xi: FloatArray
    k: FloatArray
    q: FloatArray


class ArmClient:
    """Watches one arm's node, and commands its tendons.

    Attributes:
        command_topic: full name of the topic of the commands.
        config: the arm, as the node describes it; None until it does.
        shape: newest shape of that arm; None until there is one.
        strains: newest strains; None until there are some.
        tensions: those that the newest shape belongs to [N], (tendons,), None until known.
        tip_deviation: standard deviation of the tip's position along x, y, z [m], (3,).
    """

    def __init__(self, node: Node, namespace: str = '') -> None:
        """Speak on ``node``, to the arm in ``namespace``, by default the node's own."""
        self._node = node
        self._prefix = f'{namespace}/' if namespace else ''
        self.command_topic = node.resolve_topic_name(self._prefix + TOPIC)
        self._namespace = self.command_topic.rpartition('/')[0]
        self._commands = CommandPublisher(node, self._prefix + TOPIC)
        description = self._prefix + 'arm_description'
        self._description = Topic(node, String, description, LATCHED_QOS)
        self._health = Topic(node, DiagnosticArray, '/diagnostics', _DIAGNOSTICS_QOS)
        self._topics: dict[str, Topic] = {}
        self._complaints: dict[str, str] = {}
        self._meter, self._counted = Meter(), 0
        self._text = ''
        self.config: Config | None = None
        self._forget()

    def _forget(self) -> None:
        self.shape: Shape | None = None
        self.strains: Strains | None = None
        self.tensions: FloatArray | None = None
        self.tip_deviation = np.zeros(3)

    def listen(self, topics: Mapping[str, Any]) -> None:
        """Listen to ``topics``, such as `POSES` and `DETAILS`, and to no others of the shape.

        Every topic that is listened to takes a little of the node's time.
        """
        for name in self._topics.keys() - topics.keys():
            self._topics.pop(name).close(self._node)
        for name in topics.keys() - self._topics.keys():
            self._topics[name] = Topic(self._node, topics[name], self._prefix + name)
        if not topics:
            self._forget()

    def poll(self) -> bool:
        """Take what has arrived; returns whether there is a new shape.

        Raises:
            OctoArmError: if a node describes an arm that cannot be.
        """
        for message in self._description.take():
            self._describe(message.data)
        for message in self._health.take():
            self._diagnose(message)
        before = self.shape
        for name, topic in self._topics.items():
            for data, info in topic.take_raw():
                self._read(name, data, info)
        return self.shape is not before

    def _read(self, name: str, data: bytes, info: dict[str, Any]) -> None:
        if self.config is None:
            return
        if name == 'backbone/poses':
            self._read_shape(data, info)
            return
        message = deserialize_message(data, DETAILS[name])
        if name == 'strains':
            values = (message.s, message.tau, message.xi, message.k, message.q)
            self.strains = Strains(message.model, *map(np.asarray, values))
        elif name == 'tendon_lengths':
            self._read_tensions(message, self.config.arm)
        else:
            self.tip_deviation = np.sqrt(message.pose.covariance.reshape(6, 6).diagonal()[:3])

    @property
    def problem(self) -> str:
        """What the nodes of the arm last complained of; empty where all is well."""
        return '; '.join(complaint for complaint in self._complaints.values() if complaint)

    def rate(self) -> float:
        """Shapes the node publishes a second [Hz], those passed over here among them."""
        return self._meter.rate(time.time())

    @property
    def latency(self) -> float:
        """From the stamp of the tensions to the arrival of their shape [s]; NaN if none came."""
        return self.shape.received - self.shape.stamp if self.shape else np.nan

    def age(self) -> float:
        """Time since the newest shape arrived [s]; infinite if none did."""
        return time.time() - self.shape.received if self.shape else np.inf

    def command(self, tensions: FloatArray) -> None:
        """Command ``tensions`` [N] of all tendons, in the arm's order.

        Raises:
            TensionError: if one is none, or beyond its limit; then nothing is commanded.
        """
        assert self.config is not None
        self._commands.publish(tensions, self._node.get_clock().now().to_msg())

    def _describe(self, text: str) -> None:
        if text == self._text:
            return
        self._text, self.config = text, None
        self._forget()
        config = Config.from_parameters(parse_parameters(text, 'arm_description'))
        self._commands.use(config)
        self.config = config

    def _diagnose(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id.rpartition('/')[0] != self._namespace:
                continue
            what = status.name.rpartition(': ')[2]
            self._complaints[status.name] = ''
            # That the newest wins is as it should be.
            if status.level != DiagnosticStatus.OK and what != 'output':
                self._complaints[status.name] = f'{what}: {status.message}'

    def _read_tensions(self, message: JointState, arm: Arm) -> None:
        try:
            self.tensions = JOINT_STATE.read(message, arm).ravel()
        except OctoArmError:
            self.tensions = None  # of another arm, whose description is still under way

    def _read_shape(self, data: bytes, info: dict[str, Any]) -> None:
        stamp, poses = read_poses(data)
        if len(poses) < 2:
            return  # no arm
        received = 1e-9 * (info.get('received_timestamp') or time.time_ns())
        self.shape = Shape(poses[:, :3], poses[:, 3:], stamp, received)
        # The publisher counts for us; where the middleware does not tell, only what is taken is.
        self._counted += 1
        number = info.get('publication_sequence_number') or self._counted
        self._meter.count(received, number)
