"""The course of an estimate, and when the arm was touched, for tables, pictures and summary.

An arm is touched where its contact force is larger than its uncertainty explains.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.contact import Contact, contact_of
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.experiment.estimating.estimates import TimedEstimate
from octo_arm_model.rod.sensitivity import chi_square_limit

SURE = 0.999  # probability of no false alarm at one time
LEARNT = 0.5  # part of the standard deviation of the prior that is left where a force counts
GAP = 0.5  # [s] without a significant force that ends a touch
SHORTEST = 0.1  # [s]
_NONE = Contact(np.nan, np.full(6, np.nan), np.full((6, 6), np.nan))


class Moment(NamedTuple):
    """Tip, contact and their standard deviations at one time.

    Attributes:
        time: [s].
        tip: position (3,) [m].
        tip_stddev: (3,) [m].
        s: where the contact is [m]; NaN of a current, and of none.
        wrench: of the contact, (6,) [N, N m]; NaN of none.
        wrench_stddev: zero of what is not estimated, (6,).
        hypothesis: by which it is.
        is_significant: whether the force is more than its uncertainty explains.
    """

    time: float
    tip: FloatArray
    tip_stddev: FloatArray
    s: float
    wrench: FloatArray
    wrench_stddev: FloatArray
    hypothesis: str
    is_significant: bool


def moment_of(time: float, one: TimedEstimate, arm: Arm) -> Moment:
    """Tip, contact and their deviations by ``one`` estimate of ``arm`` at a ``time`` [s]."""
    estimate = one.estimate
    tip_stddev = np.sqrt(np.diag(estimate.pose_covariance[-1]))[:3]
    contact = contact_of(estimate, arm) or _NONE
    return Moment(
        time, estimate.backbone.tip, tip_stddev, contact.s, contact.wrench,
        np.sqrt(np.diag(contact.covariance)), one.hypothesis, is_touched(estimate),
    )  # fmt: skip


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
