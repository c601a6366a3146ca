"""Where the model is evaluated: stations a user sees and nodes the quadrature needs.

Anchorages split the arm into *panels*. Inside a panel every quantity is smooth; across an
anchorage the strains jump. Integration intervals are evaluated at both ends and in the middle.
An anchorage is the end of two intervals, once for each side, with one of no length between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm import Arm
from octo_arm_model.errors import ConfigError
from octo_arm_model.hints import FloatArray, IntArray

DEFAULT_STATIONS = 101
# Integration intervals are never longer than L / MIN_INTERVALS nor than STEP_PER_RADIUS times
# the smallest radius they could span: curvature grows like 1 / R, and with it the error of a step.
MIN_INTERVALS = 100
STEP_PER_RADIUS = 1.0


@dataclass(frozen=True)
class Panel:
    """The stretch between two neighbouring anchorages (or an end of the arm).

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


def panels_of(arm: Arm) -> tuple[Panel, ...]:
    """Panels of ``arm`` from the base to the tip."""
    stops = [section.anchorage for section in arm.sections]
    numbers = list(range(1, len(stops) + 1))
    if stops[0] < arm.length:
        stops.insert(0, arm.length)
        numbers.insert(0, 0)
    starts = [*stops[1:], 0.0]
    panels = [Panel(*ends) for ends in zip(starts, stops, numbers, strict=True)]
    return tuple(reversed(panels))


@dataclass(frozen=True)
class StationGrid:
    """Stations, the intervals between them and the nodes of each interval.

    Attributes:
        s: arc coordinate of the stations [m], (stations,), from base to tip.
        section: section of each station, numbered from the tip, (stations,); 0 beyond the last
            anchorage. An anchorage belongs to the section towards the base, where its tendons
            act.
        nodes: arc coordinate of the ends of all intervals, from base to tip, then of their
            middles [m], (2 * intervals + 1,).
        node_section: section of each node, (2 * intervals + 1,).
        step: length of each interval [m], (intervals,); zero across an anchorage.
        station_node: node of each station, (stations,).
    """

    s: FloatArray
    section: IntArray
    nodes: FloatArray
    node_section: IntArray
    step: FloatArray
    station_node: IntArray

    @classmethod
    def build(cls, arm: Arm, stations: int = DEFAULT_STATIONS) -> StationGrid:
        """Spread ``stations`` stations over ``arm``, its anchorages among them.

        Raises:
            ConfigError: if ``stations`` is too few to hold both ends and every anchorage.
        """
        panels = panels_of(arm)
        if isinstance(stations, bool) or not isinstance(stations, (int, np.integer)):
            raise ConfigError(f'stations is {stations!r}, expected an integer')
        if stations < len(panels) + 1:
            raise ConfigError(
                f'stations is {stations}, expected at least {len(panels) + 1} '
                'for both ends of the arm and every anchorage'
            )
        counts = _share_intervals([panel.length for panel in panels], int(stations) - 1)
        ends: list[FloatArray] = []
        end_section: list[int] = []
        stations_s, section, station_node = [], [], []
        for panel, count in zip(panels, counts, strict=True):
            panel_s = np.linspace(panel.start, panel.stop, count + 1)
            substeps = _substeps(arm, panel_s)
            panel_ends = np.interp(
                np.arange(substeps.sum() + 1), np.cumsum([0, *substeps]), panel_s
            )
            # The first panel brings the base, every panel the stations after its start.
            skip = 1 if ends else 0
            stations_s.append(panel_s[skip:])
            section += [panel.section] * (count + 1 - skip)
            station_node.append(len(end_section) + np.cumsum([0, *substeps])[skip:])
            ends.append(panel_ends)
            end_section += [panel.section] * panel_ends.size
        all_ends = np.concatenate(ends)
        middles = 0.5 * (all_ends[:-1] + all_ends[1:])
        grid = cls(
            s=np.concatenate(stations_s),
            section=np.array(section),
            nodes=np.concatenate([all_ends, middles]),
            node_section=np.array(end_section + end_section[:-1]),
            step=np.diff(all_ends),
            station_node=np.concatenate(station_node),
        )
        for array in vars(grid).values():
            array.setflags(write=False)
        return grid


def _share_intervals(lengths: list[float], total: int) -> list[int]:
    """Share ``total`` intervals in proportion to ``lengths``, at least one each.

    Each interval goes to whichever panel has the longest intervals so far.
    """
    counts = [1] * len(lengths)
    for _ in range(total - len(lengths)):
        longest = max(range(len(lengths)), key=lambda i: lengths[i] / counts[i])
        counts[longest] += 1
    return counts


def _substeps(arm: Arm, stations: FloatArray) -> IntArray:
    """Into how many integration intervals each stretch between stations is cut."""
    radius = arm.body.radius(stations)
    smallest_radius = np.minimum(radius[:-1], radius[1:])
    # A little slack, so that the default stations need no cut where the arm is thick.
    longest = np.minimum(1.02 * arm.length / MIN_INTERVALS, STEP_PER_RADIUS * smallest_radius)
    return np.ceil(np.diff(stations) / longest).astype(np.int64)
