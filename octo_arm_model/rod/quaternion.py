"""Rotations as unit quaternions in pairs of complex numbers, which take few NumPy calls.

The quaternion w + x i + y j + z k is a + b j with a = w + x i and b = y + z i. As j c = conj(c) j
for complex c, a product takes four complex multiplications. A vector (x, y, z) is the quaternion
x i + y j + z k. Messages and results carry quaternions in the order x, y, z, w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.hints import ComplexArray, FloatArray, IntArray, Number

# Rotation matrices (9) from products of w, x, y and z with w, x, y and z (16).
_TO_MATRIX = np.array([
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]],
    [[0, 0, 0, -2], [0, 0, 2, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
    [[0, 0, 2, 0], [0, 0, 0, 2], [0, 0, 0, 0], [0, 0, 0, 0]],
    [[0, 0, 0, 2], [0, 0, 2, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
    [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, -1]],
    [[0, -2, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2], [0, 0, 0, 0]],
    [[0, 0, -2, 0], [0, 0, 0, 2], [0, 0, 0, 0], [0, 0, 0, 0]],
    [[0, 2, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2], [0, 0, 0, 0]],
    [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]],
], dtype=np.float64).reshape(9, 16)  # fmt: skip
# Rates q (0, kappa) / 2 from products of w, x, y and z with the three components of kappa.
_TO_RATE = np.zeros((4, 12))
_TO_RATE[[0, 0, 0], [3, 7, 11]] = -0.5
_TO_RATE[[1, 1, 1], [0, 8, 10]] = 0.5, 0.5, -0.5
_TO_RATE[[2, 2, 2], [1, 9, 5]] = 0.5, 0.5, -0.5
_TO_RATE[[3, 3, 3], [2, 4, 6]] = 0.5, 0.5, -0.5


class Quaternions(NamedTuple):
    """Quaternions a + b j, one for each element of the two arrays."""

    a: ComplexArray
    b: ComplexArray

    @classmethod
    def empty(cls, *shape: int) -> Quaternions:
        """Uninitialised quaternions of ``shape``."""
        return cls(np.empty(shape, np.complex128), np.empty(shape, np.complex128))

    @classmethod
    def from_xyzw(cls, xyzw: ArrayLike) -> Quaternions:
        """Quaternions from an array (..., 4) in the order x, y, z, w."""
        x, y, z, w = np.moveaxis(np.asarray(xyzw, dtype=np.float64), -1, 0)
        return cls(w + 1j * x, y + 1j * z)

    def part(self, index: slice | IntArray) -> Quaternions:
        """Quaternions at ``index`` of the last axis."""
        return Quaternions(self.a[..., index], self.b[..., index])

    def times(self, other: tuple[ComplexArray, ComplexArray]) -> Quaternions:
        """Product; as rotations, ``other`` first, then ``self``, both about fixed axes."""
        return Quaternions(*product(*self, *other))

    def matrix(self) -> FloatArray:
        """Rotation matrices (3, 3, ...)."""
        return rotation_matrices(np.array([self.a.real, self.a.imag, self.b.real, self.b.imag]))

    def write_xyzw(self, out: FloatArray) -> None:
        """Write the quaternions into ``out`` (..., 4) in the order x, y, z, w."""
        out[..., 0], out[..., 3] = self.a.imag, self.a.real
        out[..., 1], out[..., 2] = self.b.real, self.b.imag


def rotation_matrices(wxyz: FloatArray) -> FloatArray:
    """Rotation matrices (3, 3, ...) of quaternions (4, ...) in the order w, x, y, z."""
    products = wxyz[:, np.newaxis] * wxyz
    return (_TO_MATRIX @ products.reshape(16, -1)).reshape(3, 3, *wxyz.shape[1:])


def quaternion_rates(q: FloatArray, kappa: FloatArray, out: FloatArray) -> None:
    """Rates q (0, kappa) / 2 of quaternions ``q`` (n, 4), w, x, y, z, into ``out`` (n, 4).

    ``kappa`` (n, 3) are angular rates in the turned axes.
    """
    products = q.T[:, np.newaxis] * kappa.T
    np.matmul(_TO_RATE, products.reshape(12, -1), out=out.T)


def product(a: Number, b: Number, c: Number, d: Number) -> tuple[Number, Number]:
    """Quaternion (a + b j) (c + d j), of complex numbers."""
    return a * c - b * np.conj(d), a * d + b * np.conj(c)


def unit(orientation: Quaternions) -> Quaternions:
    """Quaternions divided by their length."""
    a, b = orientation
    length = np.sqrt(a.real**2 + a.imag**2 + b.real**2 + b.imag**2)
    return Quaternions(a / length, b / length)
