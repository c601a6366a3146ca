"""The course of an estimate, for tables, pictures and the summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.contact import Contact, contact_of
from octo_arm_model.experiment.estimating.estimates import TimedEstimate
from octo_arm_model.experiment.estimating.touches import Touch, find_touches, is_touched

_NONE = Contact(np.nan, np.full(6, np.nan), np.full((6, 6), np.nan))


class Moment(NamedTuple):
    """What is known at one time.

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
    """What ``one`` estimate of ``arm`` at a ``time`` [s] knows."""
    estimate = one.estimate
    tip_stddev = np.sqrt(np.diag(estimate.pose_covariance[-1]))[:3]
    contact = contact_of(estimate, arm) or _NONE
    return Moment(
        time, estimate.backbone.tip, tip_stddev, contact.s, contact.wrench,
        np.sqrt(np.diag(contact.covariance)), one.hypothesis, is_touched(estimate),
    )  # fmt: skip


def touches_of(moments: Sequence[Moment]) -> list[Touch]:
    """When the arm was touched, see `find_touches`."""
    return find_touches(
        np.array([one.time for one in moments]),
        np.array([one.wrench[:3] for one in moments]),
        np.array([one.wrench_stddev[:3] for one in moments]),
        [one.is_significant for one in moments],
        [one.hypothesis for one in moments],
    )
