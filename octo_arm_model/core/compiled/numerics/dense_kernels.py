"""Kernels for small dense systems of linear equations."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray

FEW = 8  # largest number of right-hand sides that take less time row by row than all at once


@borrows
def factorise(matrix: FloatArray, pivots: IntArray) -> int:
    """Factorise ``matrix`` (n, n) as L U in place, and fill in the row exchanges ``pivots`` (n,).

    The diagonal of U is stored inverted, which saves divisions. Columns are eliminated in groups
    of four, so that the rest of a row is loaded and stored once per group.

    Returns:
        The sign of the determinant, 1 or -1; 0 where it is singular.
    """
    n, sign = len(matrix), 1
    for first in range(0, n, 4):
        last = min(first + 4, n)
        for j in range(first, last):
            best, largest = j, abs(matrix[j, j])
            for i in range(j + 1, n):
                if abs(matrix[i, j]) > largest:
                    best, largest = i, abs(matrix[i, j])
            pivots[j] = best
            if not largest > 0.0:  # also for NaN
                return 0
            if best != j:
                sign = -sign
                for k in range(n):
                    matrix[j, k], matrix[best, k] = matrix[best, k], matrix[j, k]
            if matrix[j, j] < 0.0:
                sign = -sign
            over = 1.0 / matrix[j, j]
            matrix[j, j] = over
            for i in range(j + 1, n):
                factor = matrix[i, j] * over
                matrix[i, j] = factor
                for k in range(j + 1, last):
                    matrix[i, k] -= factor * matrix[j, k]
        if last == n:
            break
        rows = matrix[first], matrix[first + 1], matrix[first + 2], matrix[first + 3]
        one, two, three, four = rows[0][last:], rows[1][last:], rows[2][last:], rows[3][last:]
        a, b, c = rows[1][first], rows[2][first], rows[2][first + 1]
        d, e, f = rows[3][first], rows[3][first + 1], rows[3][first + 2]
        for k in range(one.size):
            two[k] -= a * one[k]
            three[k] -= b * one[k] + c * two[k]
            four[k] -= d * one[k] + e * two[k] + f * three[k]
        for i in range(last, n):
            row, rest = matrix[i], matrix[i, last:]
            a, b, c, d = row[first], row[first + 1], row[first + 2], row[first + 3]
            for k in range(rest.size):
                rest[k] -= (a * one[k] + b * two[k]) + (c * three[k] + d * four[k])
    return sign


@borrows
def solve_transposed(factors: FloatArray, pivots: IntArray, right: FloatArray) -> None:
    """Solve A^T x = b in place for several matrices A, from their factors by `factorise`.

    ``factors`` are (systems, n, n) and ``pivots`` (systems, n). The rows of ``right`` (systems,
    columns, n) are the right-hand sides b, and the solutions x on return. Forward and back
    substitution run along rows of ``factors``, contiguous in memory, in groups of four. The
    right-hand sides alternate, since the operations on each depend on one another.
    """
    columns, n = right.shape[1:]
    whole = n - n % 4
    for system in range(len(factors)):
        matrix, exchanged = factors[system], pivots[system]
        for i in range(0, whole, 4):
            one, two, three, four = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
            for column in range(columns):
                x = right[system, column]
                a = x[i] * one[i]
                b = (x[i + 1] - a * one[i + 1]) * two[i + 1]
                c = (x[i + 2] - a * one[i + 2] - b * two[i + 2]) * three[i + 2]
                d = (x[i + 3] - a * one[i + 3] - b * two[i + 3] - c * three[i + 3]) * four[i + 3]
                x[i], x[i + 1], x[i + 2], x[i + 3] = a, b, c, d
                for k in range(i + 4, n):
                    x[k] -= (a * one[k] + b * two[k]) + (c * three[k] + d * four[k])
        for column in range(columns):
            x = right[system, column]
            for i in range(whole, n):
                x[i] *= matrix[i, i]
                for k in range(i + 1, n):
                    x[k] -= x[i] * matrix[i, k]
            for i in range(n - 1, whole - 1, -1):
                for k in range(i):
                    x[k] -= x[i] * matrix[i, k]
        for i in range(whole - 4, -1, -4):
            one, two, three, four = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
            for column in range(columns):
                x = right[system, column]
                d = x[i + 3]
                c = x[i + 2] - d * four[i + 2]
                b = x[i + 1] - d * four[i + 1] - c * three[i + 1]
                a = x[i] - d * four[i] - c * three[i] - b * two[i]
                x[i], x[i + 1], x[i + 2] = a, b, c
                for k in range(i):
                    x[k] -= (a * one[k] + b * two[k]) + (c * three[k] + d * four[k])
        for column in range(columns):
            x = right[system, column]
            for i in range(n - 1, -1, -1):
                other = exchanged[i]
                x[i], x[other] = x[other], x[i]


@borrows
def solve_columns(
    factors: FloatArray, pivots: IntArray, right: FloatArray, room: FloatArray
) -> None:
    """Solve A^T x = b in place for one matrix A, from its ``factors`` by `factorise`.

    The columns of ``right`` (n, columns) are the right-hand sides b, and the solutions x on
    return. `solve_transposed` does the same for right-hand sides in rows, here in ``room``
    (columns, n).
    """
    n, columns = right.shape
    if columns <= FEW:
        for i in range(n):
            for column in range(columns):
                room[column, i] = right[i, column]
        solve_transposed(
            factors.reshape(1, n, n), pivots.reshape(1, n), room.reshape(1, columns, n)
        )
        for i in range(n):
            for column in range(columns):
                right[i, column] = room[column, i]
        return
    # Rows go in groups of four, since with fewer at a time most of the time goes into loads and
    # stores.
    for first in range(0, n, 4):
        last = min(first + 4, n)
        for i in range(first, last):
            subtract_rows(right, factors[:first, i], 0, i)
        solve_upper(factors, right, first, last)
    for first in range(n - 1 - (n - 1) % 4, -1, -4):
        last = min(first + 4, n)
        for i in range(first, last):
            subtract_rows(right, factors[last:, i], last, i)
        solve_lower(factors, right, first, last)
    for i in range(n - 1, -1, -1):
        if pivots[i] != i:
            out, other = right[i], right[pivots[i]]
            for c in range(out.size):
                out[c], other[c] = other[c], out[c]


@borrows
def solve_upper(factors: FloatArray, right: FloatArray, first: int, last: int) -> None:
    """Substitute forwards in rows ``first`` to ``last`` of ``right`` (n, columns), in place.

    There are four rows at most; the rows before ``first`` are already subtracted.
    """
    if last - first < 4:
        for i in range(first, last):
            subtract_rows(right, factors[first:i, i], first, i)
            for k in range(right.shape[1]):
                right[i, k] *= factors[i, i]
        return
    f = factors[first:last, first:last]
    one, two, three, four = right[first], right[first + 1], right[first + 2], right[first + 3]
    p, q, r, s = f[0, 0], f[1, 1], f[2, 2], f[3, 3]
    f_1, f_2, f_3, g_2, g_3, h_3 = f[0, 1], f[0, 2], f[0, 3], f[1, 2], f[1, 3], f[2, 3]
    for k in range(one.size):
        a = p * one[k]
        b = q * (two[k] - f_1 * a)
        c = r * (three[k] - f_2 * a - g_2 * b)
        d = s * (four[k] - f_3 * a - g_3 * b - h_3 * c)
        one[k], two[k], three[k], four[k] = a, b, c, d


@borrows
def solve_lower(factors: FloatArray, right: FloatArray, first: int, last: int) -> None:
    """Substitute backwards in rows ``first`` to ``last`` of ``right`` (n, columns), in place.

    There are four rows at most; the rows from ``last`` on are already subtracted.
    """
    if last - first < 4:
        for i in range(last - 1, first - 1, -1):
            subtract_rows(right, factors[i + 1 : last, i], i + 1, i)
        return
    f = factors[first:last, first:last]
    one, two, three, four = right[first], right[first + 1], right[first + 2], right[first + 3]
    f_1, f_2, f_3, g_2, g_3, h_3 = f[1, 0], f[2, 0], f[3, 0], f[2, 1], f[3, 1], f[3, 2]
    for k in range(one.size):
        d = four[k]
        c = three[k] - h_3 * d
        b = two[k] - g_2 * c - g_3 * d
        one[k] -= f_1 * b + f_2 * c + f_3 * d
        two[k], three[k] = b, c


@borrows
def subtract_rows(rows: FloatArray, factors: FloatArray, first: int, target: int) -> None:
    """Subtract from the row ``target`` of ``rows`` those from ``first`` on, times ``factors``."""
    i, out = 0, rows[target]
    # In groups of eight, so that `out` is loaded and stored less often.
    while i + 8 <= factors.size:
        a, b, c, d = factors[i], factors[i + 1], factors[i + 2], factors[i + 3]
        e, f, g, h = factors[i + 4], factors[i + 5], factors[i + 6], factors[i + 7]
        some = rows[first + i : first + i + 8]
        for k in range(out.size):
            out[k] -= (
                (a * some[0, k] + b * some[1, k]) + (c * some[2, k] + d * some[3, k])
                + ((e * some[4, k] + f * some[5, k]) + (g * some[6, k] + h * some[7, k]))
            )  # fmt: skip
        i += 8
    if i + 4 <= factors.size:
        a, b, c, d = factors[i], factors[i + 1], factors[i + 2], factors[i + 3]
        some = rows[first + i : first + i + 4]
        for k in range(out.size):
            out[k] -= (a * some[0, k] + b * some[1, k]) + (c * some[2, k] + d * some[3, k])
        i += 4
    while i < factors.size:
        factor, row = factors[i], rows[first + i]
        for k in range(out.size):
            out[k] -= factor * row[k]
        i += 1


@borrows
def invert_three(matrix: FloatArray, inverse: FloatArray) -> float:
    """Fill in the ``inverse`` (3, 3) of a ``matrix`` (3, 3) and return its determinant."""
    for i in range(3):
        n, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            p, q = (j + 1) % 3, (j + 2) % 3
            inverse[j, i] = matrix[n, p] * matrix[m, q] - matrix[n, q] * matrix[m, p]
    determinant = 0.0
    for j in range(3):
        determinant += matrix[0, j] * inverse[j, 0]
    over = 1.0 / determinant
    for i in range(3):
        for j in range(3):
            inverse[i, j] *= over
    return determinant


def is_definite(matrix: FloatArray) -> bool:
    """Whether the symmetric part of ``matrix`` (n, n) is positive definite.

    It is if all pivots of its symmetric elimination are positive.
    """
    n = len(matrix)
    lower = 0.5 * (matrix + matrix.T)
    for j in range(n):
        if not lower[j, j] > 0.0:
            return False
        for i in range(j + 1, n):
            factor = lower[i, j] / lower[j, j]
            for k in range(j + 1, i + 1):
                lower[i, k] -= factor * lower[k, j]
    return True


@borrows
def solve_definite(matrix: FloatArray, right: FloatArray) -> None:
    """Solve for ``right`` (n, count) in place, with definite matrices (n, n, count).

    The lower halves of ``matrix`` are overwritten by the factors of `eliminate_definite`.
    """
    eliminate_definite(matrix)
    substitute_definite(matrix, right)


def eliminate_definite(matrix: FloatArray) -> None:
    """Factorise definite matrices (n, n, count) in place as L D L^T, in their lower halves.

    L D is stored below the diagonal and the inverse of D on it, whereas the NumPy
    counterpart `batched_ldlt.factorise` stores L and D.
    """
    n, factor = len(matrix), np.empty(matrix.shape[2])
    for j in range(n):
        for p in range(factor.size):
            matrix[j, j, p] = 1.0 / matrix[j, j, p]
        for i in range(j + 1, n):
            for p in range(factor.size):
                factor[p] = matrix[i, j, p] * matrix[j, j, p]
            for k in range(j + 1, i + 1):
                for p in range(factor.size):
                    matrix[i, k, p] -= factor[p] * matrix[k, j, p]


@borrows
def substitute_definite(matrix: FloatArray, right: FloatArray) -> None:
    """Solve in place for ``right`` (n, count), from the factors of `eliminate_definite`."""
    n, count = right.shape
    for j in range(n):
        for i in range(j + 1, n):
            for p in range(count):
                right[i, p] -= matrix[i, j, p] * matrix[j, j, p] * right[j, p]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            for p in range(count):
                right[j, p] -= matrix[i, j, p] * right[i, p]
        for p in range(count):
            right[j, p] *= matrix[j, j, p]
