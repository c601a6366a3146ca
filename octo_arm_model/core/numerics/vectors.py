"""Vectors (3, ...), one at each node, and products with rows of numbers, one for each arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.hints import FloatArray


def cross(u: FloatArray, v: FloatArray) -> FloatArray:
    """Cross product along the first axis (np.cross is slow)."""
    return np.stack([
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ])  # fmt: skip


def skew(v: FloatArray) -> FloatArray:
    """Matrices (3, 3, n) that take w to v x w, for vectors v (3, n)."""
    matrix = np.zeros((3, *v.shape))
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = -v[2], v[1], -v[0]
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = v[2], -v[1], v[0]
    return matrix


def times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Product of each of ``rows`` (..., k) with ``matrix`` (k, n) or (..., 1, k, n).

    BLAS gets one row at a time, as it rounds several together differently: replay, which solves
    batches, must write the bytes of the node, which solves one arm at a time.
    """
    product: FloatArray = rows[..., np.newaxis, :] @ matrix
    return product[..., 0, :]


def runs_of(inside: NDArray[np.bool_]) -> list[slice]:
    """Where ``inside`` is true, as runs without gaps."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
    return [slice(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]
