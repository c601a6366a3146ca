"""The newest steps of an estimator, kept so that measurements may come late."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.validation import check_class
from octo_arm_model.estimation.measurement import Measurement

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
# The next step: after the last one, if any, of a time [s] and what was measured then. Where there
# is one nearby that was found before it is looked for from there.
Advance = Callable[[S | None, float, tuple[Measurement, ...], S | None], S]


class Window(Generic[S]):
    """Steps by their times. What is late is put in its place, and what followed is done again.

    What different sensors measured at one time is one step, so that they are judged together
    whichever of their messages comes first.

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
            raise MeasurementError(f'window is {length}, expected a finite number >= 0 [s]')
        self._advance, self._length = advance, length
        self._steps: list[S] = []
        self._is_cut = False  # whether there were steps before these
        self.late, self.first = 0, np.nan

    @property
    def last(self) -> S | None:
        """The newest step."""
        return self._steps[-1] if self._steps else None

    def add(self, time: float, measurements: Sequence[Measurement]) -> tuple[S, S | None, S]:
        """Take ``measurements`` made at ``time`` [s].

        Where it fails all is as it was. Their step is returned, the step in whose place it is, of
        what else was measured at that time, and the newest one.

        Raises:
            MeasurementError: if they come later than the window.
            SolveError: as the steps.
        """
        if not np.isfinite(time):
            raise MeasurementError(f'time is {time}, expected a finite number [s]')
        steps, taken = self._steps, tuple(measurements)
        for one in taken:
            check_class('a measurement', one, Measurement)
        index = bisect.bisect_right([step.time for step in steps], time)
        # Of two sensors the one measured first may be heard second: it begins the window then.
        if steps and not index and (self._is_cut or time < steps[-1].time - self._length):
            self.late += 1
            raise MeasurementError(
                f'measured at {time:.6g} s, before the window, which begins at '
                f'{steps[0].time:.6g} s'
            )
        before = None
        # Without the step before it a step cannot be done again.
        if index > self._is_cut and _goes_with(steps[index - 1], time, taken):
            before = steps[index - 1]
            taken = before.measurements + taken
        place = index - (before is not None)
        new = steps[:place]
        new.append(self._advance(new[-1] if new else None, time, taken, before))
        for later in steps[index:]:
            new.append(self._advance(new[-1], later.time, later.measurements, later))
        added, newest = new[place], new[-1]
        since = bisect.bisect_left([step.time for step in new], newest.time - self._length)
        # The step before the window is what a late measurement begins from.
        first = max(0, since - 1, len(new) - MAX_STEPS)
        self._steps, self._is_cut = new[first:], self._is_cut or first > 0
        if not steps or time < self.first:
            self.first = time
        return added, before, newest


def _goes_with(step: Timed, time: float, measurements: Sequence[Measurement]) -> bool:
    """Whether ``measurements`` of a ``time`` [s] are of other sensors than a ``step`` of it."""
    names = {one.name for one in step.measurements}
    return step.time == time and not any(one.name in names for one in measurements)
