"""Which inputs of a node are heard, and which of them have gone silent."""

from __future__ import annotations

import time
from collections.abc import Callable


class HeardInputs:
    """When each input was heard last.

    Attributes:
        apart: whole names of topics that are no further source of tensions.
        unanswered: those among them whose messages have no answer of their own.
        is_used: whether what came last on a topic still counts.
    """

    def __init__(self) -> None:
        """Begin to listen."""
        self.apart: frozenset[str] = frozenset()
        self.unanswered: frozenset[str] = frozenset()
        self.is_used: Callable[[str], bool] = lambda topic: True
        self.begin()

    def begin(self) -> None:
        """Listen from now on: nothing is heard yet."""
        self._began = time.monotonic()
        self._is_answered = False
        self._last: dict[str, tuple[str, float]] = {}

    def source(self, topic: str) -> str:
        """Key of the input of ``topic``: one for all of tensions, which may replace each other."""
        return topic if topic in self.apart else ''

    def note(self, topic: str) -> None:
        """Note a message on ``topic``."""
        self._last[self.source(topic)] = topic, time.monotonic()
        self._is_answered |= topic not in self.unanswered

    def silent(self, limit: float) -> list[str]:
        """A sentence for each used input without a message for more than ``limit`` [s]."""
        now = time.monotonic()
        silent = [
            f'{topic} is silent for {now - heard:.1f} s'
            for topic, heard in sorted(self._last.values())
            if now - heard > limit and self.is_used(topic)
        ]
        if not self._is_answered and now - self._began > limit:
            silent.append(f'silent for {now - self._began:.1f} s')
        return silent
