"""What the simulator publishes of an arm that moves."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.messages import message_class
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.qos import create_publisher
from octo_arm_model.ros.simulator.robot_description import STATES
from octo_arm_model.simulation.dynamic_arm import DynamicArm
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, BackboneWriter


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
