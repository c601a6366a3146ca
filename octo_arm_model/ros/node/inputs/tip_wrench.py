"""The wrench on the tip, which acts until the next one comes."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import WrenchStamped

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.ros.messages import decoded, wrench_from_stamped
from octo_arm_model.ros.node.inputs.tension_subscription import Intake, LatestSubscription
from octo_arm_model.ros.node.prepared_arm import Prepared


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
