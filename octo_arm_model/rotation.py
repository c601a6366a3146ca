"""Rotations as unit quaternions, written as pairs of complex numbers so that NumPy is quick.

The quaternion w + x i + y j + z k is a + b j with a = w + x i and b = y + z i. As j c = conj(c) j
for complex c, a product takes four complex multiplications. A vector (x, y, z) is the quaternion
x i + y j + z k. Messages and results carry quaternions in the order x, y, z, w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.hints import ComplexArray, FloatArray, IntArray

# Up to this many quaternions doubling is quicker than halving, though it is more arithmetic.
_SMALL = 512


class Quaternions(NamedTuple):
    """Quaternions a + b j, one for each element of the two arrays."""

    a: ComplexArray
    b: ComplexArray

    @classmethod
    def empty(cls, *shape: int) -> Quaternions:
        """Room for quaternions of ``shape``, batch first.

        Kept batch last in memory: what is done along an arm is done to all arms side by side.
        """
        return cls(np.empty(shape, np.complex128, 'F'), np.empty(shape, np.complex128, 'F'))

    @classmethod
    def from_xyzw(cls, xyzw: ArrayLike) -> Quaternions:
        """Quaternions from an array (..., 4) in the order x, y, z, w."""
        x, y, z, w = np.moveaxis(np.asarray(xyzw, dtype=np.float64), -1, 0)
        return cls(w + 1j * x, y + 1j * z)

    @classmethod
    def from_vector(cls, x: FloatArray, y: FloatArray, z: FloatArray) -> Quaternions:
        """Vectors as quaternions without real part."""
        vector = cls.empty(*x.shape)
        vector.a.real, vector.a.imag = 0.0, x
        vector.b.real, vector.b.imag = y, z
        return vector

    def part(self, index: slice | IntArray) -> Quaternions:
        """Those at ``index`` of the last axis."""
        return Quaternions(self.a[..., index], self.b[..., index])

    def times(self, other: tuple[ComplexArray, ComplexArray]) -> Quaternions:
        """Product; as rotations, ``other`` first, then ``self``, both about fixed axes."""
        a, b = self
        c, d = other
        return Quaternions(a * c - b * d.conj(), a * d + b * c.conj())

    def rotate(self, vector: Quaternions) -> Quaternions:
        """Vectors turned by these unit quaternions."""
        return self.times(vector).times(Quaternions(self.a.conj(), -self.b))

    def matrix(self) -> FloatArray:
        """Rotation matrices (3, 3, ...)."""
        w, x, y, z = self.a.real, self.a.imag, self.b.real, self.b.imag
        return np.array([
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ])  # fmt: skip

    def write_xyzw(self, out: FloatArray) -> None:
        """Write the quaternions into ``out`` (..., 4) in the order x, y, z, w."""
        out[..., 0], out[..., 3] = self.a.imag, self.a.real
        out[..., 1], out[..., 2] = self.b.real, self.b.imag


def cumulative_product(factors: Quaternions) -> Quaternions:
    """Product of all ``factors`` (batch, n) up to and including each along the last axis."""
    count = factors.a.shape[-1]
    if factors.a.size <= _SMALL or count == 1:
        # Hillis and Steele 1986: log2(n) array operations.
        a, b = factors.a.copy(), factors.b.copy()
        shift = 1
        while shift < count:
            # `times`, written into place once all four products are there.
            outer_a, outer_b = a[..., :-shift], b[..., :-shift]
            inner_a, inner_b = a[..., shift:], b[..., shift:]
            aa, bb = outer_a * inner_a, outer_b * inner_b.conj()
            ab, ba = outer_a * inner_b, outer_b * inner_a.conj()
            np.subtract(aa, bb, out=inner_a)
            np.add(ab, ba, out=inner_b)
            shift *= 2
        return Quaternions(a, b)
    # Blelloch 1990: products of neighbours, then those between: 2 n products in all.
    even, odd = factors.part(slice(0, count - 1, 2)), factors.part(slice(1, None, 2))
    pairs = cumulative_product(even.times(odd))
    between = pairs.part(slice((count - 1) // 2)).times(factors.part(slice(2, None, 2)))
    product = Quaternions.empty(*factors.a.shape)
    for out, first, pair, rest in zip(product, factors, pairs, between, strict=True):
        out[..., 0], out[..., 1::2], out[..., 2::2] = first[..., 0], pair, rest
    return product
