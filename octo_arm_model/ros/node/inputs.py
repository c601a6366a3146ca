"""The inputs of a node, of which only the latest message counts: tensions and a wrench."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.messages import decoded, message_class, wrench_from_stamped
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.prepared_arm import Prepared
from octo_arm_model.ros.qos import create_subscription
from octo_arm_model.ros.work import WorkQueue
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tension_layout import TensionLayout
from octo_arm_model.wire.tensions import TENSION_TOPICS, FieldMessage, TensionMessage

# Called with a topic and why a message on it is refused.
Refuse: TypeAlias = Callable[[str, OctoArmError], None]

# A best-effort subscription receives from reliable publishers as well. All but the latest of the
# messages in the queue are skipped; its depth limits how many of these are counted.
INPUT_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
TOPICS = tuple(TENSION_TOPICS)
FIELD_TOPIC = 'tendon_tensions/field'


class Intake(NamedTuple):
    """What the subscriptions of a node share.

    Attributes:
        node: the node.
        work: has the turns in which messages are read.
        refuse: called with a topic and why a message on it is refused.
        skipped: called with the number of messages left out for a newer one, before that is read.
    """

    node: Node
    work: WorkQueue
    refuse: Refuse
    skipped: Callable[[int], None] = lambda older: None


class LatestSubscription:
    """Subscription to one topic, of which only the latest message is answered.

    To answer may take longer than the time between two messages. It is a piece of a `WorkQueue`:
    in the callback of a message every message that came meanwhile would be answered before any
    request for parameters is.

    Attributes:
        topic: its whole name, as remapped.
    """

    def __init__(
        self, intake: Intake, kind: Any, topic: str, read: Callable[[bytes], None]
    ) -> None:
        """Subscribe to messages of type ``kind`` on ``topic``.

        ``read`` is called with the bytes of the latest; a message is refused by the OctoArmError
        that it raises.
        """
        self._intake, self._kind, self._read_data = intake, kind, read
        self._latest: bytes | None = None
        self._older = 0
        self._is_due, self._is_open = False, True
        self._subscription = create_subscription(
            intake.node, kind, topic, self._keep, INPUT_QOS, raw=True
        )
        self.topic = self._subscription.topic_name

    def close(self) -> None:
        """Destroy the subscription."""
        self._is_open = False
        self._intake.node.destroy_subscription(self._subscription)

    def count_publishers(self) -> int:
        """How many publishers of the topic there are."""
        return int(self._subscription.get_publisher_count())

    def _keep(self, message: bytes) -> None:
        self._older += self._latest is not None
        self._latest = message
        if not self._is_due:
            self._is_due = True
            self._intake.work.add(self._answer_due)

    def _answer_due(self) -> bool:
        self._is_due = False
        self.answer_latest()
        return False

    def answer_latest(self) -> None:
        """Answer the latest message, if it is not answered yet."""
        if not self._is_open:
            return
        with self._subscription.handle:
            while (taken := self._subscription.handle.take_message(self._kind, True)) is not None:
                self._older += self._latest is not None
                self._latest = taken[0]
        latest, older = self._latest, self._older
        self._latest, self._older = None, 0
        if latest is None:
            return
        self._intake.skipped(older)
        try:
            self._read_data(latest)
        except OctoArmError as error:
            self._intake.refuse(self.topic, error)


class TensionSubscription(LatestSubscription):
    """Subscription to one topic of tensions, which reads its messages."""

    def __init__(
        self,
        intake: Intake,
        topic: str,
        arm: Callable[[], Arm],
        take: Callable[[str, Stamp | None, FloatArray], None],
        *,
        prefix: str = 'tendon_tensions',
        names: Callable[[], Sequence[str]] = tuple,
        message: TensionMessage | FieldMessage | None = None,
    ) -> None:
        """Subscribe.

        The ``topic`` is one of `TENSION_TOPICS`, which says of what type messages are, or another
        with messages of the type ``message``; ``prefix`` replaces 'tendon_tensions' in its name.
        ``arm`` returns the arm that they are for, and ``names`` what its tendons are called there,
        empty for their own names. ``take`` is called with the whole name of the topic, the stamp,
        None where the type has none, and the tensions, of `Arm.tension_shape` [N]; what it raises
        is refused too.
        """
        self._message = TENSION_TOPICS[topic] if message is None else message
        self._arm, self._take, self._names = arm, take, names
        self._layout: TensionLayout | None = None
        name = topic.replace('tendon_tensions', prefix, 1)
        kind = message_class(self._message.type_name)
        super().__init__(intake, kind, name, self._read_latest)

    def _read_latest(self, data: bytes) -> None:
        tensions, stamp = self._read(data, self._arm())
        self._take(self.topic, stamp, tensions)

    def _read(self, data: bytes, arm: Arm) -> tuple[FloatArray, Stamp | None]:
        """Tensions [N] and the stamp of a message, None where its type has none.

        Raises:
            MessageError: if it is no message of the type.
            TensionError: if it is not one for ``arm``.
        """
        layout, wanted = self._layout, self._names()
        if layout is not None and layout.arm is arm and not wanted:
            found = layout.read(data)
            if found is not None:
                return found
        message = decoded(data, self._kind)
        if wanted or isinstance(self._message, FieldMessage):
            tensions = self._message.read_named(message, arm, wanted)
        else:
            tensions = self._message.read(message, arm)
            self._layout = TensionLayout(self._message, data, message, arm)
        header = getattr(message, 'header', None)
        if not isinstance(header, Header):
            return tensions, None
        return tensions, Stamp.of(header.stamp)


def field_of(config: Config) -> FieldMessage | None:
    """Where further messages hold tensions; None where no type of messages is named."""
    given = FieldMessage(config.tension_type, config.tension_field)
    return given if config.tension_type else None


class TensionInputs:
    """The subscriptions of a node to tensions while it is active."""

    def __init__(
        self,
        intake: Intake,
        diagnostics: Diagnostics,
        current: Callable[[], Config],
        take: Callable[[str, Stamp | None, FloatArray], None],
    ) -> None:
        """Subscribe to nothing yet; ``current`` returns the arm that tensions are for.

        Others as in `TensionSubscription`.
        """
        self._intake, self._diagnostics = intake, diagnostics
        self._current, self._take = current, take
        self._inputs: list[TensionSubscription] = []
        self._field_input: TensionSubscription | None = None
        self._is_active = False

    def open(self) -> None:
        """Subscribe."""
        for topic in TOPICS:
            # One by one: where the next cannot be, `close` ends those before it.
            self._inputs.append(self._subscribe(topic))
        self._is_active = True
        self._subscribe_to_field()

    def close(self) -> None:
        """Unsubscribe from all."""
        self._is_active = False
        for subscription in self._inputs:
            subscription.close()
        self._inputs = []
        self._unsubscribe_from_field()

    def change_field(self) -> None:
        """Subscribe to messages of another type, of the arm to come, in the place of the last."""
        if self._is_active:
            # A topic may have another type once the executor has let go of the subscription.
            self._unsubscribe_from_field()
            self._intake.work.add(self._subscribe_to_field)

    def _subscribe(self, topic: str, message: FieldMessage | None = None) -> TensionSubscription:
        made = TensionSubscription(
            self._intake, topic, lambda: self._current().arm, self._take,
            names=lambda: self._current().load_cells.names, message=message,
        )  # fmt: skip
        self._diagnostics.publishers[made.topic] = made.count_publishers
        return made

    def _subscribe_to_field(self) -> bool:
        """Subscribe to messages of the type that the parameters name, if they name one."""
        if (field := field_of(self._current())) is not None and self._field_input is None:
            try:
                self._field_input = self._subscribe(FIELD_TOPIC, field)
            except OctoArmError as error:
                self._intake.node.get_logger().error(
                    f'{FIELD_TOPIC} is not subscribed to: {error}'
                )
        return False

    def _unsubscribe_from_field(self) -> None:
        if self._field_input is not None:
            self._field_input.close()
            self._diagnostics.publishers.pop(self._field_input.topic, None)
        self._field_input = None


class TipWrench:
    """Subscription to wrenches on the tip.

    Attributes:
        value: the last one (6,) [N, N m]; None for none.
    """

    def __init__(
        self, intake: Intake, current: Callable[[], Prepared], heard: Callable[[str], None]
    ) -> None:
        """Subscribe to nothing yet; ``current`` returns the arm that wrenches act on.

        ``heard`` is called with the topic of each that is not refused.
        """
        self._intake, self._current, self._heard = intake, current, heard
        self._latest: LatestSubscription | None = None
        self.value: FloatArray | None = None

    def open(self) -> str:
        """Subscribe; returns the whole name of the topic."""
        self._latest = LatestSubscription(self._intake, WrenchStamped, 'tip_wrench', self._keep)
        return self._latest.topic

    def close(self) -> None:
        """Unsubscribe, and forget the wrench."""
        if self._latest is not None:
            self._latest.close()
        self._latest = self.value = None

    def update(self) -> None:
        """Read a wrench that came before what is answered next."""
        if self._latest is not None:
            self._latest.answer_latest()

    def change_arm(self, before: Prepared | None, now: Prepared) -> None:
        """Drop the wrench, with a warning, where it does not go with another arm."""
        if self.value is None or before is None:
            return
        try:
            now.solver.check_tip_wrench(self.value)
            problem = ''
        except OctoArmError as error:
            problem = str(error)
        given, frame = before.config.base_frame, now.config.base_frame
        if frame != given:
            problem = f'it was given in {given!r}, and base_frame is {frame!r}'
        if problem:
            self.value = None
            self._intake.node.get_logger().warning(f'tip_wrench dropped: {problem}')

    def _keep(self, data: bytes) -> None:
        """Keep the wrench for the tensions to come."""
        prepared, message = self._current(), decoded(data, WrenchStamped)
        wrench = wrench_from_stamped(message, prepared.config.base_frame)
        prepared.solver.check_tip_wrench(wrench)
        self.value = wrench if wrench.any() else None
        if self._latest is not None:
            self._heard(self._latest.topic)
