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


def spread(jacobian: FloatArray) -> FloatArray:
    """Root (n, n) of the covariance after measurements, by that before: upper triangular.

    They have a ``jacobian`` (m, n), in standard deviations of noise per those before.
    """
    identity = np.eye(jacobian.shape[1])
    root = lower_root(np.concatenate([jacobian.T, identity], axis=1))
    return solve_lower(root, identity, is_transposed=True)


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
