"""Rotation matrices, written out independently of the package."""

import numpy as np


def matrix_of(quaternion):
    """Matrix (3, 3) of a quaternion x, y, z, w."""
    x, y, z, w = quaternion
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew
