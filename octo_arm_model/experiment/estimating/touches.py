"""When an arm was touched: where its contact force is larger than its uncertainty explains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import chi_square_limit

SURE = 0.999  # probability of no false alarm at one time
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


def is_force_significant(force: FloatArray, covariance: FloatArray) -> bool:
    """Whether a ``force`` (3,) with a ``covariance`` (3, 3) is not zero."""
    if not covariance.any():
        return False
    square = float(force @ np.linalg.solve(covariance, force))
    return square > chi_square_limit(SURE, 3)


def find_touches(
    time: FloatArray,
    force: FloatArray,
    stddev: FloatArray,
    significant: Sequence[bool],
    hypotheses: Sequence[str],
) -> list[Touch]:
    """Intervals of significant forces.

    Args:
        time: ascending (n,) [s].
        force: (n, 3) [N].
        stddev: (n, 3) [N].
        significant: whether each is, see `is_force_significant`.
        hypotheses: by which each was found.
    """
    at = np.flatnonzero(significant)
    if not at.size:
        return []
    ends = np.flatnonzero(np.diff(time[at]) > GAP) + 1
    found = []
    for part in np.split(at, ends):
        start, stop = float(time[part[0]]), float(time[part[-1]])
        if stop - start < SHORTEST:
            continue
        name, _ = Counter(hypotheses[i] for i in part).most_common(1)[0]
        middle = [np.median(values[part], axis=0) for values in (force, stddev)]
        found.append(Touch(start, stop, middle[0], middle[1], name))
    return found
