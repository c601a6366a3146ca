"""Where the model is evaluated: stations a user sees and nodes the quadrature needs.

Anchorages and loads split the arm into *panels*. Inside a panel every quantity is smooth; between
two, the strains jump. Integration intervals are evaluated at both ends and in the middle. The
border of two panels is the end of two intervals, one for each side, with one of no length between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ConfigError, shown
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.limits import MAX_INTERVALS, MAX_STATIONS, MAX_TENDON_NODES

DEFAULT_STATIONS = 101
# Lengths that differ by a smaller part are equal but for rounding.
_SAME = 1e-9
# Integration intervals are never longer than L / MIN_INTERVALS nor than STEP_PER_RADIUS times
# the smallest radius they could span, that of the body or of the tendons around it, whichever is
# larger: curvature grows like its inverse, and with it the error of a step.
MIN_INTERVALS = 100
STEP_PER_RADIUS = 1.0


@dataclass(frozen=True)
class Panel:
    """The stretch between two neighbouring anchorages or loads (or an end of the arm).

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
    inside = {*anchorages, *breaks} - {0.0, arm.length}
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
        """Spread ``stations`` stations over ``arm``, its anchorages and ``breaks`` among them.

        No interval spans one of ``knots`` or of the arm's own.

        Raises:
            ConfigError: if ``stations`` is too few to hold both ends and every anchorage and
                break, or more than `MAX_STATIONS`, or the arm is so thin for its length that it
                takes more than `MAX_INTERVALS` intervals, or they and its tendons are too many.
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
            room = most - len(end_panel)
            panel_ends = _with_knots(_subdivide(arm, panel_s, room), panel, all_knots)
            # The first panel brings the base, every panel the stations after its start.
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


def _share_intervals(lengths: list[float], total: int) -> list[int]:
    """Share ``total`` intervals in proportion to ``lengths``, at least one each.

    Each interval goes to whichever panel has the longest intervals so far, of several equally
    long ones to the first, so that arms of one shape have the same stations whatever their size.
    """
    # All panels get at least their share of those beyond one each, rounded down.
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
    return min(MAX_INTERVALS, MAX_TENDON_NODES // (2 * len(arm.tendons)))


def _subdivide(arm: Arm, stations: FloatArray, room: int) -> FloatArray:
    """Ends of the integration intervals between ``stations``, those among them.

    Raises:
        ConfigError: if there are more than ``room``.
    """
    active = np.array([arm.sections[i - 1].anchorage for i in arm.tendon_section])
    lever = np.hypot(*arm.tendon_offsets(stations)) * (active[:, np.newaxis] >= stations)
    radius = np.maximum(arm.body.radius(stations), lever.max(axis=0))
    smallest_radius = np.minimum(radius[:-1], radius[1:])
    # A little slack, so that the default stations need no cut where the arm is thick.
    longest = np.minimum(1.02 * arm.length / MIN_INTERVALS, STEP_PER_RADIUS * smallest_radius)
    with np.errstate(over='ignore'):
        pieces = np.maximum(np.ceil(np.diff(stations) / longest * (1.0 - _SAME)), 1.0)
    # Before there is an array of that size.
    if not pieces.sum() <= room:
        raise _too_many_intervals(arm)
    numbers = np.cumsum([0, *pieces.astype(np.int64)])
    return np.interp(np.arange(numbers[-1] + 1), numbers, stations)


def _with_knots(ends: FloatArray, panel: Panel, knots: FloatArray) -> FloatArray:
    """Add those of ``knots`` that lie in ``panel`` to the ``ends`` of its intervals."""
    knots = knots[(knots > panel.start) & (knots < panel.stop)]
    if not knots.size:
        return ends
    # Not those that are an end already, but for rounding.
    after = np.searchsorted(ends, knots)
    near = np.minimum(np.abs(ends[after] - knots), np.abs(knots - ends[after - 1]))
    apart = near > _SAME * panel.length
    return np.sort(np.concatenate([ends, knots[apart]]))
