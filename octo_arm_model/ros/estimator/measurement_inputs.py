"""The subscriptions of the estimator to what is measured besides tensions."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.ros.messages import decoded
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.tension_subscription import (
    LatestSubscription,
    Refuse,
    message_class,
)
from octo_arm_model.ros.work.work_queue import WorkQueue
from octo_arm_model.wire.measurement_messages import MEASUREMENT_TOPICS, MeasuredArm
from octo_arm_model.wire.stamp import Stamp

Take = Callable[[str, Stamp | None, Measurement], None]


class MeasurementInputs:
    """Subscribes to each of `MEASUREMENT_TOPICS` while the node is active."""

    def __init__(
        self,
        node: Node,
        work: WorkQueue,
        diagnostics: Diagnostics,
        arm: Callable[[], MeasuredArm],
        take: Take,
        refuse: Refuse,
    ) -> None:
        """Subscribe to nothing yet.

        Args:
            node: the node that subscribes.
            work: has the turns in which messages are read.
            diagnostics: told who publishes, and how many messages were skipped for newer ones.
            arm: returns the arm that they tell of.
            take: called with the topic, the stamp and the measurement.
            refuse: called with the topic and the error of a message that measures nothing, or
                that ``take`` raises.
        """
        self._node, self._work, self._diagnostics = node, work, diagnostics
        self._arm, self._take, self._refuse = arm, take, refuse
        self._inputs: list[LatestSubscription] = []

    def open(self) -> None:
        """Subscribe."""
        for topic in MEASUREMENT_TOPICS:
            # One by one: where the next cannot be, `close` ends those before it.
            self._inputs.append(self._subscribe(topic))
        publishers = {one.topic: one.count_publishers for one in self._inputs}
        self._diagnostics.publishers |= publishers
        self._diagnostics.apart = frozenset(publishers)

    def _subscribe(self, topic: str) -> LatestSubscription:
        row = MEASUREMENT_TOPICS[topic]
        kind = message_class(row.type_name)

        def read(data: bytes) -> None:
            message = decoded(data, kind)
            measurement = row.read(message, self._arm())
            self._take(found.topic, Stamp.of(message.header.stamp), measurement)

        found = LatestSubscription(
            self._node, kind, topic, read, self._refuse, self._work, self._diagnostics.skipped
        )
        return found

    def close(self) -> None:
        """Unsubscribe from all."""
        for subscription in self._inputs:
            subscription.close()
        self._inputs = []
