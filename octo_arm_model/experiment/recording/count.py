"""Progress of work whose amount becomes known on the way."""

from __future__ import annotations

from collections.abc import Callable


class Count:
    """Counts work done, and the work that is known of so far.

    Attributes:
        done: so much.
        total: of so much.
    """

    def __init__(self, report: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Call ``report`` with both numbers as they change."""
        self._report, self.done, self.total = report, 0, 0

    def expect(self, more: int) -> None:
        """Know of ``more``."""
        self.total += more
        self._report(self.done, self.total)

    def add(self, some: int = 1) -> None:
        """Have done ``some`` more."""
        self.done += some
        self._report(self.done, self.total)
