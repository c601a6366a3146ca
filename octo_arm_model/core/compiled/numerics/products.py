"""Kernels for products of rows with small matrices."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray


@borrows
def add_products(row: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Add the product of ``row`` (n,) with ``matrix`` (n, m) to ``out`` (m,)."""
    i = 0
    # Rows of the matrix go in groups of four, so that `out` is loaded and stored less often.
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


@borrows
def add_each(rows: FloatArray, matrices: FloatArray, out: FloatArray) -> None:
    """Add to each row of ``out`` (k, m) the product of a row of ``rows`` (k, n) with its matrix.

    ``matrices`` is (k, n, m), one matrix for each row.
    """
    n, m = matrices.shape[1:]
    for k in range(len(rows)):
        i = 0
        while i + 2 <= n:
            a, b = rows[k, i], rows[k, i + 1]
            for j in range(m):
                out[k, j] += a * matrices[k, i, j] + b * matrices[k, i + 1, j]
            i += 2
        if i < n:
            for j in range(m):
                out[k, j] += rows[k, i] * matrices[k, i, j]


@borrows
def add_runs(
    runs: IntArray, matrices: FloatArray, each: int, rows: FloatArray, out: FloatArray
) -> None:
    """Add to ``out`` (k, n) the interpolated values of ``rows`` (k, points).

    The columns of ``out`` are places along the arm. Each row of ``runs`` (runs, 3) has the number
    of an element, the number of the first place in it and the number of places in it. ``matrices``
    has, one after another, the matrices (each, places) from the values at the ``each`` points of
    an element to those at the places of a run.
    """
    done = 0
    for run in range(len(runs)):
        element, first, count = runs[run, 0], runs[run, 1], runs[run, 2]
        add_run(matrices, done, each, count, rows, element * each, out, first)
        done += each * count


@borrows
def add_run(
    matrices: FloatArray, done: int, each: int, count: int, rows: FloatArray, start: int,
    out: FloatArray, first: int,
) -> None:  # fmt: skip
    """Add to ``out`` (k, n) the interpolated values of ``rows`` (k, points) at places of one run.

    The matrix (each, count) of the run begins at ``done`` in ``matrices``, the points of its
    element at ``start`` in ``rows`` and its places at ``first`` in ``out``.
    """
    # With unsigned indices the compiler need not handle negative ones, which count from the end.
    size, target = np.uint64(count), np.uint64(first)
    for k in range(len(rows)):
        place, point, i = np.uint64(done), np.uint64(start), 0
        # In groups of four, as in `add_products`.
        while i + 4 <= each:
            one, two, three = place + size, place + size + size, place + size + size + size
            a, b = rows[k, point], rows[k, point + np.uint64(1)]
            c, d = rows[k, point + np.uint64(2)], rows[k, point + np.uint64(3)]
            for j in range(count):
                column = np.uint64(j)
                out[k, target + column] += (
                    a * matrices[place + column] + b * matrices[one + column]
                    + (c * matrices[two + column] + d * matrices[three + column])
                )  # fmt: skip
            place, point, i = three + size, point + np.uint64(4), i + 4
        while i < each:
            a = rows[k, point]
            for j in range(count):
                column = np.uint64(j)
                out[k, target + column] += a * matrices[place + column]
            place, point, i = place + size, point + np.uint64(1), i + 1


@borrows
def multiply(matrix: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (m, columns), the transposed ``matrix`` (n, m) times ``rows`` (n, columns).

    It serves for matrices so small that a call of BLAS would take longer.
    """
    n, (many, columns) = len(matrix), out.shape
    out[:] = 0.0
    if columns == 1:
        # The arrays are C-contiguous, so that both reshape to one dimension.
        add_products(rows.reshape(rows.size), matrix, out.reshape(out.size))
        return
    for j in range(many):
        row, i = out[j], 0
        # In groups, so that `row` is loaded and stored less often.
        while i + 8 <= n:
            a, b, c, d = matrix[i, j], matrix[i + 1, j], matrix[i + 2, j], matrix[i + 3, j]
            e, f, g, h = matrix[i + 4, j], matrix[i + 5, j], matrix[i + 6, j], matrix[i + 7, j]
            some = rows[i : i + 8]
            for k in range(columns):
                row[k] += (
                    (a * some[0, k] + b * some[1, k]) + (c * some[2, k] + d * some[3, k])
                    + ((e * some[4, k] + f * some[5, k]) + (g * some[6, k] + h * some[7, k]))
                )  # fmt: skip
            i += 8
        while i + 2 <= n:
            a, b, some = matrix[i, j], matrix[i + 1, j], rows[i : i + 2]
            for k in range(columns):
                row[k] += a * some[0, k] + b * some[1, k]
            i += 2
        if i < n:
            a = matrix[i, j]
            for k in range(columns):
                row[k] += a * rows[i, k]


def multiply_rows(rows: FloatArray, columns: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (..., m), for each element the product of its ``rows`` with a matrix.

    ``rows`` is (..., points), with ``each`` of the points in an element, and ``columns`` (each, m)
    the transpose of that matrix.
    """
    (each, found), many = columns.shape, rows.size // len(columns)
    np.dot(rows.reshape(many, each), columns, out.reshape(many, found))
