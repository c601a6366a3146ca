"""Normal distribution of a state, and linear measurements of it.

Covariances are kept as square roots, which stay exact where something is known a million times
better than something else (array algorithm, Kailath, Sayed and Hassibi 2000, chapter 12).
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dgeqrf, dpotrf

from octo_arm_model.arm.hints import FloatArray


class Gaussian(NamedTuple):
    """Normal distribution of a state.

    Attributes:
        mean: (n,).
        root: lower triangular square root of the covariance, (n, n).
    """

    mean: FloatArray
    root: FloatArray

    @classmethod
    def of(cls, mean: FloatArray, covariance: FloatArray) -> Gaussian:
        """Of a ``covariance`` (n, n).

        Raises:
            LinAlgError: if it is not positive definite.
        """
        upper, failed = dpotrf(covariance, lower=0)
        if failed:
            raise np.linalg.LinAlgError('a covariance is not positive definite')
        return cls(mean, upper.T)


class Gain(NamedTuple):
    """What linear measurements make of a distribution.

    Attributes:
        gain: change of the mean by the residuals, (n, m).
        innovation_root: lower triangular root of the covariance of the residuals, (m, m).
        root: of the covariance after, (n, n).
    """

    gain: FloatArray
    innovation_root: FloatArray
    root: FloatArray


def gain(root: FloatArray, jacobian: FloatArray, noise_root: FloatArray) -> Gain:
    """Of a covariance of ``root`` (n, n), measured by ``jacobian`` (m, n)."""
    m, n = jacobian.shape
    array = np.zeros((m + n, m + n))
    array[:m, :m], array[m:, m:] = noise_root, root
    array[:m, m:] = jacobian @ root
    lower = lower_root(array)
    innovation_root, across = lower[:m, :m], lower[m:, :m]
    scaled = solve_lower(innovation_root, across.T, is_transposed=True)
    return Gain(scaled.T, innovation_root, lower[m:, m:])


def solve_lower(root: FloatArray, right: FloatArray, *, is_transposed: bool = False) -> FloatArray:
    """``right`` (n,) or (n, m) divided by lower triangular ``root``, or its transpose."""
    # BLAS is called directly: of matrices this small NumPy's checks take most of the time.
    trans = 0 if is_transposed else 1
    if right.ndim == 1:
        return np.asarray(dtrsv(root.T, right, lower=0, trans=trans))
    return np.asarray(dtrsm(1.0, root.T, right, lower=0, trans_a=trans))


def lower_root(array: FloatArray) -> FloatArray:
    """Lower triangular root of the product of ``array`` (n, k) and its transpose."""
    factor = dgeqrf(array.T)[0][: len(array)].T
    # Columns of either sign are a root: make it that of Cholesky.
    return np.asarray(_lower(len(array)) * factor * np.copysign(1.0, factor.diagonal()))


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
