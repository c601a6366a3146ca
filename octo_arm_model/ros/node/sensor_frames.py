"""Where the frames of sensors are, from /tf_static and /tf."""

import math
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
from octo_arm_model.ros.node.inputs import NotKnownYet
from octo_arm_model.ros.node.outputs import TF_QOS, TF_TOPIC
from octo_arm_model.ros.start import RefusalLog
from octo_arm_model.ros.topics import create_subscription, is_overridden
from octo_arm_model.wire.messages import Stamp

_STATIC_TOPIC = '/tf_static'
_STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_HISTORY = 10 * 10**9  # [ns] of moving frames, as of tf2
_MOST = 1000  # frames
_LARGEST = 1000  # transforms of one message


class SensorFrames:
    """Listens to transforms from the first message in another frame than the arm's on.

    To those that move no longer than until the static ones lead to every such frame: there are
    many of them, among them this node's own.
    """

    def __init__(self, node: Node, on_change: Callable[[], None]) -> None:
        """Listen to nothing yet; ``on_change`` is called when there are further transforms."""
        self._node, self._log, self._on_change = node, RefusalLog(node), on_change
        self._subscriptions: dict[str, Subscription] = {}
        self._tree = TransformTree()
        self._moving = set[str]()  # frames that static transforms do not lead to

    def open(self) -> None:
        """Check policies that are given of what may be listened to later.

        Raises:
            OctoArmError: if one cannot be.
        """
        for topic, qos in ((_STATIC_TOPIC, _STATIC_QOS), (TF_TOPIC, TF_QOS)):
            if is_overridden(self._node, 'subscription', topic):
                self._listen(topic, qos)
        self.close()

    def close(self) -> None:
        """Listen no more, and forget all."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions, self._tree = {}, TransformTree()
        self._moving.clear()

    def pose_of(self, frame: str, target: str, stamp_ns: int) -> Pose:
        """Pose of ``frame`` in ``target`` at ``stamp_ns`` [ns].

        Raises:
            NotKnownYet: if transforms lead to it, and not yet for that time.
            MeasurementError: if it is not known.
        """
        self._listen_for(frame, target)
        try:
            return self._tree.pose(frame, target, stamp_ns)
        except MeasurementError as error:
            reason = f'its frame is {frame[:99]!r}, and {error}'
            if self._known_until(frame, target) < stamp_ns:
                until = partial(self._known_until, frame, target, -math.inf)
                raise NotKnownYet(reason, lambda: until() >= stamp_ns) from None
            raise MeasurementError(reason) from None

    def are_fixed(self, frame: str, other: str) -> bool:
        """Whether static transforms that are known lead from one ``frame`` to the other."""
        are_fixed = math.isinf(self._known_until(frame, other, 0.0))
        if are_fixed:
            self._listen_for(frame, other)  # no longer to those that move
        return are_fixed

    def is_beyond(self, frame: str, other: str) -> bool:
        """Whether transforms that are known lead to ``frame`` by the ``other``."""
        try:
            return other in self._tree.chain(frame)
        except MeasurementError:
            return False

    def _known_until(self, frame: str, target: str, otherwise: float = math.inf) -> float:
        """The last stamp of known poses [ns]; ``otherwise`` where no transforms lead there."""
        try:
            return self._tree.known_until(frame, target)
        except MeasurementError:
            return otherwise

    def _listen_for(self, frame: str, target: str) -> None:
        """Listen to what may lead from ``frame`` to ``target``."""
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
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError as error:
            raise MeasurementError(
                'there are no transforms: tf2_msgs cannot be imported (apt: ros-jazzy-tf2-msgs)'
            ) from error
        take = partial(self._take, topic)
        self._subscriptions[topic] = create_subscription(self._node, TFMessage, topic, take, qos)

    def _take(self, topic: str, message: Any) -> None:
        count = len(message.transforms)
        if count > _LARGEST:
            problem = f'it has {count} transforms, expected at most {_LARGEST}'
            self._log.warn(topic, MeasurementError(problem))
            return
        for one in message.transforms:
            try:
                self._add(one, topic == _STATIC_TOPIC)
            except OctoArmError as error:
                frame = one.child_frame_id[:99]
                self._log.warn(topic, MeasurementError(f'{frame!r}: {in_short(error)}'))
        self._tree.forget(_HISTORY)
        self._on_change()

    def _add(self, one: Any, is_static: bool) -> None:
        shift, turn = one.transform.translation, one.transform.rotation
        pose = Pose.called(
            'transform.translation',
            'transform.rotation',
            (shift.x, shift.y, shift.z),
            (turn.x, turn.y, turn.z, turn.w),
        )
        stamp = Stamp.of(one.header.stamp).ns
        frames = self._tree.frames
        if len(frames) >= _MOST and one.child_frame_id not in frames:
            raise MeasurementError(f'there are {_MOST} frames already, which is the most')
        self._tree.add(
            one.header.frame_id,
            one.child_frame_id,
            stamp,
            np.array(pose.position),
            np.array(pose.quaternion),
            is_static,
        )
