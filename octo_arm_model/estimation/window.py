"""The newest steps of an estimator, kept so that measurements may come late."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

from octo_arm_model.core.errors import MeasurementError
from octo_arm_model.estimation.measurements import Measurement

MAX_STEPS = 1000  # that a window holds


class Timed(Protocol):
    """A step: a time [s], and what was measured then."""

    @property
    def time(self) -> float:
        """When [s]."""

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """What was measured."""


S = TypeVar('S', bound=Timed)
# The next step: after the last one, if any, of a time [s] and what was measured then.
Advance = Callable[[S | None, float, tuple[Measurement, ...]], S]


class Window(Generic[S]):
    """Steps by their times. What is late is put in its place, and what followed is done again.

    Attributes:
        late: how many times came later than the window.
        first: time of the first step of all [s]; NaN before it.
    """

    def __init__(self, advance: Advance[S], length: float) -> None:
        """For measurements up to ``length`` [s] late.

        Raises:
            MeasurementError: if the number is outside its range.
        """
        if not 0.0 <= length < np.inf:
            raise MeasurementError(f'window is {length!r}, expected a finite number >= 0 [s]')
        self._advance, self._length = advance, length
        self._steps: list[S] = []
        self.late, self.first = 0, np.nan

    @property
    def last(self) -> S | None:
        """The newest step."""
        return self._steps[-1] if self._steps else None

    def add(self, time: float, measurements: Sequence[Measurement]) -> tuple[S, S]:
        """The step of ``measurements`` made at ``time`` [s], and the newest one.

        Where it fails all is as it was.

        Raises:
            MeasurementError: if they come later than the window.
            SolveError: as the steps.
        """
        if not np.isfinite(time):
            raise MeasurementError(f'time is {time!r}, expected a finite number [s]')
        steps, taken = self._steps, tuple(measurements)
        index = bisect.bisect_right([step.time for step in steps], time)
        if steps and not index:
            self.late += 1
            raise MeasurementError(
                f'measured at {time:.6g} s, before the window, which begins at '
                f'{steps[0].time:.6g} s'
            )
        new = steps[:index]
        for at, made in [(time, taken), *((s.time, s.measurements) for s in steps[index:])]:
            new.append(self._advance(new[-1] if new else None, at, made))
        added, newest = new[index], new[-1]
        since = bisect.bisect_left([step.time for step in new], newest.time - self._length)
        # The step before the window is what a late measurement begins from.
        self._steps = new[max(0, since - 1, len(new) - MAX_STEPS) :]
        if not steps:
            self.first = time
        return added, newest
