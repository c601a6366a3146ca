"""Stations of the results: where along the arm a backbone is known; and values between rows.

Anchorages and loads split the arm into *panels*, and are stations. Strains are smooth inside a
panel and may jump between panels.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import MAX_STATIONS
from octo_arm_model.rod.elements import SAME_LENGTH, apart

DEFAULT_STATIONS = 101


class Panel(NamedTuple):
    """The part of the arm between two neighbouring anchorages, loads or ends of the arm.

    Attributes:
        start: arc coordinate of the end towards the base [m].
        stop: arc coordinate of the end towards the tip [m].
        section: number from the tip of the section it belongs to; 0 beyond the last anchorage.
    """

    start: float
    stop: float
    section: int

    @property
    def length(self) -> float:
        """Reference length [m]."""
        return self.stop - self.start


def panels_of(arm: Arm, breaks: tuple[float, ...] = ()) -> tuple[Panel, ...]:
    """Panels of ``arm`` from the base to the tip, cut at ``breaks`` [m] as well."""
    anchorages = [section.anchorage for section in arm.sections]
    own = {*anchorages} - {0.0, arm.length}
    inside = own.union(apart(breaks, [0.0, *own, arm.length], arm.length))
    ends = [0.0, *sorted(inside), arm.length]
    return tuple(
        Panel(start, stop, sum(anchorage >= stop for anchorage in anchorages))
        for start, stop in itertools.pairwise(ends)
    )


@dataclass(frozen=True)
class StationGrid:
    """Stations, spread over the panels in proportion to their lengths.

    Attributes:
        s: arc coordinate of the stations [m], (stations,), from base to tip.
        section: section of each station, numbered from the tip, (stations,); 0 beyond the last
            anchorage. An anchorage belongs to the section towards the base, where its tendons
            act.
    """

    s: FloatArray
    section: IntArray

    @classmethod
    def build(
        cls, arm: Arm, stations: int = DEFAULT_STATIONS, breaks: tuple[float, ...] = ()
    ) -> StationGrid:
        """Distribute ``stations`` stations over ``arm``, among them anchorages and ``breaks``.

        Raises:
            ConfigError: if ``stations`` is less than both ends, anchorages and breaks take, or
                more than `MAX_STATIONS`.
        """
        panels = panels_of(arm, breaks)
        if isinstance(stations, bool) or not isinstance(stations, (int, np.integer)):
            raise ConfigError(f'stations is {shown(stations)}, expected an integer')
        if stations > MAX_STATIONS:
            raise ConfigError(f'stations is {stations}, expected at most {MAX_STATIONS}')
        if stations < len(panels) + 1:
            what = 'every anchorage and load' if breaks else 'every anchorage'
            raise ConfigError(
                f'stations is {stations}, expected at least {len(panels) + 1} '
                f'for both ends of the arm and {what}'
            )
        counts = _share_intervals([panel.length for panel in panels], int(stations) - 1)
        parts = [
            np.linspace(panel.start, panel.stop, count + 1)[1:]
            for panel, count in zip(panels, counts, strict=True)
        ]
        s = np.concatenate([[0.0], *parts])
        section = np.repeat([panel.section for panel in panels], [counts[0] + 1, *counts[1:]])
        s.setflags(write=False)
        section.setflags(write=False)
        return cls(s, section)


def _share_intervals(lengths: list[float], total: int) -> list[int]:
    """Distribute ``total`` intervals in proportion to ``lengths``, at least one each.

    Each interval is added to the panel with the longest intervals, to the first of equally long
    ones, so that the stations of similar arms are the same fractions of their lengths.
    """
    # Lower bounds: the proportional part of the intervals beyond one each, rounded down.
    unit = sum(lengths) / max(total - len(lengths), 1)
    counts = [max(1, int(length / unit * (1.0 - SAME_LENGTH))) for length in lengths]
    for _ in range(total - sum(counts)):
        intervals = [length / count for length, count in zip(lengths, counts, strict=True)]
        longest = max(intervals) * (1.0 - SAME_LENGTH)
        counts[next(i for i, interval in enumerate(intervals) if interval >= longest)] += 1
    return counts


# Between rows of numbers -------------------------------------------------------------------------


def interpolated(at: FloatArray | float, x: FloatArray, rows: FloatArray) -> FloatArray:
    """Interpolate ``rows`` (n, ...) at ascending ``x`` (n,) to ``at``: (*at.shape, ...).

    Constant before the first and after the last ``x``.
    """
    columns = rows.reshape(len(rows), -1).T
    found = np.stack([np.interp(at, x, column) for column in columns], axis=-1)
    return found.reshape(*np.shape(at), *rows.shape[1:])


def nearest(at: FloatArray, x: FloatArray) -> IntArray:
    """Index of the element of ascending ``x`` (n,) that is nearest to each ``at``."""
    return np.searchsorted(0.5 * (x[1:] + x[:-1]), at)
