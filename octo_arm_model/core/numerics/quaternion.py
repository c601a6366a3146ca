"""Rotations as unit quaternions in pairs of complex numbers, which take few NumPy calls.

The quaternion w + x i + y j + z k is a + b j with a = w + x i and b = y + z i. As j c = conj(c) j
for complex c, a product takes four complex multiplications. A vector (x, y, z) is the quaternion
x i + y j + z k. Messages and results carry quaternions in the order x, y, z, w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import ztbsv

from octo_arm_model.core.hints import ComplexArray, FloatArray, IntArray, Number

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
    half = 0.5 * kappa
    w, x, y, z = q.T
    p, r, s = half.T
    out[:, 0] = -(x * p + y * r + z * s)
    out[:, 1] = w * p + y * s - z * r
    out[:, 2] = w * r + z * p - x * s
    out[:, 3] = w * s + x * r - y * p


def product(a: Number, b: Number, c: Number, d: Number) -> tuple[Number, Number]:
    """Quaternion (a + b j) (c + d j), of complex numbers."""
    return a * c - b * np.conj(d), a * d + b * np.conj(c)


def displacement(a: Number, b: Number, c: Number, d: Number) -> tuple[Number, Number]:
    """Vector (a + b j) (c + d j)^-1: along x, and along y and z as real and imaginary part."""
    return (a * np.conj(c) + b * np.conj(d)).imag, b * c - a * d


def cumulative_product(factors: Quaternions) -> Quaternions:
    """Product of all ``factors`` (..., n) up to and including each along the last axis.

    Multiplying (a, b) by (c, d) from the right gives (a c - b conj(d), a d + b conj(c)), which is
    linear in a and b. So all products solve one banded triangular system, which BLAS does in
    less time than a few NumPy calls take.
    """
    *lead, count = factors.a.shape
    # The band below the unit diagonal, column by column: the factor from each product to the next.
    band = np.zeros((*lead, count, 2, 4), np.complex128)
    to_next, c, d = band[..., :-1, :, :], factors.a[..., 1:], factors.b[..., 1:]
    np.negative(c, out=to_next[..., 0, 2])
    np.negative(d, out=to_next[..., 0, 3])
    np.conjugate(d, out=to_next[..., 1, 1])
    np.conjugate(to_next[..., 0, 2], out=to_next[..., 1, 2])
    first = np.zeros((*lead, count, 2), np.complex128)
    first[..., 0, 0], first[..., 0, 1] = factors.a[..., 0], factors.b[..., 0]
    products = ztbsv(3, band.reshape(-1, 4).T, first.ravel(), lower=1, diag=1, overwrite_x=1)
    a, b = products.reshape(-1, 2).T
    return Quaternions(a.reshape(factors.a.shape), b.reshape(factors.b.shape))


def unit(orientation: Quaternions) -> Quaternions:
    """Quaternions divided by their length."""
    a, b = orientation
    length = np.sqrt(a.real**2 + a.imag**2 + b.real**2 + b.imag**2)
    return Quaternions(a / length, b / length)
