"""Rotations, as rotation vectors (3, ...) and as unit quaternions.

Messages and results have quaternions in the order x, y, z, w; node functions in w, x, y, z.
"""

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.hints import FloatArray

# From the components of a vector to the matrix of its cross product, row by row.
_SKEW = np.zeros((3, 9))
_SKEW[[0, 1, 2], [5, 6, 1]], _SKEW[[0, 1, 2], [7, 2, 3]] = -1.0, 1.0
# From the products of w, x, y and z with w, x, y and z (16) to a rotation matrix (9).
_TO_MATRIX = np.array(
    [
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]],
        [[0, 0, 0, -2], [0, 0, 2, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
        [[0, 0, 2, 0], [0, 0, 0, 2], [0, 0, 0, 0], [0, 0, 0, 0]],
        [[0, 0, 0, 2], [0, 0, 2, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
        [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, -1]],
        [[0, -2, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2], [0, 0, 0, 0]],
        [[0, 0, -2, 0], [0, 0, 0, 2], [0, 0, 0, 0], [0, 0, 0, 0]],
        [[0, 2, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2], [0, 0, 0, 0]],
        [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]],
    ],
    dtype=np.float64,
).reshape(9, 16)
# From the products of w, x, y and z with the components of kappa (12) to q (0, kappa) / 2.
_TO_RATE = np.zeros((4, 12))
_TO_RATE[[0, 0, 0], [3, 7, 11]] = -0.5
_TO_RATE[[1, 1, 1], [0, 8, 10]] = 0.5, 0.5, -0.5
_TO_RATE[[2, 2, 2], [1, 9, 5]] = 0.5, 0.5, -0.5
_TO_RATE[[3, 3, 3], [2, 4, 6]] = 0.5, 0.5, -0.5


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the scalar products (n, 1) of vectors (n, 3)."""
    return np.asarray((a * b).sum(axis=1, keepdims=True))


def outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the dyadic products (n, 3, 3) of vectors (n, 3)."""
    return np.asarray(a[:, :, np.newaxis] * b[:, np.newaxis])


def skew(v: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) that take w to v x w, for vectors v (..., 3)."""
    return np.asarray((v @ _SKEW).reshape(*v.shape, 3))


def left_jacobian(turn: FloatArray) -> FloatArray:
    """Return the left Jacobian (3, 3) of a rotation with the rotation vector ``turn`` (3,) [rad].

    It maps a small change of ``turn`` to the rotation vector, in fixed axes, of the small rotation
    that follows the rotation. It is singular at 2 pi. Source: Barfoot 2017, 7.1.3.
    """
    angle = float(np.linalg.norm(turn))
    matrix = skew(turn)
    first, second = 0.5, 1.0 / 6.0
    if angle >= 1e-4:
        first = (1.0 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * matrix + second * matrix @ matrix


def rotation_matrices(wxyz: FloatArray) -> FloatArray:
    """Return the rotation matrices (3, 3, ...) of quaternions (4, ...), w, x, y, z."""
    products = wxyz[:, np.newaxis] * wxyz
    return (_TO_MATRIX @ products.reshape(16, -1)).reshape(3, 3, *wxyz.shape[1:])


def axes_of(quaternion: ArrayLike) -> FloatArray:
    """Return the rotation matrices (3, 3, ...) of quaternions (..., 4), x, y, z, w.

    The columns of the matrix of a cross section are its axes t, n and b.
    """
    xyzw = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    return rotation_matrices(xyzw[[3, 0, 1, 2]])


def quaternion_product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the product p q of quaternions (..., 4), x, y, z, w: the rotation q, then p."""
    u, a, v, b = p[..., :3], p[..., 3:], q[..., :3], q[..., 3:]
    vector = a * v + b * u + np.cross(u, v)
    return np.concatenate([vector, a * b - (u * v).sum(axis=-1, keepdims=True)], axis=-1)


def quaternion_rates(q: FloatArray, kappa: FloatArray, out: FloatArray) -> None:
    """Write the rates q (0, kappa) / 2 of quaternions ``q`` (n, 4), w, x, y, z, into ``out``.

    ``kappa`` (n, 3) are the angular rates in the rotated axes; ``out`` is (n, 4).
    """
    products = q.T[:, np.newaxis] * kappa.T
    np.matmul(_TO_RATE, products.reshape(12, -1), out=out.T)
