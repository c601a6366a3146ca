"""A Gaussian belief about a state, and its correction by linear measurements.

Its covariance is kept as a square root, which stays exact where something is known a million
times better than something else (array algorithm, Kailath, Sayed and Hassibi 2000, chapter 12).
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from octo_arm_model.core.hints import FloatArray


class Belief(NamedTuple):
    """Normal distribution of a state.

    Attributes:
        mean: (n,).
        root: lower triangular square root of the covariance, (n, n).
    """

    mean: FloatArray
    root: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariance, (n, n)."""
        return self.root @ self.root.T

    def after(self, decay: FloatArray, growth: FloatArray) -> Belief:
        """Each component times ``decay``, and with a noise of standard deviation ``growth``."""
        if not growth.any() and (decay == 1.0).all():
            return self
        root = lower_root([decay[:, np.newaxis] * self.root, np.diag(growth)])
        return Belief(decay * self.mean, root)

    def whitened(self, change: FloatArray) -> FloatArray:
        """A ``change`` (n,) of the state in standard deviations, as independent ones."""
        return np.asarray(np.linalg.solve(self.root, change), np.float64)


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
    lower = lower_root([array])
    innovation_root = lower[:m, :m]
    scaled = np.asarray(np.linalg.solve(innovation_root.T, lower[m:, :m].T).T, np.float64)
    return Gain(scaled, innovation_root, lower[m:, m:])


def normalised_square(residual: FloatArray, root: FloatArray) -> float:
    """Square of a ``residual`` (m,) in standard deviations; ``root`` is of its covariance."""
    white = np.linalg.solve(root, residual)
    return float(white @ white)


@functools.lru_cache(maxsize=1024)
def chi_square_limit(probability: float, size: int) -> float:
    """What a normalised square of ``size`` numbers exceeds with 1 - ``probability``."""
    return float(chi2.ppf(probability, size))


def lower_root(blocks: list[FloatArray]) -> FloatArray:
    """Lower triangular square root of the sum of the squares of ``blocks`` (n, ...)."""
    upper = np.asarray(np.linalg.qr(np.concatenate(blocks, axis=1).T, mode='r'))
    # Rows of either sign are a root: make it that of Cholesky.
    lower: FloatArray = (upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, np.newaxis]).T
    return lower
