"""The stations of a backbone, and interpolation between rows of numbers.

Anchorages and loads split the arm into *panels*, and are stations. Strains are smooth inside a
panel and may jump between panels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import MAX_STATIONS
from octo_arm_model.rod.elements import SAME_LENGTH, panel_ends

DEFAULT_STATIONS = 101


@dataclass(frozen=True)
class StationGrid:
    """Stations, spread over the panels in proportion to their lengths."""

    s: FloatArray  #: arc coordinate of the stations [m], (stations,), from base to tip
    #: section of each station, numbered from the tip, (stations,); 0 beyond the last anchorage. An
    #: anchorage belongs to the section towards the base, where its tendons act.
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
        ends = panel_ends(arm, breaks)
        if isinstance(stations, bool) or not isinstance(stations, (int, np.integer)):
            raise ConfigError(f'stations is {shown(stations)}, expected an integer')
        if stations > MAX_STATIONS:
            raise ConfigError(f'stations is {stations}, expected at most {MAX_STATIONS}')
        if stations < len(ends):
            places = 'every anchorage and load' if breaks else 'every anchorage'
            raise ConfigError(
                f'stations is {stations}, expected at least {len(ends)} '
                f'for both ends of the arm and {places}'
            )
        counts = _share_intervals(np.diff(ends).tolist(), int(stations) - 1)
        panels = [
            np.linspace(start, stop, count + 1)[1:]
            for start, stop, count in zip(ends, ends[1:], counts)
        ]
        s = np.concatenate([[0.0], *panels])
        anchorages = np.array([arm_section.anchorage for arm_section in arm.sections])
        section = (anchorages >= s[:, np.newaxis]).sum(axis=1)
        s.setflags(write=False)
        section.setflags(write=False)
        return cls(s, section)


def _share_intervals(lengths: list[float], total: int) -> list[int]:
    """Distribute ``total`` intervals in proportion to ``lengths``, at least one each.

    Each interval is added to the panel with the longest intervals, to the first of equally long
    ones, so that the stations of similar arms are the same fractions of their lengths.
    """
    # Lower bounds of the counts are the proportional shares, rounded down.
    unit = sum(lengths) / max(total - len(lengths), 1)
    counts = [max(1, int(length / unit * (1.0 - SAME_LENGTH))) for length in lengths]
    for _ in range(total - sum(counts)):
        intervals = [length / count for length, count in zip(lengths, counts, strict=True)]
        longest = max(intervals) * (1.0 - SAME_LENGTH)
        counts[next(i for i, interval in enumerate(intervals) if interval >= longest)] += 1
    return counts


# Between rows of numbers -------------------------------------------------------------------------


def interpolated(targets: FloatArray | float, x: FloatArray, rows: FloatArray) -> FloatArray:
    """Interpolate ``rows`` (n, ...) at ascending ``x`` (n,) to ``targets``: (targets, ...).

    The rows are constant before the first and after the last ``x``.
    """
    columns = rows.reshape(len(rows), -1).T
    values = np.stack([np.interp(targets, x, column) for column in columns], axis=-1)
    return values.reshape(*np.shape(targets), *rows.shape[1:])


def nearest(targets: FloatArray, x: FloatArray) -> IntArray:
    """Return the index of the element of ascending ``x`` (n,) nearest to each of ``targets``."""
    return np.searchsorted(0.5 * (x[1:] + x[:-1]), targets)
