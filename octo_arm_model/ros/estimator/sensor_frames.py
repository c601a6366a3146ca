"""Where the frames of sensors are, from /tf_static and /tf."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from octo_arm_model.core.errors import MeasurementError, OctoArmError, in_short
from octo_arm_model.core.rod.kinematics import Pose
from octo_arm_model.experiment.recording.transform_tree import TransformTree
from octo_arm_model.ros.node.outputs.frames import TF_QOS, TF_TOPIC
from octo_arm_model.ros.qos import create_subscription
from octo_arm_model.ros.refusal_log import RefusalLog
from octo_arm_model.wire.stamp import Stamp

_STATIC_TOPIC = '/tf_static'
_STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_HISTORY = 10 * 10**9  # [ns] of moving frames, as of tf2
_MOST = 1000  # frames
_LARGEST = 1000  # transforms of one message


class SensorFrames:
    """Listens to transforms once a message is in another frame than the arm's.

    To those that move only where the static ones do not lead to it: there are many of them, among
    them this node's own.
    """

    def __init__(self, node: Node) -> None:
        """Listen to nothing yet."""
        self._node, self._log = node, RefusalLog(node)
        self._subscriptions: dict[str, Subscription] = {}
        self._tree = TransformTree()

    def close(self) -> None:
        """Listen no more, and forget all."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions, self._tree = {}, TransformTree()

    def pose_of(self, frame: str, target: str, stamp_ns: int) -> Pose:
        """Pose of ``frame`` in ``target`` at ``stamp_ns`` [ns].

        Raises:
            MeasurementError: if it is not known.
        """
        if _STATIC_TOPIC not in self._subscriptions:
            self._listen(_STATIC_TOPIC, _STATIC_QOS)
        elif not self._tree.connects(frame, target) and TF_TOPIC not in self._subscriptions:
            self._listen(TF_TOPIC, TF_QOS)
        try:
            return self._tree.pose(frame, target, stamp_ns)
        except MeasurementError as error:
            raise MeasurementError(f'its frame is {frame[:99]!r}, and {error}') from None

    def _listen(self, topic: str, qos: QoSProfile) -> None:
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError as error:
            raise MeasurementError(
                'there are no transforms: tf2_msgs cannot be imported (apt: ros-jazzy-tf2-msgs)'
            ) from error
        take = partial(self._take, topic)
        self._subscriptions[topic] = create_subscription(self._node, TFMessage, topic, take, qos)

    def _take(self, topic: str, message: Any) -> None:
        try:
            if len(message.transforms) > _LARGEST:
                count = len(message.transforms)
                raise MeasurementError(f'it has {count} transforms, expected at most {_LARGEST}')
            for one in message.transforms:
                self._add(one, topic == _STATIC_TOPIC)
        except OctoArmError as error:
            self._log.warn(topic, error)
        self._tree.forget(_HISTORY)

    def _add(self, one: Any, is_static: bool) -> None:
        shift, turn = one.transform.translation, one.transform.rotation
        try:
            pose = Pose((shift.x, shift.y, shift.z), (turn.x, turn.y, turn.z, turn.w))
        except OctoArmError as error:
            raise MeasurementError(f'{one.child_frame_id[:99]!r}: {in_short(error)}') from None
        stamp = Stamp.of(one.header.stamp).ns
        frames = self._tree.frames
        if len(frames) >= _MOST and one.child_frame_id not in frames:
            raise MeasurementError(f'there are {_MOST} frames already, which is the most')
        self._tree.add(
            one.header.frame_id, one.child_frame_id, stamp,
            np.array(pose.position), np.array(pose.quaternion), is_static,
        )  # fmt: skip
