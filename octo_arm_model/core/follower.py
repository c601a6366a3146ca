"""One arm through a sequence of tensions: what the node and a replay of its bags do alike."""

from __future__ import annotations

import dataclasses

from numpy.typing import ArrayLike

from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.solver import Solver


class Follower:
    """Solves each set of tensions from the last, with the history of tendons that have friction.

    Attributes:
        forgotten: how many times the history was forgotten because of a gap in time.
    """

    def __init__(self, solver: Solver, memory: float) -> None:
        """Begin with slack tendons.

        After a gap of more than ``memory`` [s] tendons are pulled from slack anew, as nobody knows
        what they did in between; 0 for never.
        """
        self._solver, self._memory_ns = solver, round(1e9 * memory)
        self._last: Backbone | None = None
        self._time_ns: int | None = None
        self.forgotten = 0

    @property
    def has_history(self) -> bool:
        """Whether tendons with friction slide from where they were."""
        return self._last is not None and self._last.point_tensions is not None

    def restart(self) -> None:
        """Continue from nothing, as where time starts over."""
        self._last = self._time_ns = None

    def follow(
        self, tensions: ArrayLike, time_ns: int | None, tip_wrench: ArrayLike | None = None
    ) -> Backbone:
        """Shape under ``tensions`` at ``time_ns`` [ns], None if unknown; see `Solver.follow`.

        Where time goes back the sequence starts over.

        Raises:
            OctoArmError: as `Solver.solve`.
        """
        if time_ns is not None:
            if self._time_ns is not None:
                self._pass_time(time_ns - self._time_ns)
            self._time_ns = time_ns
        self._last = self._solver.follow(tensions, self._last, tip_wrench)
        return self._last

    def _pass_time(self, gap_ns: int) -> None:
        if gap_ns < 0:
            self._last = None
        elif self._last is not None and self.has_history and 0 < self._memory_ns < gap_ns:
            # Where loads are, it is still followed from there.
            self._last = dataclasses.replace(self._last, point_tensions=None)
            self.forgotten += 1
