"""The external wrench that an estimate holds: where it acts, how large it is and how uncertain."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.unit_loads import facing_area


class Contact(NamedTuple):
    """An estimated wrench in base_frame.

    Attributes:
        s: where it acts [m]; NaN of a current, whose force acts along the whole arm.
        wrench: force and moment, (6,) [N, N m].
        covariance: theirs, zero of what is not estimated, (6, 6).
        is_at_tip: whether it is that of `Unknowns.tip_force` or `tip_moment`.
    """

    s: float
    wrench: FloatArray
    covariance: FloatArray
    is_at_tip: bool = False


NO_CONTACT = Contact(math.nan, np.zeros(6), np.zeros((6, 6)))


def contact_of(estimate: Estimate, arm: Arm) -> Contact | None:
    """The wrench on the tip of ``arm``, else the first point force, else the current's resultant.

    None where the state holds none of them. Known loads on the tip are part of a wrench on it.
    """
    state = estimate.state
    if state.tip_force.stop > state.tip_force.start or (
        state.tip_moment.stop > state.tip_moment.start
    ):
        wrench, covariance = estimate.tip_wrench, estimate.tip_wrench_covariance
        return Contact(arm.length, wrench, covariance, is_at_tip=True)
    if points := state.unknowns.point_forces:
        first = slice(state.point_forces.start, state.point_forces.start + 3)
        return _force(estimate, points[0].s, first, 1.0)
    if state.current.stop > state.current.start:
        return _force(estimate, math.nan, state.current, facing_area(arm))
    return None


def _force(estimate: Estimate, s: float, where: slice, scale: float) -> Contact:
    """The force of ``scale`` times three components of the state."""
    wrench, covariance = np.zeros(6), np.zeros((6, 6))
    wrench[:3] = scale * estimate.mean[where]
    covariance[:3, :3] = scale**2 * estimate.covariance[where, where]
    return Contact(s, wrench, covariance)
