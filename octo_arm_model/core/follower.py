"""One arm through a sequence of tensions: what the node and a replay of its bags do alike."""

from __future__ import annotations

import dataclasses

from numpy.typing import ArrayLike

from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.solver import Solver


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


class Follower:
    """Solves each set of tensions from the last, with the history of tendons with friction.

    Attributes:
        memory: what counts how often that was forgotten.
    """

    def __init__(self, solver: Solver, seconds: float) -> None:
        """Begin with slack tendons; ``seconds`` is as in `FrictionMemory.recall`."""
        self._solver, self._seconds = solver, seconds
        self._last: Backbone | None = None
        self.memory = FrictionMemory()

    def follow(
        self, tensions: ArrayLike, time_ns: int, tip_wrench: ArrayLike | None = None
    ) -> Backbone:
        """Shape under ``tensions`` at ``time_ns`` [ns]; see `Solver.follow`.

        Raises:
            OctoArmError: as `Solver.solve`.
        """
        self._last = self.memory.recall(self._last, time_ns, self._seconds)
        self._last = self._solver.follow(tensions, self._last, tip_wrench)
        return self._last
