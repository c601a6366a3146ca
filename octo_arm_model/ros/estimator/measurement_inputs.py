"""The subscriptions of the estimator to what is measured besides tensions."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.ros.node.tension_subscription import LatestSubscription, message_class
from octo_arm_model.ros.node.work_queue import WorkQueue
from octo_arm_model.wire.measurement_messages import MEASUREMENT_TOPICS, MeasuredArm
from octo_arm_model.wire.stamp import Stamp

Take = Callable[[str, Stamp | None, Measurement, int], None]


class MeasurementInputs:
    """Subscribes to each of `MEASUREMENT_TOPICS` while the node is active."""

    def __init__(
        self,
        node: Node,
        work: WorkQueue,
        arm: Callable[[], MeasuredArm | None],
        take: Take,
        refuse: Callable[[str, OctoArmError], None],
    ) -> None:
        """Subscribe to nothing yet.

        Args:
            node: the node that subscribes.
            work: has the turns in which messages are read.
            arm: returns the arm that they tell of.
            take: called with the topic, the stamp, the measurement and how many messages before it
                were skipped.
            refuse: called with the topic and the error of a message that measures nothing.
        """
        self._node, self._work = node, work
        self._arm, self._take, self._refuse = arm, take, refuse
        self._inputs: list[LatestSubscription] = []

    @property
    def publishers(self) -> dict[str, Callable[[], int]]:
        """Functions that count the publishers of each topic, by its whole name."""
        return {one.topic: one.count_publishers for one in self._inputs}

    def open(self) -> None:
        """Subscribe."""
        for topic in MEASUREMENT_TOPICS:
            self._subscribe(topic)

    def _subscribe(self, topic: str) -> None:
        kind = MEASUREMENT_TOPICS[topic]

        def answer(data: bytes, older: int) -> None:
            arm = self._arm()
            if arm is None:
                return
            try:
                message = found.decode(data)
                measurement = kind.read(message, arm)
            except OctoArmError as error:
                self._refuse(found.topic, error)
                return
            self._take(found.topic, Stamp.of(message.header.stamp), measurement, older)

        of_type = message_class(kind.type_name)
        found = LatestSubscription(self._node, of_type, topic, answer, self._work)
        self._inputs.append(found)

    def close(self) -> None:
        """Unsubscribe from all."""
        for subscription in self._inputs:
            subscription.close()
        self._inputs = []
