"""A Gaussian belief about a state, and its correction by linear measurements.

Its covariance is kept as a square root, which stays exact where something is known a million
times better than something else (array algorithm, Kailath, Sayed and Hassibi 2000, chapter 12).
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dgeqrf

from octo_arm_model.arm.hints import FloatArray


class Belief(NamedTuple):
    """Normal distribution of a state.

    Attributes:
        mean: (n,).
        root: lower triangular square root of the covariance, (n, n).
        scatter: the part of the covariance by which the state is random about a mean that is
            known, (n, n); None of all. The rest is by what sensors err, and by random walks.
    """

    mean: FloatArray
    root: FloatArray
    scatter: FloatArray | None = None

    @property
    def covariance(self) -> FloatArray:
        """Covariance, (n, n)."""
        return self.root @ self.root.T

    @property
    def scattered(self) -> FloatArray:
        """`scatter` as a matrix, (n, n)."""
        return self.covariance if self.scatter is None else self.scatter

    def after(self, decay: FloatArray, growth: FloatArray, scatters: NDArray[np.bool_]) -> Belief:
        """Each component times ``decay``, and with a noise of standard deviation ``growth``.

        That is part of the `scatter` of those that it ``scatters``, (n,).
        """
        if not growth.any() and (decay == 1.0).all():
            return self
        root = lower_root([decay[:, np.newaxis] * self.root, np.diag(growth)])
        scatter = decay[:, np.newaxis] * self.scattered * decay
        return Belief(decay * self.mean, root, scatter + np.diag(scatters * growth**2))

    def corrected(self, mean: FloatArray, by: Gain, jacobian: FloatArray) -> Belief:
        """After linear measurements of ``jacobian`` (m, n), which lead to that ``mean``."""
        left = np.eye(mean.size) - by.gain @ jacobian
        return Belief(mean, by.root, left @ self.scattered @ left.T)

    def whitened(self, change: FloatArray) -> FloatArray:
        """A ``change`` (n,) of the state in standard deviations, as independent ones."""
        return solve_lower(self.root, change)


class Gain(NamedTuple):
    """What linear measurements make of a belief.

    Attributes:
        gain: change of the mean by the residuals, (n, m).
        innovation_root: lower triangular root of the covariance of the residuals, (m, m).
        root: of the covariance after, (n, n).
    """

    gain: FloatArray
    innovation_root: FloatArray
    root: FloatArray


def gain(root: FloatArray, jacobian: FloatArray, noise_root: FloatArray) -> Gain:
    """Of a belief of covariance ``root`` root', for measurements of ``jacobian`` (m, n)."""
    m, n = jacobian.shape
    array = np.zeros((m + n, m + n))
    array[:m, :m], array[:m, m:], array[m:, m:] = noise_root, jacobian @ root, root
    lower = _lower_root(array)
    innovation_root = lower[:m, :m]
    scaled = solve_lower(innovation_root, lower[m:, :m].T, is_transposed=True).T
    return Gain(scaled, innovation_root, lower[m:, m:])


def normalised_square(residual: FloatArray, root: FloatArray) -> float:
    """Square of a ``residual`` (m,) in standard deviations; ``root`` is of its covariance."""
    white = solve_lower(root, residual)
    return float(white @ white)


def log_determinant(root: FloatArray) -> float:
    """Logarithm of the determinant of a covariance, by its ``root`` (n, n)."""
    return 2.0 * float(np.log(root.diagonal()).sum())


def solve_lower(root: FloatArray, right: FloatArray, *, is_transposed: bool = False) -> FloatArray:
    """``right`` (n,) or (n, m) divided by the lower triangular ``root``, or its transpose."""
    # BLAS is called directly: of matrices this small NumPy's checks take most of the time, and
    # LAPACK's dtrtrs lets threads wait for each other.
    trans = 0 if is_transposed else 1
    if right.ndim == 1:
        return np.asarray(dtrsv(root.T, right, lower=0, trans=trans))
    return np.asarray(dtrsm(1.0, root.T, right, lower=0, trans_a=trans))


def lower_root(blocks: list[FloatArray]) -> FloatArray:
    """Lower triangular square root of the sum of the squares of ``blocks`` (n, ...)."""
    return _lower_root(np.concatenate(blocks, axis=1))


def _lower_root(array: FloatArray) -> FloatArray:
    """`lower_root` of one ``array``, which is written to."""
    count = len(array)
    lower = dgeqrf(array.T, overwrite_a=1)[0][:count].T
    # Columns of either sign are a root: make it that of Cholesky.
    signs: FloatArray = _triangle(count) * np.copysign(1.0, lower.diagonal())
    return lower * signs


@functools.lru_cache(maxsize=64)
def _triangle(count: int) -> FloatArray:
    """Ones on the diagonal and below."""
    return np.tri(count)
