"""Vectors (3, ...), one at each node, and rotation vectors."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray

# Cross products from all products of components.
_CROSS = np.zeros((3, 3, 3))
_CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]], _CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = 1.0, -1.0
_SKEW = _CROSS.swapaxes(1, 2).reshape(9, 3)


def skew(v: FloatArray) -> FloatArray:
    """Matrices (3, 3, ...) that take w to v x w, for vectors v (3, ...)."""
    return (_SKEW @ v.reshape(3, -1)).reshape(3, *v.shape)


def left_jacobian(turn: FloatArray) -> FloatArray:
    """Left Jacobian (3, 3) of a rotation by its rotation vector ``turn`` (3,) [rad].

    From a small change of ``turn`` to the rotation vector in fixed axes of the small rotation
    that follows the rotation. Singular at 2 pi. Barfoot 2017, 7.1.3.
    """
    angle = float(np.linalg.norm(turn))
    matrix = skew(turn[:, np.newaxis])[:, :, 0]
    first, second = 0.5, 1.0 / 6.0
    if angle >= 1e-4:
        first = (1.0 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * matrix + second * matrix @ matrix
