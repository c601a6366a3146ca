"""Time stamps of messages."""

from __future__ import annotations

from typing import Any, NamedTuple


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
