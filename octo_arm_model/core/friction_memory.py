"""For how long the history of tendons with friction counts in a sequence of tensions."""

from __future__ import annotations

import dataclasses

from octo_arm_model.core.rod.backbone import Backbone


class FrictionMemory:
    """For how long the history of tendons with friction counts.

    Attributes:
        forgotten: how many times it was forgotten because of a gap in time.
    """

    def __init__(self) -> None:
        """Begin at no time."""
        self._time_ns: int | None = None
        self.forgotten = 0

    def recall(self, last: Backbone | None, time_ns: int, seconds: float) -> Backbone | None:
        """What to continue from at ``time_ns`` [ns], of the ``last`` solution.

        Nothing where time goes back, as sequences start over. After a gap of more than ``seconds``
        [s] nobody knows what tendons did in between: then it comes without its history, so that
        they are pulled from slack; 0 for never.
        """
        gap = time_ns - self._time_ns if self._time_ns is not None else 0
        self._time_ns = time_ns
        if gap < 0:
            return None
        if not 0.0 < seconds < 1e-9 * gap:
            return last
        if last is None or last.point_tensions is None:
            return last
        self.forgotten += 1
        # A loaded arm is still followed from there.
        return dataclasses.replace(last, point_tensions=None)
