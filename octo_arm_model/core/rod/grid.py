"""The grid along the arm: stations of the results and nodes of the quadrature.

Anchorages and loads split the arm into *panels*. Strains are smooth inside a panel and may jump
between panels. The nodes of an integration interval are its ends and its middle. Between two
panels there is an interval of zero length, so that its two ends hold the values of both sides.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ConfigError, shown
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.limits import MAX_INTERVALS, MAX_STATIONS, MAX_TENDON_NODES

DEFAULT_STATIONS = 101
# Lengths with a smaller relative difference are equal up to rounding.
_SAME = 1e-9
# Integration intervals are at most L / MIN_INTERVALS and at most STEP_PER_RADIUS times the
# smallest radius at their ends, that of the body or of the outermost tendon, whichever is larger:
# curvature, and with it the error of an interval, grows like its inverse.
MIN_INTERVALS = 100
STEP_PER_RADIUS = 1.0
# Within an interval these change by at most so much, which keeps the error of fourth order below
# 1e-5: the logarithm of the bending stiffness, the place of a tendon over that radius, its slope.
MOST_CHANGE = 0.3
# Changes are found by sampling so many parts of an interval, as tables may be steepest inside it.
_PARTS = 8


@dataclass(frozen=True)
class Panel:
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
    stops = sorted(inside) + [arm.length]
    panels = []
    for start, stop in zip([0.0, *stops[:-1]], stops, strict=True):
        # The number of sections that reach this far.
        panels.append(Panel(start, stop, sum(anchorage >= stop for anchorage in anchorages)))
    return tuple(panels)


@dataclass(frozen=True)
class StationGrid:
    """Stations, the intervals between them and the nodes of each interval.

    Attributes:
        panels: the panels, from base to tip.
        s: arc coordinate of the stations [m], (stations,), from base to tip.
        section: section of each station, numbered from the tip, (stations,); 0 beyond the last
            anchorage. An anchorage belongs to the section towards the base, where its tendons
            act.
        nodes: arc coordinate of the ends of all intervals, from base to tip, then of their
            middles [m], (2 * intervals + 1,).
        node_panel: panel of each node, (2 * intervals + 1,).
        node_section: section of each node, (2 * intervals + 1,).
        step: length of each interval [m], (intervals,); zero between two panels.
        station_node: node of each station, (stations,).
    """

    panels: tuple[Panel, ...]
    s: FloatArray
    section: IntArray
    nodes: FloatArray
    node_panel: IntArray
    node_section: IntArray
    step: FloatArray
    station_node: IntArray

    @classmethod
    def build(
        cls,
        arm: Arm,
        stations: int = DEFAULT_STATIONS,
        breaks: tuple[float, ...] = (),
        knots: tuple[float, ...] = (),
    ) -> StationGrid:
        """Distribute ``stations`` stations over ``arm``, among them anchorages and ``breaks``.

        No interval contains one of ``knots`` or of `Arm.knots` in its interior.

        Raises:
            ConfigError: if ``stations`` is less than both ends, anchorages and breaks take, or
                more than `MAX_STATIONS`, or the arm is so thin for its length that it takes more
                than `MAX_INTERVALS` intervals, or intervals times tendons are too many.
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
        all_knots = np.array(sorted({*arm.knots, *knots}))
        most = _most_intervals(arm)
        ends: list[FloatArray] = []
        end_panel: list[int] = []
        stations_s, station_section, station_node = [], [], []
        for number, (panel, count) in enumerate(zip(panels, counts, strict=True)):
            panel_s = np.linspace(panel.start, panel.stop, count + 1)
            left = most - len(end_panel)
            panel_ends = _subdivide(arm, _with_knots(panel_s, panel, all_knots), left)
            # The base is a station of the first panel; other panels begin after their start.
            skip = 1 if ends else 0
            stations_s.append(panel_s[skip:])
            station_section += [panel.section] * (count + 1 - skip)
            station_node.append(len(end_panel) + np.searchsorted(panel_ends, panel_s)[skip:])
            ends.append(panel_ends)
            end_panel += [number] * panel_ends.size
        if len(end_panel) > most + 1:
            raise _too_many_intervals(arm)
        all_ends = np.concatenate(ends)
        middles = 0.5 * (all_ends[:-1] + all_ends[1:])
        node_panel = np.array(end_panel + end_panel[:-1])
        grid = cls(
            panels=panels,
            s=np.concatenate(stations_s),
            section=np.array(station_section),
            nodes=np.concatenate([all_ends, middles]),
            node_panel=node_panel,
            node_section=np.array([panel.section for panel in panels])[node_panel],
            step=np.diff(all_ends),
            station_node=np.concatenate(station_node),
        )
        for array in vars(grid).values():
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
        return grid


