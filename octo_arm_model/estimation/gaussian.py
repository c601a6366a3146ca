"""Normal distributions of a state, and the linear algebra of their updates.

Covariances are stored as square roots, which stay exact if one component is known a million times
better than another (array algorithm, Kailath, Sayed and Hassibi 2000, chapter 12).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dgeqrf

from octo_arm_model.arm.hints import FloatArray


class Gaussian(NamedTuple):
    """Normal distribution of a state."""

    mean: FloatArray  #: mean of the state, (n,)
    root: FloatArray  #: lower triangular square root of the covariance, (n, n)

    @classmethod
    def of(cls, mean: FloatArray, covariance: FloatArray) -> Gaussian:
        """Return the distribution with a ``mean`` (n,) and a ``covariance`` (n, n).

        Raises:
            LinAlgError: if the covariance is not positive definite.
        """
        return cls(mean, np.asarray(np.linalg.cholesky(covariance)))

    @classmethod
    def mixture(
        cls, center: FloatArray, weight: FloatArray, mean: FloatArray, covariance: FloatArray
    ) -> Gaussian:
        """Return the distribution about ``center`` (n,) with the second moment of a mixture.

        The components have a ``weight`` (k,), ``mean`` (k, n) and ``covariance`` (k, n, n).
        """
        offset = mean - center
        second_moment = np.tensordot(weight, covariance, axes=1) + (weight * offset.T) @ offset
        return cls.of(center, second_moment)


def spread(jacobian: FloatArray) -> FloatArray:
    """Return the factor of the root of the covariance by an update, (n, n), upper triangular.

    The ``jacobian`` (m, n) is in standard deviations of noise per prior standard deviation.
    """
    identity = np.eye(jacobian.shape[1])
    root = lower_root(np.concatenate([jacobian.T, identity], axis=1))
    return solve_lower(root, identity, is_transposed=True)


def solve_lower(root: FloatArray, right: FloatArray, *, is_transposed: bool = False) -> FloatArray:
    """Solve for ``right`` (n,) or (n, m) by a lower triangular ``root``, or by its transpose."""
    # BLAS is called directly, as NumPy's checks take longer than matrices this small.
    trans = 0 if is_transposed else 1
    if right.ndim == 1:
        return np.asarray(dtrsv(root.T, right, lower=0, trans=trans))
    return np.asarray(dtrsm(1.0, root.T, right, lower=0, trans_a=trans))


def lower_root(array: FloatArray) -> FloatArray:
    """Return the lower triangular root of the product of ``array`` (n, k) and its transpose."""
    factor = np.tril(dgeqrf(array.T)[0][: len(array)].T)
    # The signs of the columns are free: take those of the Cholesky factor.
    return np.asarray(factor * np.copysign(1.0, factor.diagonal()))


def square_of(residual: FloatArray, root: FloatArray) -> float:
    """Return the squared norm of a ``residual`` (m,) whose covariance has the ``root`` (m, m)."""
    white = solve_lower(root, residual)
    return float(white @ white)
