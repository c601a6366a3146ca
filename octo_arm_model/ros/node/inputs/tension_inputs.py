"""All topics that tensions come on, the one of a type that the parameters name among them."""

from __future__ import annotations

from collections.abc import Callable

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.node.diagnostics import Diagnostics
from octo_arm_model.ros.node.inputs.tension_subscription import (
    FIELD_TOPIC,
    TOPICS,
    Intake,
    TensionSubscription,
)
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tension_messages import FieldMessage


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
