"""When an arm was touched: where its contact force is larger than its uncertainty explains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.chi_square import chi_square_limit
from octo_arm_model.estimation.estimate import Estimate

SURE = 0.999  # probability of no false alarm at one time
LEARNT = 0.5  # part of the standard deviation of the prior that is left where a force counts
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


def is_touched(estimate: Estimate) -> bool:
    """Whether the unknown force of a contact is not zero, as far as anything was learnt of it.

    Along a straight arm, as an example, nothing is: a force that is found there is what the prior
    makes of others that would have been seen.
    """
    state = estimate.state
    parts = state.tip_force, state.point_forces, state.current
    where = next((part for part in parts if part.stop > part.start), slice(0, 0))
    where = slice(where.start, min(where.start + 3, where.stop))
    if where.stop == where.start:
        return False
    variances, axes = np.linalg.eigh(estimate.covariance[where, where])
    learnt = variances <= (LEARNT * estimate.prior_stddev[where].min()) ** 2
    if not learnt.any():
        return False
    along = axes.T @ estimate.mean[where]
    square = float((along[learnt] ** 2 / variances[learnt]).sum())
    return square > chi_square_limit(SURE, int(learnt.sum()))


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
        significant: whether each is, see `is_touched`.
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
