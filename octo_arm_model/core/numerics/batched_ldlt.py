"""Batches of small symmetric linear systems, one for each cross section.

Matrices are arrays (n, n, ...) and right-hand sides (n, ...) or (n, columns, ...): every step of
the elimination is one operation on the whole batch, where LAPACK takes one call for each system.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.hints import FloatArray


def factorise(matrix: FloatArray) -> FloatArray:
    """L D L^T of symmetric matrices (n, n, ...): L below the diagonal and D on it.

    No pivoting: exact enough for definite matrices, which have D > 0.
    """
    factors = matrix.copy()
    for j in range(len(factors) - 1):
        column = factors[j + 1 :, j]
        column /= factors[j, j]
        factors[j + 1 :, j + 1 :] -= column[:, np.newaxis] * factors[j, j + 1 :]
    return factors


def substitute(factors: FloatArray, right: FloatArray) -> FloatArray:
    """Solve factorised systems for right-hand sides ``right`` (n, ...) or (n, columns, ...)."""
    count = len(factors)
    if right.ndim == factors.ndim:
        factors = factors[:, :, np.newaxis]
    solution = right.copy()
    for j in range(count - 1):
        solution[j + 1 :] -= factors[j + 1 :, j] * solution[j]
    for j in range(count):
        solution[j] /= factors[j, j]
    for j in range(count - 1, 0, -1):
        solution[:j] -= factors[j, :j] * solution[j]
    return solution


def invert(factors: FloatArray) -> FloatArray:
    """Inverse (n, n, ...) of factorised matrices."""
    count = len(factors)
    if count == 1:
        return 1.0 / factors
    identity = np.zeros((count, *factors.shape[1:]))
    for j in range(count):
        identity[j, j] = 1.0
    return substitute(factors, identity)


def are_definite(matrices: FloatArray) -> NDArray[np.bool_]:
    """Whether the symmetric parts of ``matrices`` (sets, ..., n, n) are definite, (sets,)."""
    return have_factors(definite_factors(matrices))


def definite_factors(matrices: FloatArray) -> FloatArray:
    """L of L L^T, the ``matrices`` (sets, ..., n, n) plus their transposes; where definite.

    NaN in all of a set of which one is not.
    """
    both: FloatArray = matrices + matrices.swapaxes(-1, -2)
    try:
        return np.asarray(np.linalg.cholesky(both))
    except np.linalg.LinAlgError:
        if len(both) == 1:
            return np.full_like(both, np.nan)
        return np.concatenate([definite_factors(one[np.newaxis]) for one in matrices])


def have_factors(factors: FloatArray) -> NDArray[np.bool_]:
    """Whether each set of `definite_factors` is definite, (sets,)."""
    return np.isfinite(factors.reshape(len(factors), -1)[:, -1])
