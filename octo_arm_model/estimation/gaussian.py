"""Normal distributions of a state, one or many at once, and linear measurements of it.

Covariances are kept as square roots, which stay exact where something is known a million times
better than something else (array algorithm, Kailath, Sayed and Hassibi 2000, chapter 12). Leading
axes are those of several distributions.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dgeqrf

from octo_arm_model.arm.hints import FloatArray


class Gaussian(NamedTuple):
    """Normal distribution of a state.

    Attributes:
        mean: (..., n).
        root: lower triangular square root of the covariance, (..., n, n).
    """

    mean: FloatArray
    root: FloatArray

    def after(self, decay: FloatArray, growth: FloatArray) -> Gaussian:
        """Each component times ``decay``, and with a noise of standard deviation ``growth``."""
        if not growth.any() and (decay == 1.0).all():
            return self
        noise = np.broadcast_to(np.diag(growth), self.root.shape)
        root = lower_root(np.concatenate([decay[:, np.newaxis] * self.root, noise], axis=-1))
        return Gaussian(decay * self.mean, root)


class Gain(NamedTuple):
    """What linear measurements make of a distribution.

    Attributes:
        gain: change of the mean by the residuals, (..., n, m).
        innovation_root: lower triangular root of the covariance of the residuals, (..., m, m).
        root: of the covariance after, (..., n, n).
    """

    gain: FloatArray
    innovation_root: FloatArray
    root: FloatArray


def gain(root: FloatArray, jacobian: FloatArray, noise_root: FloatArray) -> Gain:
    """Of a covariance of ``root`` (..., n, n), measured by ``jacobian`` (..., m, n)."""
    m, n = jacobian.shape[-2:]
    array = np.zeros((*root.shape[:-2], m + n, m + n))
    array[..., :m, :m], array[..., m:, m:] = noise_root, root
    array[..., :m, m:] = jacobian @ root
    lower = lower_root(array)
    innovation_root, across = lower[..., :m, :m], lower[..., m:, :m]
    scaled = solve_lower(innovation_root, across.swapaxes(-1, -2), is_transposed=True)
    return Gain(scaled.swapaxes(-1, -2), innovation_root, lower[..., m:, m:])


def solve_lower(root: FloatArray, right: FloatArray, *, is_transposed: bool = False) -> FloatArray:
    """``right`` (..., n) or (..., n, m) divided by lower triangular ``root``, or its transpose."""
    if root.ndim > 2 and len(root) == 1:
        return solve_lower(root[0], right[0], is_transposed=is_transposed)[np.newaxis]
    if root.ndim > 2:
        matrix = root.swapaxes(-1, -2) if is_transposed else root
        if right.ndim < root.ndim:
            return np.asarray(np.linalg.solve(matrix, right[..., np.newaxis])[..., 0])
        return np.asarray(np.linalg.solve(matrix, right))
    # BLAS is called directly: of matrices this small NumPy's checks take most of the time.
    trans = 0 if is_transposed else 1
    if right.ndim == 1:
        return np.asarray(dtrsv(root.T, right, lower=0, trans=trans))
    return np.asarray(dtrsm(1.0, root.T, right, lower=0, trans_a=trans))


def lower_root(array: FloatArray) -> FloatArray:
    """Lower triangular root of the product of ``array`` (..., n, k) and its transpose."""
    if array.ndim > 2 and len(array) == 1:
        return lower_root(array[0])[np.newaxis]
    # Columns of either sign are a root: make it that of Cholesky.
    if array.ndim == 2:
        factor = dgeqrf(array.T)[0][: len(array)].T
        return np.asarray(_lower(len(array)) * factor * np.copysign(1.0, factor.diagonal()))
    upper = np.asarray(np.linalg.qr(array.swapaxes(-1, -2), mode='r'))
    signs = np.copysign(1.0, np.einsum('...ii->...i', upper))
    return (upper * signs[..., np.newaxis]).swapaxes(-1, -2)


@functools.lru_cache(maxsize=64)
def _lower(size: int) -> FloatArray:
    """Lower triangular matrix (``size``, ``size``) of ones."""
    return np.tri(size)


def square_of(residual: FloatArray, root: FloatArray) -> float:
    """Square of a ``residual`` (m,) in standard deviations; ``root`` is of its covariance."""
    white = solve_lower(root, residual)
    return float(white @ white)


def volume_of(root: FloatArray) -> float:
    """Twice the logarithm of the normal density's denominator, for a covariance of ``root``."""
    return 2.0 * float(np.log(2.0 * np.pi) * 0.5 * len(root) + np.log(root.diagonal()).sum())
