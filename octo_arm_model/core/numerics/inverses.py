"""Inverses of matrices from those of others nearby."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import FloatArray

# How often the error of an inverse is squared, and what may be left of 1 before the last time.
_SQUARED, _LEFT = 2, 1e-6


def inverses(matrix: FloatArray, near: FloatArray | None) -> FloatArray:
    """That of every ``matrix`` (..., n, n), from one ``near`` by the iteration of Schulz (1933).

    The iteration squares the error three times; where that is not enough, and without one near,
    inverses are found by elimination.

    Raises:
        LinAlgError: if one is singular.
    """
    if near is not None:
        left = _identity(matrix.shape[-1]) - matrix @ near
        for _ in range(_SQUARED):
            near = near + near @ left
            left = left @ left
        if float(np.abs(left).max()) <= _LEFT:
            return np.asarray(near + near @ left)
    return np.asarray(np.linalg.inv(matrix), np.float64)


@functools.cache
def _identity(size: int) -> FloatArray:
    return np.eye(size)
