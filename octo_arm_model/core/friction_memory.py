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
        self._newest_ns: dict[str, int] = {}
        self.forgotten = 0

    def recall(
        self, last: Backbone | None, time_ns: int, seconds: float, source: str = ''
    ) -> Backbone | None:
        """What to continue from at ``time_ns`` [ns], of the ``last`` solution.

        Nothing where the time of a ``source`` goes back, as sequences start over; two sources,
        such as load cells and encoders, need not be stamped in order. After a gap of more than
        ``seconds`` [s] in which none told anything nobody knows what tendons did: then it comes
        without its history, so that they are pulled from slack; 0 for never.
        """
        newest = self._newest_ns
        if time_ns < newest.get(source, time_ns):
            self._newest_ns = {source: time_ns}
            return None
        gap = time_ns - max(newest.values(), default=time_ns)
        newest[source] = time_ns
        if not 0.0 < seconds < 1e-9 * gap:
            return last
        if last is None or last.point_tensions is None:
            return last
        self.forgotten += 1
        # A loaded arm is still followed from there.
        return dataclasses.replace(last, point_tensions=None)
