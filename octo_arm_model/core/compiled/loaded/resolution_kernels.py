"""Kernels that test whether elements resolve the twist by their last Legendre coefficients."""

from __future__ import annotations

import math

from octo_arm_model.core.compiled.loaded.state_kernels import largest_in_rows
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.rod import MOST_TURN, RESOLVED, STRAIGHT


@borrows
def largest_tail(tail: FloatArray, values: FloatArray) -> float:
    """Largest magnitude of the last two Legendre coefficients of ``values`` in any element.

    ``values`` are those at the collocation points (points,); ``tail`` (2, each), from `GaussRule`,
    is the matrix from the values of an element to its last two coefficients.
    """
    s, largest = tail.shape[1], 0.0
    for first in range(0, values.size, s):
        one, other = 0.0, 0.0
        for j in range(s):
            one += tail[0, j] * values[first + j]
            other += tail[1, j] * values[first + j]
        largest = max(largest, abs(one), abs(other))
    return largest


@borrows
def resolves_twist(tail: FloatArray, step: FloatArray, twist: FloatArray) -> bool:
    """Whether elements of lengths ``step`` (elements,) [m] resolve a ``twist`` (4, points).

    The compiled counterpart of `LoadedRod.resolves_twist`. No element may turn by more than
    `MOST_TURN`, and the last two Legendre coefficients of the twist in each element must be within
    `RESOLVED` of the largest twist. ``tail`` is that of `largest_tail`.
    """
    each = tail.shape[1]
    for point in range(twist.shape[1]):
        rate = math.sqrt(twist[0, point] ** 2 + twist[1, point] ** 2 + twist[2, point] ** 2)
        if not rate * step[point // each] <= MOST_TURN:
            return False
    size, length = largest_in_rows(twist), 0.0
    for element in range(step.size):
        length += step[element]
    angular = max(size[0], size[1], size[2], STRAIGHT / length)
    for k in range(4):
        # False for NaN.
        if not largest_tail(tail, twist[k]) <= RESOLVED * (angular if k < 3 else size[3]):
            return False
    return True
