"""Publishers of the simulator's other sensors, and of the true shape of an arm that moves."""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseArray,
    PoseWithCovarianceStamped,
    Vector3,
    Wrench,
    WrenchStamped,
)
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.messages import message_class, pose_message
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.qos import create_publisher
from octo_arm_model.ros.simulator.robot_description import STATES
from octo_arm_model.simulation.dynamic_arm import DynamicArm
from octo_arm_model.simulation.parameters import SimulatorConfig
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, BackboneWriter
from octo_arm_model.wire.measurements import BASE_WRENCH, MARKERS, TIP_POSE

TRUE_WRENCH = 'ground_truth/tip_wrench'


class SensorPublishers:
    """Publishes measurements of a pushed arm, each at its rate.

    Attributes:
        time: by which the periods of sensors and push go [s].
    """

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``."""
        self._tip, self._markers, self._wrench, self._truth = (
            create_publisher(node, kind, topic, OUTPUT_QOS)
            for kind, topic in (
                (PoseWithCovarianceStamped, TIP_POSE),
                (PoseArray, MARKERS),
                (WrenchStamped, BASE_WRENCH),
                (WrenchStamped, TRUE_WRENCH),
            )
        )
        self.time = 0.0

    def publish(
        self, config: SimulatorConfig, pushed: FloatArray, elapsed: float, stamp: Time
    ) -> None:
        """Publish what is due after ``elapsed`` [s], of an arm ``pushed`` by a force (3,) [N]."""
        arm, sensors = config.pushed_arm, config.sensors
        assert arm is not None
        before, self.time = self.time, self.time + elapsed
        header = Header(stamp=stamp, frame_id=config.base_frame)
        if config.push.is_at_tip(config.arm.length):
            # What a node of the true shape needs beside the true tensions.
            self._truth.publish(_wrench(header, np.append(pushed, np.zeros(3))))
        pose_due, markers_due, wrench_due = (
            math.floor(rate * self.time) > math.floor(rate * before) for rate in sensors.rates
        )
        if pose_due:
            pose = arm.tip_pose()
            message = PoseWithCovarianceStamped(header=header)
            message.pose.pose = pose_message(np.array(pose.position), np.array(pose.quaternion))
            stddev = np.repeat([sensors.tip_position_stddev, sensors.tip_rotation_stddev], 3)
            message.pose.covariance = np.diag(stddev**2).ravel()
            self._tip.publish(message)
        if markers_due:
            points = [Point(x=x, y=y, z=z) for x, y, z in arm.markers().tolist()]
            self._markers.publish(
                PoseArray(header=header, poses=[Pose(position=point) for point in points])
            )
        if wrench_due:
            measured = arm.base_wrench()
            # About the origin of base_frame, as its header says.
            measured[3:] += np.cross(arm.base_position, measured[:3])
            self._wrench.publish(_wrench(header, measured))


def _wrench(header: Header, values: FloatArray) -> WrenchStamped:
    """Force and moment (6,) [N, N m] as a message."""
    force, torque = (Vector3(x=x, y=y, z=z) for x, y, z in values.reshape(2, 3).tolist())
    return WrenchStamped(header=header, wrench=Wrench(force=force, torque=torque))


class MotionPublishers:
    """Publishes the shape as it is, and tendons as joints: reeled in, rate, tension."""

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``."""
        self._shapes = [
            create_publisher(node, message_class(kind), f'ground_truth/{topic}', OUTPUT_QOS)
            for topic, kind in BACKBONE_TOPICS.items()
        ]
        self._states = create_publisher(node, JointState, STATES, OUTPUT_QOS)
        self._last: tuple[float, FloatArray] | None = None
        self._described: tuple[Config, BackboneWriter] | None = None

    def forget(self) -> None:
        """Take the next state for one at which tendons stand still, as it follows none."""
        self._last = None

    def publish(self, config: Config, arm: DynamicArm, stamp: Time) -> None:
        """Publish the ``arm`` of ``config``."""
        shape, known = arm.backbone, np.zeros((6, 6))
        if self._described is None or self._described[0] is not config:
            writer = BackboneWriter(config.base_frame, shape.model, shape.s, shape.section)
            self._described = config, writer
        messages = self._described[1].all(shape, known, stamp.sec, stamp.nanosec)
        for publisher, data in zip(self._shapes, messages, strict=True):
            publisher.publish(data)
        reeled_in, rate = arm.reeled_in(), np.zeros(len(config.arm.tendons))
        time = arm.state.time
        if self._last is not None and self._last[0] < time:  # another arm begins at 0
            rate = (reeled_in - self._last[1]) / (time - self._last[0])
        self._last = time, reeled_in
        message = JointState(name=list(config.arm.tendon_names), position=reeled_in.tolist())
        message.velocity, message.effort = rate.tolist(), arm.state.tensions.tolist()
        message.header.stamp, message.header.frame_id = stamp, config.base_frame
        self._states.publish(message)
