"""What is common to messages: their time stamps, and counts of those left out, by reason."""

import re
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from octo_arm_model.arm.errors import MessageError


class Stamp(NamedTuple):
    """Seconds and nanoseconds, as in builtin_interfaces/Time, which is slow to construct."""

    sec: int
    nanosec: int

    @classmethod
    def from_ns(cls, nanoseconds: int) -> 'Stamp':
        """Stamp of a time [ns]."""
        return cls(*divmod(nanoseconds, 10**9))

    @classmethod
    def of(cls, time: Any) -> 'Stamp':
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


_NUMBER = re.compile(r'(?<![A-Za-z_\d])[-+]?(\d+\.?\d*([eE][-+]?\d+)?|nan|inf)\b')
_NEGATIVE = re.compile(r'tension of .* is -[\d.]')
_MOST = 50  # reasons apart; what is beyond is counted together
_OTHER = 'other reasons'


@dataclass
class Refusals:
    """Counts of messages left out.

    Reasons that differ in numbers alone are one. Their number is bounded, whatever comes.

    Attributes:
        counts: by topic and reason without its numbers.
        examples: the first reason of each, in full.
    """

    counts: dict[tuple[str, str], int] = field(default_factory=dict)
    examples: dict[tuple[str, str], str] = field(default_factory=dict)

    def count(self, topic: str, reason: str) -> None:
        """Count a message on ``topic`` that was left out for ``reason``."""
        key = topic, _NUMBER.sub('#', reason)
        if key not in self.counts and len(self.counts) >= _MOST:
            key, reason = (topic, _OTHER), _OTHER
        self.counts[key] = self.counts.get(key, 0) + 1
        self.examples.setdefault(key, reason)

    @property
    def total(self) -> int:
        """How many there are."""
        return sum(self.counts.values())

    def of(self, topic: str) -> dict[str, int]:
        """Counts of one ``topic`` by the first reason of each kind, most frequent first."""
        own = [(self.examples[key], n) for key, n in self.counts.items() if key[0] == topic]
        return dict(sorted(own, key=lambda pair: -pair[1]))

    def lines(self) -> list[str]:
        """A line for each topic and reason, most frequent first; what is of none names none."""
        ordered = sorted(self.counts.items(), key=lambda item: -item[1])
        lines = [
            f'{topic and f"{topic}: "}{count} left out, as {self.examples[topic, kind]}'
            for (topic, kind), count in ordered
        ]
        return lines + self.hints

    @property
    def in_short(self) -> str:
        """The most frequent reason, to end an error message with; '' of none."""
        lines = self.lines()
        return f'; {lines[0]}' if lines else ''

    @property
    def hints(self) -> list[str]:
        """Parameters that would let messages in that were left out."""
        if any(_NEGATIVE.match(example) for example in self.examples.values()):
            return ['load cells: tension_deadband takes readings near zero as zero']
        return []
