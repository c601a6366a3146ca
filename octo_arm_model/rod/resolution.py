"""Whether the nodes resolve an equilibrium: an estimate of the error of positions.

Collocation at Gauss points has an error of about the square of what the points leave of strains
and directions: the last Legendre coefficients of these in each element.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.elements import Elements

# Error of positions over the sums of squares, at most, where it is above 1e-10; measured for the
# arm of Table 4 under random tensions in water and air and for the metal rod.
OF_BENDS, OF_DIRECTIONS = 2e-3, 1e-4
_BETWEEN = 10.0


def position_error(elements: Elements, z: FloatArray, slope: FloatArray) -> float:
    """Estimated error of positions over the length of the arm [-].

    From the twists ``z`` (N, m) and r' ``slope`` (N, 3) at the nodes.
    """
    return float(position_errors(elements.rule.tail, elements.lengths, z, slope)[0])


def allowed_between(accuracy: float) -> float:
    """What `position_error` may be for strains between the points to be right to ``accuracy``.

    Their error is of the first order of what the points leave, that of positions of the second.
    """
    return min(accuracy, (_BETWEEN * accuracy) ** 2)


def position_errors(
    tail: FloatArray, lengths: FloatArray, z: FloatArray, slope: FloatArray
) -> FloatArray:
    """The same of several arms, (A,), from ``z`` (A N, m) and ``slope`` (A N, 3).

    From the last Legendre coefficients of elements, see `Places.tail`, and ``lengths`` (E,) [m].
    """
    # Largest of the last two Legendre coefficients of bends and directions in each element.
    values = np.concatenate([z[:, :3], slope], axis=1).reshape(-1, tail.shape[1], 6)
    tails = np.abs(tail @ values).reshape(-1, 2, 2, 3).max(axis=(1, 3))
    tails *= tails
    tails = tails.reshape(-1, lengths.size, 2)
    of_bends = OF_BENDS * (tails[..., 0] @ (lengths * lengths))
    return np.asarray(of_bends + OF_DIRECTIONS / lengths.sum() * (tails[..., 1] @ lengths))
