"""Time stamps of messages, and counts of messages left out, by reason."""

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from octo_arm_model.arm.errors import MessageError


class Stamp(NamedTuple):
    """Seconds and nanoseconds, as in builtin_interfaces/Time, which is slow to construct."""

    sec: int
    nanosec: int

    @classmethod
    def from_ns(cls, nanoseconds: int) -> 'Stamp':
        """Return the stamp of a time [ns]."""
        return cls(*divmod(nanoseconds, 10**9))

    @classmethod
    def of(cls, time: Any) -> 'Stamp':
        """Return the stamp of a builtin_interfaces/Time, whichever library decoded it."""
        return cls(time.sec, time.nanosec)

    @property
    def ns(self) -> int:
        """The time [ns]."""
        return self.sec * 10**9 + self.nanosec


def time_of(stamp: Stamp | None) -> Stamp | None:
    """Return the ``stamp`` of a message; None if it has none or it is not set.

    Raises:
        MessageError: if it is not a valid time, at which the clocks of subscribers would raise.
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
_MOST = 50  # reasons that are counted apart; all further ones are counted together
_OTHER = 'other reasons'


@dataclass
class Refusals:
    """Counts of messages left out.

    Reasons that differ only in numbers count as one. The number of reasons is bounded.
    """

    #: counts by topic and by reason without its numbers
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    #: the first full reason of each of these
    examples: dict[tuple[str, str], str] = field(default_factory=dict)

    def count(self, topic: str, reason: str) -> None:
        """Count a message on ``topic`` that was left out for ``reason``."""
        key = topic, _NUMBER.sub('#', reason)
        if key not in self.counts and len(self.counts) >= _MOST:
            key, reason = (topic, _OTHER), _OTHER
        self.counts[key] += 1
        self.examples.setdefault(key, reason)

    @property
    def total(self) -> int:
        """Number of messages left out."""
        return self.counts.total()

    def of(self, topic: str) -> dict[str, int]:
        """Return the counts on one ``topic`` by example of the reason, most frequent first."""
        return {self.examples[k]: n for k, n in self.counts.most_common() if k[0] == topic}

    def lines(self) -> list[str]:
        """Return a line for each topic (if not '') and reason, most frequent first, and hints."""
        lines = [
            f'{topic and f"{topic}: "}{count} left out, as {self.examples[topic, kind]}'
            for (topic, kind), count in self.counts.most_common()
        ]
        return lines + self.hints

    @property
    def in_short(self) -> str:
        """The most frequent reason, as the end of an error message; '' if there is none."""
        lines = self.lines()
        return f'; {lines[0]}' if lines else ''

    @property
    def hints(self) -> list[str]:
        """Hints at parameters with which messages would not have been left out."""
        if any(_NEGATIVE.match(example) for example in self.examples.values()):
            return ['load cells: tension_deadband takes readings near zero as zero']
        return []
