"""Stamps of measurements: of receipt where there is none, and refused where they cannot be."""

from __future__ import annotations

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.ros.node.diagnostics import SteppedClock
from octo_arm_model.wire.stamp import Stamp

_BACK = 1.0  # [s] beyond the window by which the stamps of one sensor run back, to begin anew


class Stamps:
    """Resolves the stamps of measurements, and finds stamps that run back.

    Attributes:
        ahead: how far a stamp may be ahead of the clock [s].
    """

    def __init__(self, clock: SteppedClock) -> None:
        """Compare with ``clock``."""
        self._clock = clock
        self._newest: dict[str, Stamp] = {}
        self.ahead = 0.0

    def forget(self) -> None:
        """Begin anew."""
        self._newest.clear()

    def resolve(self, stamp: Stamp | None) -> Stamp:
        """The ``stamp`` of a message; the time of receipt where it has none.

        Raises:
            MessageError: if it is no time.
            MeasurementError: if it is ahead of the clock: all that is measured until then would be
                late.
        """
        at = self._clock.time_of(stamp)
        ahead = self._clock.ahead(at, self._clock.now_ns)
        if ahead > self.ahead:
            raise MeasurementError(
                f'its stamp is {ahead:.6g} s ahead of the clock, expected at most '
                f'{self.ahead:g} s (diagnostics.ahead_limit)'
            )
        return at

    def runs_back(self, topic: str, stamp: Stamp, window: float) -> float:
        """By how much the stamps of ``topic`` run back [s]; 0 where they are at most late.

        As they do where a bag is played again.
        """
        newest = self._newest.get(topic, stamp)
        self._newest[topic] = max(stamp, newest)
        back = 1e-9 * (newest.ns - stamp.ns)
        return back if back > window + _BACK else 0.0
