"""Kernels for products of rows with small matrices."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray, IntArray


def add_products(row: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Add the product of ``row`` (n,) with ``matrix`` (n, m) to ``out`` (m,)."""
    i = 0
    # In groups of four, so that `out` is loaded and stored less often.
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


def add_runs(
    runs: IntArray, matrices: FloatArray, each: int, rows: FloatArray, out: FloatArray
) -> None:
    """Add to ``out`` (k, n) the interpolated values of ``rows`` (k, points).

    Each of ``runs`` has the number of an element, of ``each`` points, and the first and the number
    of the places in ``out`` that lie in it; ``matrices`` has the matrices (each, number) from the
    points to these places, one after another.
    """
    done = 0
    for element, first, count in runs:
        matrix = matrices[done : done + each * count].reshape(each, count)
        for k in range(len(rows)):
            row = rows[k, element * each : element * each + each]
            add_products(row, matrix, out[k, first : first + count])
        done += each * count


def multiply(matrix: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (m, columns), the transposed ``matrix`` (n, m) times ``rows`` (n, columns).

    All of them are C-contiguous.
    """
    if rows.shape[1] > 1:
        np.dot(matrix.T, rows, out)
        return
    # A call of BLAS would take longer.
    vector = out.reshape(out.size)
    vector[:] = 0.0
    add_products(rows.reshape(rows.size), matrix, vector)
