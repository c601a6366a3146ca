"""A loss that bounds the influence of outliers: soft_l1 of distances instead of coordinates.

With the distance d of a point and the scale c, rho = 2 c^2 (sqrt(1 + (d / c)^2) - 1): quadratic
in small distances and linear in large ones. As a function of distances it does not depend on the
directions of the axes.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.shapes.steady_windows import MAD


def scale_of(away: FloatArray, least: float) -> float:
    """Scale for residuals (..., 3) [m]: 1.48 times their median distance, at least ``least``."""
    return max(MAD * float(np.median(np.linalg.norm(away, axis=-1))), least)


def weights(away: FloatArray, scale: float) -> FloatArray:
    """Weight of each of the residuals (..., 3) in an equivalent sum of squares [-], (...)."""
    return 1.0 / np.sqrt(1.0 + (away**2).sum(axis=-1) / scale**2)


def loss(squares: FloatArray) -> FloatArray:
    """Loss for `scipy.optimize.least_squares`, of residuals x, y, z of point after point.

    Args:
        squares: of the residuals over the scale, (3 points,).

    Returns:
        Of each residual a third of its point's rho, then the derivatives of rho by the square,
        first and second, (3, 3 points).
    """
    root = np.sqrt(1.0 + squares.reshape(-1, 3).sum(axis=1))
    return np.repeat([2.0 / 3.0 * (root - 1.0), 1.0 / root, -0.5 / root**3], 3, axis=1)
