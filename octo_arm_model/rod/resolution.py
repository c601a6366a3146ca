"""Whether the nodes resolve an equilibrium: an estimate of the error of positions.

Collocation at Gauss points has an error of about the square of what the points leave of strains
and directions: the last Legendre coefficients of these in each element.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray

# Error of positions over the sums of squares, at most, where it is above 1e-10; measured for the
# arm of Table 4 under random tensions in water and air and for the metal rod.
OF_BENDS, OF_DIRECTIONS = 2e-3, 1e-4
_BETWEEN = 30.0
_ADDED, _ADDED_FINE, _FINE = 4, 5, 1e-8  # points, and the accuracy below which it is more


def added_points(accuracy: float, has_friction: bool) -> int:
    """Points more in each element at which sections are balanced, for stations between them."""
    return _ADDED if accuracy >= _FINE and not has_friction else _ADDED_FINE


def allowed_between(accuracy: float) -> float:
    """What `position_errors` may be for positions between the points to be right to ``accuracy``.

    Their error is of the first order of what the points leave, that at the ends of the second.
    """
    return min(accuracy, (_BETWEEN * accuracy) ** 2)


def position_errors(
    tail: FloatArray, lengths: FloatArray, z: FloatArray, slope: FloatArray
) -> FloatArray:
    """Estimated errors of positions over the length of A arms [-], (A,).

    From the twists ``z`` (A N, m) and r' ``slope`` (A N, 3) at the nodes, by the last Legendre
    coefficients of elements, see `Places.tail`, and ``lengths`` (E,) [m].
    """
    # Largest of the last two Legendre coefficients of bends and directions in each element.
    values = np.concatenate([z[:, :3], slope], axis=1).reshape(-1, tail.shape[1], 6)
    tails = np.abs(tail @ values).reshape(-1, 2, 2, 3).max(axis=(1, 3))
    tails *= tails
    tails = tails.reshape(-1, lengths.size, 2)
    of_bends = OF_BENDS * (tails[..., 0] @ (lengths * lengths))
    return np.asarray(of_bends + OF_DIRECTIONS / lengths.sum() * (tails[..., 1] @ lengths))
