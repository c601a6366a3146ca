"""Outputs of the simulator besides tensions, and who commands it."""

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs import msg as geometry
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.topics import create_publisher, message_class, pose_message
from octo_arm_model.simulation.dynamic_arm import DynamicArm
from octo_arm_model.simulation.simulator import STATES, SimulatorConfig
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, BackboneWriter
from octo_arm_model.wire.measurements import BASE_WRENCH, MARKERS, TIP_POSE
from octo_arm_model.wire.tensions import DISPLACEMENTS

TRUE_WRENCH = 'ground_truth/tip_wrench'
# What a simulator follows, as its diagnostics say.
COMMANDS, PROFILE = 'commands', 'profile'
NO_COMMAND, PAUSED = 'no command', 'nothing, as it is paused'


class ArmPublishers:
    """Publishes readings of encoders and of sensors, and the motion of a dynamic arm.

    The motion has the true shape, and the tendons as joints with displacement, rate and tension.
    """

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``."""
        self._encoders, self._tip, self._markers, self._wrench, self._truth, *others = (
            create_publisher(node, kind, topic, OUTPUT_QOS)
            for kind, topic in (
                (JointState, DISPLACEMENTS),
                (geometry.PoseWithCovarianceStamped, TIP_POSE),
                (geometry.PoseArray, MARKERS),
                (geometry.WrenchStamped, BASE_WRENCH),
                (geometry.WrenchStamped, TRUE_WRENCH),
                (JointState, STATES),
                *((message_class(k), f'ground_truth/{t}') for t, k in BACKBONE_TOPICS.items()),
            )
        )
        self._states, *self._shapes = others
        self._described: tuple[Config, BackboneWriter] | None = None

    def publish(
        self,
        config: SimulatorConfig,
        pushed: FloatArray,
        before: FloatArray,
        times_ns: tuple[int, int],
        stamp: Time,
    ) -> None:
        """Publish what is due between two ``times_ns``; ``pushed`` (3,) is the push force [N].

        ``before`` (tendons,) are the lengths that were reeled in at the first of the times [m].
        """
        arm, sensors = config.pushed_arm, config.sensors
        assert arm is not None
        header = Header(stamp=stamp, frame_id=config.model.base_frame)
        if config.hardware.winches.encoders:
            names, lengths = list(config.model.arm.tendon_names), arm.reeled_in().tolist()
            self._encoders.publish(JointState(header=header, name=names, position=lengths))
        if config.push.is_at_tip(config.model.arm.length):
            # A node that computes the true shape needs this besides the true tensions.
            self._truth.publish(_wrench(header, np.append(pushed, np.zeros(3))))
        pose_due, markers_due, wrench_due = (
            len({math.floor(rate * time_ns / 1e9) for time_ns in times_ns}) > 1
            for rate in sensors.rates
        )
        if pose_due:
            pose = arm.tip_pose()
            message = geometry.PoseWithCovarianceStamped(header=header)
            message.pose.pose = pose_message(np.array(pose.position), np.array(pose.quaternion))
            stddev = np.repeat([sensors.tip_position_stddev, sensors.tip_rotation_stddev], 3)
            message.pose.covariance = np.diag(stddev**2).ravel()
            self._tip.publish(message)
        if markers_due:
            points = [geometry.Point(x=x, y=y, z=z) for x, y, z in arm.markers().tolist()]
            self._markers.publish(
                geometry.PoseArray(
                    header=header, poses=[geometry.Pose(position=point) for point in points]
                )
            )
        if wrench_due:
            measured = arm.base_wrench()
            # The moment is about the origin of base_frame, which the header names.
            measured[3:] += np.cross(arm.backbone.position[0], measured[:3])
            self._wrench.publish(_wrench(header, measured))
        if isinstance(arm, DynamicArm):
            self._publish_shape(config.model, arm, header)
            elapsed, reeled_in = 1e-9 * (times_ns[1] - times_ns[0]), arm.reeled_in()
            # At time 0 the arm is where its first tensions hold it at rest.
            rate = (reeled_in - before) / elapsed if arm.state.time and elapsed else 0.0 * before
            message = JointState(header=header, name=list(config.model.arm.tendon_names))
            message.position, message.velocity = reeled_in.tolist(), rate.tolist()
            message.effort = arm.state.tensions.tolist()
            self._states.publish(message)

    def _publish_shape(self, config: Config, arm: DynamicArm, header: Header) -> None:
        shape, zero = arm.backbone, np.zeros((6, 6))
        if self._described is None or self._described[0] is not config:
            writer = BackboneWriter(config.base_frame, shape.model, shape.s, shape.section)
            self._described = config, writer
        messages = self._described[1].all(shape, zero, header.stamp.sec, header.stamp.nanosec)
        for publisher, data in zip(self._shapes, messages.values(), strict=True):
            publisher.publish(data)


def _wrench(header: Header, values: FloatArray) -> geometry.WrenchStamped:
    """Return a message with force and moment ``values`` (6,) [N, N m]."""
    force, torque = (geometry.Vector3(x=x, y=y, z=z) for x, y, z in values.reshape(2, 3).tolist())
    return geometry.WrenchStamped(
        header=header, wrench=geometry.Wrench(force=force, torque=torque)
    )


# The commanded quantity, by its unit N or m, and its value, by tendon.
Command = Mapping[str, tuple[str, float]]
_SWITCHES = 3  # changes of the publisher that make a contradiction: one is a handover
_APART = 1e9  # distance between commands of different quantities


class Commanders:
    """Detects publishers whose commands contradict each other.

    rclpy does not tell which publisher a message is from. If a topic has several publishers, a
    command nearer to the one before the last than to the last counts as that of another publisher.
    A command on another topic always does, unless it equals the last command.
    """

    def __init__(self, node: Node) -> None:
        """Watch the commands that ``node`` receives."""
        self._node = node
        self._last: tuple[str, Command] | None = None
        self._before: dict[str, Command] = {}
        self._switches = 0
        self._topics: Counter[str] = Counter()

    def note(self, topic: str, command: Command) -> None:
        """Record an accepted ``command`` on ``topic``."""
        last, self._last = self._last, (topic, command)
        if last is None:
            return
        distance = _distance(command, last[1])
        before = self._before.get(topic)
        self._before[last[0]] = last[1]
        if not distance:
            return
        is_other = last[0] != topic
        if not is_other and before is not None and self._node.count_publishers(topic) > 1:
            is_other = _distance(command, before) < 0.5 * distance
        if is_other:
            self._switches += 1
            self._topics.update((topic, last[0]))

    def report(self) -> str:
        """Return a sentence about recent contradictions, with the publishers' names, or ''."""
        switches, self._switches = self._switches, self._switches // 2
        topics, self._topics = sorted(self._topics), Counter()
        if switches < _SWITCHES or not topics:
            return ''
        sources = []
        for topic in topics:
            infos = self._node.get_publishers_info_by_topic(topic)
            names = {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos}
            sources.append(f'{topic} of {", ".join(sorted(names)) or "nobody any more"}')
        return f'commanders contradict each other: {"; ".join(sources)}'


def _distance(command: Command, other: Command) -> float:
    """Return the distance between two commands, summed over the tendons that both name."""
    distance = 0.0
    for name in command.keys() & other.keys():
        (kind, value), (other_kind, other_value) = command[name], other[name]
        distance += abs(value - other_value) if kind == other_kind else _APART
    return distance
