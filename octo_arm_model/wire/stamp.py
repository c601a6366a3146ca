"""Time stamps of messages."""

from __future__ import annotations

from typing import Any, NamedTuple

from octo_arm_model.arm.errors import MessageError


class Stamp(NamedTuple):
    """Seconds and nanoseconds, as in builtin_interfaces/Time, which is slow to construct."""

    sec: int
    nanosec: int

    @classmethod
    def from_ns(cls, nanoseconds: int) -> Stamp:
        """Stamp of a time [ns]."""
        return cls(*divmod(nanoseconds, 10**9))

    @classmethod
    def of(cls, time: Any) -> Stamp:
        """Stamp of a builtin_interfaces/Time of whichever library decoded it."""
        return cls(time.sec, time.nanosec)

    @property
    def ns(self) -> int:
        """The time [ns]."""
        return self.sec * 10**9 + self.nanosec


def time_of(stamp: Stamp | None) -> Stamp | None:
    """The ``stamp`` of a message; None where it has none or an unset one.

    Raises:
        MessageError: if it is no time: the clocks of subscribers raise at such a stamp.
    """
    if stamp is None or not any(stamp):
        return None
    if stamp.sec < 0 or stamp.nanosec >= 10**9:
        raise MessageError(
            f'its stamp is {stamp.sec} s and {stamp.nanosec} ns, expected s >= 0 and '
            'ns < 1000000000'
        )
    return stamp
