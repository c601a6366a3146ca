"""Messages as they come in: the newest of what has arrived, as bytes until it is wanted."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from octo_arm_msgs.msg import TendonTensions
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import MessageError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.ros.interruption import interruptible
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


class Newest:
    """Subscription to one topic, of which only the newest message counts.

    Answering may take longer than the time between two messages. It is a task of its own, behind
    what the executor has to do already: in the callback of a message it would be done anew for
    every message that came meanwhile, before any service gets its turn.

    Attributes:
        topic: its whole name, as remapped.
    """

    def __init__(
        self, node: Node, kind: Any, topic: str, answer: Callable[[bytes, int], None]
    ) -> None:
        """Call ``answer`` with the newest message and how many older ones were passed over.

        Messages are of type ``kind``.
        """
        self._node, self._kind, self._answer = node, kind, answer
        self._newest: bytes | None = None
        self._older = 0
        self._is_due, self._is_open = False, True
        self._subscription = create_subscription(
            node, kind, topic, self._keep, INPUT_QOS, raw=True
        )
        self.topic = self._subscription.topic_name

    def close(self) -> None:
        """Stop listening."""
        self._is_open = False
        self._node.destroy_subscription(self._subscription)

    def count_publishers(self) -> int:
        """How many publishers of the topic there are."""
        return int(self._subscription.get_publisher_count())

    def _keep(self, message: bytes) -> None:
        self._older += self._newest is not None
        self._newest = message
        if not self._is_due:
            executor = self._node.executor
            assert executor is not None  # it is what calls here
            self._is_due = True
            executor.create_task(interruptible(self._answer_due))

    def _answer_due(self) -> None:
        self._is_due = False
        try:
            self.answer_newest()
        except RuntimeError:
            # A signal ends the context in the middle of whatever is done: no fault of anybody's.
            if self._node.context.ok():
                raise

    def answer_newest(self) -> None:
        """Answer the newest message, if there is one that is not answered yet."""
        if not self._is_open:
            return
        with self._subscription.handle:
            while (taken := self._subscription.handle.take_message(self._kind, True)) is not None:
                self._older += self._newest is not None
                self._newest = taken[0]
        newest, older = self._newest, self._older
        self._newest, self._older = None, 0
        if newest is not None:
            self._answer(newest, older)

    def decode(self, data: bytes) -> Any:
        """The message.

        Raises:
            MessageError: if it is no message of the type.
        """
        try:
            return deserialize_message(data, self._kind)
        except Exception as error:
            # Whatever the middleware raises for bytes that are none of its own.
            problem = f'{len(data)} bytes that are no {self._kind.__name__}'
            raise MessageError(problem) from error


class Inbox(Newest):
    """Subscription to one topic of tensions."""

    def __init__(
        self,
        node: Node,
        topic: str,
        answer: Callable[[Inbox, bytes, int], None],
        prefix: str = 'tendon_tensions',
    ) -> None:
        """Call ``answer`` with this, the newest message and how many older ones it passed over.

        Messages are of the type of ``topic``, and it is heard under a name that begins with
        ``prefix``.
        """
        type_name, self._read = READERS[topic]
        self._familiar: Familiar | None = None
        name = topic.replace('tendon_tensions', prefix, 1)
        super().__init__(node, _CLASSES[type_name], name, partial(answer, self))

    def read(self, data: bytes, arm: Arm) -> tuple[FloatArray, Stamp | None]:
        """Tensions [N] and the stamp of a message, None where its type has none.

        Raises:
            MessageError: if it is no message of the type.
            TensionError: if it is not one for ``arm``.
        """
        familiar = self._familiar
        if familiar is not None and familiar.arm is arm:
            found = familiar.read(data)
            if found is not None:
                return found
        message = self.decode(data)
        tensions = self._read(message, arm)
        if self._kind is TendonTensions:
            self._familiar = Familiar(data, message.name, arm)
        header = getattr(message, 'header', None)
        return tensions, Stamp(header.stamp.sec, header.stamp.nanosec) if header else None
