"""How long the friction history is valid in a sequence of tensions with time stamps."""

from __future__ import annotations

import dataclasses

from octo_arm_model.rod.backbone import Backbone


class FrictionMemory:
    """Discards the friction history of a sequence after gaps in time.

    Attributes:
        forgotten: how many times the history was discarded because of a gap.
    """

    def __init__(self) -> None:
        """Begin without any time stamp."""
        self._newest_ns: dict[str, int] = {}
        self.forgotten = 0

    def recall(
        self, last: Backbone | None, time_ns: int, seconds: float, source: str = ''
    ) -> Backbone | None:
        """Solution to continue from at ``time_ns`` [ns]: the ``last`` one, as far as it is valid.

        None where the time of a ``source`` goes back, as when a sequence starts over; stamps of
        different sources, such as load cells and encoders, need not be ordered. After a gap of
        more than ``seconds`` [s] without stamps (0: no limit) the motion of the tendons in between
        is unknown: the solution is returned without its history, as if pulled from slack.
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
        # Still the start of the continuation of a loaded arm.
        return dataclasses.replace(last, point_tensions=None)
