"""Tensions as they come in: the newest of what has arrived, as bytes until it is wanted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from octo_arm_msgs.msg import TendonTensions
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import TensionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.ros.qos import create_subscription
from octo_arm_model.wire.tension_messages import READERS
from octo_arm_model.wire.tension_template import Familiar, Stamp

# Best effort hears reliable publishers as well. What waits is passed over for the newest, but
# while there is room it is counted.
INPUT_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

_CLASSES: dict[str, Any] = {
    'octo_arm_msgs/msg/TendonTensions': TendonTensions,
    'std_msgs/msg/Float64MultiArray': Float64MultiArray,
    'sensor_msgs/msg/JointState': JointState,
}
TOPICS = tuple(READERS)


class Inbox:
    """Subscription to one topic of tensions.

    Attributes:
        topic: its whole name, as remapped.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        answer: Callable[[Inbox, bytes, int], None],
        prefix: str = 'tendon_tensions',
    ) -> None:
        """Call ``answer`` with the newest message and how many older ones were passed over.

        Messages are of the type of ``topic``, and it is heard under a name that begins with
        ``prefix``.
        """
        name = topic.replace('tendon_tensions', prefix, 1)
        type_name, self._read = READERS[topic]
        self._type = _CLASSES[type_name]
        self._answer, self._context = answer, node.context
        self._familiar: Familiar | None = None
        self._subscription = create_subscription(
            node, self._type, name, self._drain, INPUT_QOS, raw=True
        )
        self.topic = self._subscription.topic_name

    def close(self, node: Node) -> None:
        """Stop listening."""
        node.destroy_subscription(self._subscription)

    def _drain(self, newest: bytes) -> None:
        try:
            self._answer_newest(newest)
        except RuntimeError:
            # A signal ends the context in the middle of whatever is done: no fault of anybody's.
            if self._context.ok():
                raise

    def _answer_newest(self, newest: bytes) -> None:
        older = 0
        with self._subscription.handle:
            while True:
                taken = self._subscription.handle.take_message(self._type, True)
                if taken is None:
                    break
                newest = taken[0]
                older += 1
        self._answer(self, newest, older)

    def read(self, data: bytes, arm: Arm) -> tuple[FloatArray, Stamp | None]:
        """Tensions [N] and the stamp of a message, None where its type has none.

        Raises:
            TensionError: if it is no message of the type, or not one for ``arm``.
        """
        familiar = self._familiar
        if familiar is not None and familiar.arm is arm:
            found = familiar.read(data)
            if found is not None:
                return found
        message, stamp = self.decode(data)
        tensions = self._read(message, arm)
        if self._type is TendonTensions:
            self._familiar = Familiar(data, message.name, arm)
        return tensions, stamp

    def decode(self, data: bytes) -> tuple[Any, Stamp | None]:
        """A message and its stamp.

        Raises:
            TensionError: if it is no message of the type.
        """
        try:
            message = deserialize_message(data, self._type)
        except Exception as error:
            # Whatever the middleware raises for bytes that are none of its own.
            raise TensionError(f'{len(data)} bytes that are no {self._type.__name__}') from error
        header = getattr(message, 'header', None)
        if header is None:
            return message, None
        return message, Stamp(header.stamp.sec, header.stamp.nanosec)
