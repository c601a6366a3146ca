"""Kernels that test whether elements resolve the twist, as `LoadedRod.resolves_twist`."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.rod import RESOLVED, STRAIGHT


def largest_tail(tail: FloatArray, values: FloatArray) -> float:
    """Largest of the last Legendre coefficients of ``values`` (points,) within all elements.

    ``tail`` (2, each) is that of `GaussRule`.
    """
    s, largest = tail.shape[1], 0.0
    for first in range(0, values.size, s):
        one, other = 0.0, 0.0
        for j in range(s):
            one += tail[0, j] * values[first + j]
            other += tail[1, j] * values[first + j]
        largest = max(largest, abs(one), abs(other))
    return largest


def resolves_twist(tail: FloatArray, length: float, twist: FloatArray) -> bool:
    """Whether elements of an arm of this ``length`` [m] resolve a ``twist`` (4, points)."""
    size = np.empty(4)
    for k in range(4):
        size[k] = np.abs(twist[k]).max()
    angular = max(size[0], size[1], size[2], STRAIGHT / length)
    for k in range(4):
        # False for NaN.
        if not largest_tail(tail, twist[k]) <= RESOLVED * (angular if k < 3 else size[3]):
            return False
    return True
