"""Poses of the frames of sensors, from /tf_static and /tf."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from octo_arm_model.arm.errors import MeasurementError, OctoArmError, in_short
from octo_arm_model.arm.pose import Pose
from octo_arm_model.experiment.transform_tree import TransformTree
from octo_arm_model.ros.node.inputs import LONGEST, NotKnownYet
from octo_arm_model.ros.node.outputs import TF_QOS, TF_TOPIC, TF_TYPE
from octo_arm_model.ros.topics import create_subscription, is_overridden, message_class
from octo_arm_model.ros.work import on_jump_back
from octo_arm_model.terminal import RefusalLog
from octo_arm_model.wire.messages import Stamp

_STATIC_TOPIC = '/tf_static'
_STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_HISTORY = 10 * 10**9  # [ns] for which poses of moving frames are kept, as in tf2
_MOST = 1000  # frames
_LARGEST = 1000  # transforms of one message


class SensorFrames:
    """Listens to transforms once a message is in another frame than that of the arm.

    It listens to /tf only while static transforms do not lead to every such frame: /tf has many
    transforms, among them those that this node publishes.
    """

    def __init__(self, node: Node, on_change: Callable[[], None]) -> None:
        """Create it without subscriptions; ``on_change`` is called after new transforms."""
        self._node, self._on_change = node, on_change
        self._log = RefusalLog(node.get_logger().warning)
        self._subscriptions: dict[str, Subscription] = {}
        self._tree = TransformTree()
        self._moving = set[str]()  # frames that static transforms do not lead to
        self._complete_at = -math.inf  # time by which transforms published before have come [s]
        # If time jumps back, moving frames have been elsewhere at the times to come.
        self._jumps = on_jump_back(node, self.close)

    def open(self) -> None:
        """Check QoS overrides of the topics of transforms; ConfigError if one is impossible."""
        for topic, qos in ((_STATIC_TOPIC, _STATIC_QOS), (TF_TOPIC, TF_QOS)):
            if is_overridden(self._node, 'subscription', topic):
                self._listen(topic, qos)
        self.close()

    def close(self) -> None:
        """Unsubscribe, and forget all transforms."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions, self._tree = {}, TransformTree()
        self._moving.clear()

    def pose_of(self, frame: str, target: str, stamp_ns: int) -> Pose:
        """Return the pose of ``frame`` in ``target`` at ``stamp_ns`` [ns].

        Raises:
            NotKnownYet: if transforms lead to it, but not yet for that time, or if it has listened
                to transforms for a short time only.
            MeasurementError: if the pose is not known.
            ConfigError: if tf2_msgs is not installed.
        """
        self._listen_for(frame, target)
        try:
            return self._tree.pose(frame, target, stamp_ns)
        except MeasurementError as error:
            reason = f'its frame is {frame[:99]!r}, and {error}'
            latest = -math.inf if time.monotonic() < self._complete_at else math.inf
            if self._known_until(frame, target, latest) < stamp_ns:
                until = partial(self._known_until, frame, target, -math.inf)
                raise NotKnownYet(reason, lambda: until() >= stamp_ns) from None
            raise MeasurementError(reason) from None

    def are_fixed(self, frame: str, other: str) -> bool:
        """Whether known static transforms lead from ``frame`` to ``other``."""
        are_fixed = math.isinf(self._known_until(frame, other, 0.0))
        if are_fixed:
            self._listen_for(frame, other)  # /tf is no longer needed for this frame
        return are_fixed

    def is_beyond(self, frame: str, other: str) -> bool:
        """Whether known transforms lead from the root to ``frame`` through ``other``."""
        try:
            return other in self._tree.chain(frame)
        except MeasurementError:
            return False

    def _known_until(self, frame: str, target: str, otherwise: float = math.inf) -> float:
        """Return the last stamp of known poses [ns], or ``otherwise`` if no transforms connect."""
        try:
            return self._tree.known_until(frame, target)
        except MeasurementError:
            return otherwise

    def _listen_for(self, frame: str, target: str) -> None:
        """Subscribe to the topics that may connect ``frame`` to ``target``."""
        if math.isinf(self._known_until(frame, target, 0.0)):
            self._moving.discard(frame)
        elif len(self._moving) < _MOST:
            self._moving.add(frame)
        if _STATIC_TOPIC not in self._subscriptions:
            self._listen(_STATIC_TOPIC, _STATIC_QOS)
        if self._moving and TF_TOPIC not in self._subscriptions:
            self._listen(TF_TOPIC, TF_QOS)
        elif not self._moving and TF_TOPIC in self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop(TF_TOPIC))

    def _listen(self, topic: str, qos: QoSProfile) -> None:
        kind, take = message_class(TF_TYPE), partial(self._take, topic)
        self._complete_at = time.monotonic() + LONGEST
        self._subscriptions[topic] = create_subscription(self._node, kind, topic, take, qos)

    def _take(self, topic: str, message: Any) -> None:
        count = len(message.transforms)
        if count > _LARGEST:
            problem = f'it has {count} transforms, expected at most {_LARGEST}'
            self._log.add(f'{topic} refused', problem)
            return
        for transform in message.transforms:
            try:
                self._add(transform, topic == _STATIC_TOPIC)
            except OctoArmError as error:
                frame = transform.child_frame_id[:99]
                self._log.add(f'{topic} refused', f'{frame!r}: {in_short(error)}')
        self._tree.forget(_HISTORY, _MOST)
        self._on_change()

    def _add(self, transform: Any, is_static: bool) -> None:
        translation, rotation = transform.transform.translation, transform.transform.rotation
        pose = Pose(
            (translation.x, translation.y, translation.z),
            (rotation.x, rotation.y, rotation.z, rotation.w),
            ('transform.translation', 'transform.rotation'),
        )
        stamp = Stamp.of(transform.header.stamp).ns
        self._tree.add(
            transform.header.frame_id,
            transform.child_frame_id,
            stamp,
            np.array(pose.position),
            np.array(pose.quaternion),
            is_static,
        )
