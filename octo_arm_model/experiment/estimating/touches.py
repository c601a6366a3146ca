"""When an arm was touched: where its contact force is larger than its uncertainty explains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.experiment.estimating.history import Moment

GAP = 0.5  # [s] without a significant force that ends a touch
SHORTEST = 0.1  # [s]


class Touch(NamedTuple):
    """One touch.

    Attributes:
        start: when it begins [s].
        stop: when it ends [s].
        force: median of the force in base_frame, (3,) [N].
        stddev: median of its standard deviations, (3,) [N].
        hypothesis: by which it was mostly found.
    """

    start: float
    stop: float
    force: FloatArray
    stddev: FloatArray
    hypothesis: str


def find_touches(moments: Iterable[Moment]) -> list[Touch]:
    """Intervals of significant forces among ``moments`` by ascending time."""
    parts: list[list[Moment]] = []
    for one in moments:
        if one.is_significant:
            if not parts or one.time - parts[-1][-1].time > GAP:
                parts.append([])
            parts[-1].append(one)
    return [_touch(part) for part in parts if part[-1].time - part[0].time >= SHORTEST]


def _touch(part: Sequence[Moment]) -> Touch:
    force = np.median([one.wrench[:3] for one in part], axis=0)
    stddev = np.median([one.wrench_stddev[:3] for one in part], axis=0)
    ((name, _),) = Counter(one.hypothesis for one in part).most_common(1)
    return Touch(part[0].time, part[-1].time, force, stddev, name)