def apart(places: Iterable[float], others: Sequence[float], length: float) -> list[float]:
    """Those of ``places`` that do not coincide, up to rounding, with one before or of ``others``.

    Sorted; ``length`` is that of the arm.
    """
    known = sorted(others)
    found = []
    for place in sorted(places):
        after = bisect.bisect(known, place)
        if all(abs(one - place) > _SAME * length for one in known[max(after - 1, 0) : after + 1]):
            known.insert(after, place)
            found.append(place)
    return found


def _share_intervals(lengths: list[float], total: int) -> list[int]:
    """Distribute ``total`` intervals in proportion to ``lengths``, at least one each.

    Each interval is added to the panel with the longest intervals, to the first of equally long
    ones, so that the stations of similar arms are the same fractions of their lengths.
    """
    # Lower bounds: the proportional part of the intervals beyond one each, rounded down.
    unit = sum(lengths) / max(total - len(lengths), 1)
    counts = [max(1, int(length / unit * (1.0 - _SAME))) for length in lengths]
    for _ in range(total - sum(counts)):
        intervals = [length / count for length, count in zip(lengths, counts, strict=True)]
        longest = max(intervals) * (1.0 - _SAME)
        counts[next(i for i, interval in enumerate(intervals) if interval >= longest)] += 1
    return counts


def _too_many_intervals(arm: Arm) -> ConfigError:
    return ConfigError(
        f'this arm takes more than {_most_intervals(arm)} intervals of integration, the most with '
        f'{len(arm.tendons)} tendons: it is too thin for its length, or has too many stations or '
        'tabulated points'
    )


def _most_intervals(arm: Arm) -> int:
    """Largest number of intervals, also by the number of tendons times nodes."""
    return min(MAX_INTERVALS, MAX_TENDON_NODES // (2 * len(arm.tendons)))


def _subdivide(arm: Arm, ends: FloatArray, most: int) -> FloatArray:
    """Ends of the integration intervals in one panel, a refinement of ``ends``.

    Raises:
        ConfigError: if there are more than ``most``.
    """
    # This and the total below are checked before arrays of that size are allocated.
    if ends.size - 1 > most:
        raise _too_many_intervals(arm)
    # 2 % more, so that intervals between default stations are not split where the arm is thick.
    longest = 1.02 * arm.length / MIN_INTERVALS
    count = math.ceil(_PARTS * max(1.0, np.diff(ends).max() / longest * (1.0 - _SAME)))
    parts = np.linspace(ends[:-1], ends[1:], count + 1)
    # Tendons that end where the panel begins do not act in it.
    active = [arm.sections[i - 1].anchorage >= ends[-1] for i in arm.tendon_section]
    place, slope = (
        np.stack(of(parts.ravel()))[:, active].reshape(2, -1, *parts.shape)
        for of in (arm.tendon_offsets, arm.tendon_slopes)
    )
    modulus, radius = arm.material.youngs_modulus_at(parts), arm.body.radius(parts)
    thickness = np.maximum(radius, np.hypot(*place).max(axis=0, initial=0.0))
    described = np.concatenate([
        np.log(modulus * radius**4)[np.newaxis], *(place / thickness), *slope
    ])  # fmt: skip
    change = count * np.abs(np.diff(described, axis=1)).max(axis=(0, 1))
    # A tendon may wind by whole turns within a part, which its places at the ends do not show. One
    # of the two components of its place changes by at least the root of 1/2 of the arc it winds.
    angle = np.stack([tendon.angle.value(parts) for tendon in arm.tendons])[active]
    wound = np.abs(np.diff(angle, axis=1)) * (np.hypot(*place) / thickness)[:, 1:]
    change = np.maximum(change, math.sqrt(0.5) * count * wound.max(axis=(0, 1), initial=0.0))
    smallest_radius = np.minimum(thickness[0], thickness[-1])
    with np.errstate(over='ignore'):
        pieces = np.diff(ends) / np.minimum(longest, STEP_PER_RADIUS * smallest_radius)
        pieces = np.maximum(pieces, change / MOST_CHANGE)
        pieces = np.maximum(np.ceil(pieces * (1.0 - _SAME)), 1.0)
    if not pieces.sum() <= most:
        raise _too_many_intervals(arm)
    numbers = np.cumsum([0, *pieces.astype(np.int64)])
    return np.interp(np.arange(numbers[-1] + 1), numbers, ends)


def _with_knots(ends: FloatArray, panel: Panel, knots: FloatArray) -> FloatArray:
    """Insert those of ``knots`` that lie in ``panel`` into the ``ends`` of its intervals."""
    knots = knots[(knots > panel.start) & (knots < panel.stop)]
    if not knots.size:
        return ends
    # Knots that coincide with an end up to rounding are left out.
    after = np.searchsorted(ends, knots)
    near = np.minimum(np.abs(ends[after] - knots), np.abs(knots - ends[after - 1]))
    apart = near > _SAME * panel.length
    return np.sort(np.concatenate([ends, knots[apart]]))
