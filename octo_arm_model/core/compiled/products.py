"""Products of the compiled kernels."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray


def add_products(row: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Add the product of ``row`` (n,) with ``matrix`` (n, m) to ``out`` (m,)."""
    i = 0
    # By fours, so that `out` is loaded and stored less often.
    while i + 4 <= row.size:
        a, b, c, d = row[i], row[i + 1], row[i + 2], row[i + 3]
        for j in range(out.size):
            out[j] += (
                a * matrix[i, j] + b * matrix[i + 1, j]
                + (c * matrix[i + 2, j] + d * matrix[i + 3, j])
            )  # fmt: skip
        i += 4
    while i < row.size:
        for j in range(out.size):
            out[j] += row[i] * matrix[i, j]
        i += 1


def multiply(matrix: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (m, columns), the transposed ``matrix`` (n, m) times ``rows`` (n, columns).

    All of them lie in order in memory.
    """
    if rows.shape[1] > 1:
        np.dot(matrix.T, rows, out)
        return
    # BLAS takes longer to be called.
    vector = out.reshape(out.size)
    vector[:] = 0.0
    add_products(rows.reshape(rows.size), matrix, vector)
