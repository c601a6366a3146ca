"""Kernels for least squares of residuals that are known to second order about one state.

Least is |left - ...|^2 + |z|^2, where z is the state in standard deviations of what was known of
it before, and residuals are in those of their noise.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.dense_kernels import is_definite, solve_definite
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray


@borrows
def whiten_residuals(
    mean: FloatArray, root: FloatArray, per_noise: FloatArray, x: FloatArray, left: FloatArray,
    jacobian: FloatArray, second: FloatArray, bent: FloatArray, half: FloatArray, z: FloatArray,
    white_left: FloatArray, white_jacobian: FloatArray, white_second: FloatArray,
) -> None:  # fmt: skip
    """Fill in a state and what is ``left`` there, with derivatives, in standard deviations.

    The state ``x`` (n,) is one of ``mean`` (n,) and of the lower triangular ``root`` (n, n) of its
    covariance; ``per_noise`` (m, m) is the inverse of that of the noise, lower triangular too.
    ``left`` (m,) are residuals, measured less predicted, ``jacobian`` (m, n) and ``second`` (m, n,
    n) the derivatives of what is predicted. ``z`` and the arrays ``white_...``, of the same
    shapes, are filled in; ``bent`` and ``half`` (n, n) are scratch space.
    """
    m, n = jacobian.shape
    find_away(mean, root, x, z)
    for k in range(m):
        total = 0.0
        for j in range(k + 1):
            total += per_noise[k, j] * left[j]
        white_left[k] = total
        for i in range(n):
            value = 0.0
            for j in range(k + 1):
                value += per_noise[k, j] * jacobian[j, i]
            half[0, i] = value
        for i in range(n):
            value = 0.0
            for j in range(i, n):
                value += half[0, j] * root[j, i]
            white_jacobian[k, i] = value
        for i in range(n):
            for p in range(n):
                value = 0.0
                for j in range(k + 1):
                    value += per_noise[k, j] * second[j, i, p]
                bent[i, p] = value
        for i in range(n):
            for p in range(n):
                half[i, p] = 0.0
            for j in range(n):
                factor = bent[i, j]
                for p in range(j + 1):
                    half[i, p] += factor * root[j, p]
        for i in range(n):
            for p in range(n):
                white_second[k, i, p] = 0.0
            for j in range(i, n):
                factor = root[j, i]
                for p in range(n):
                    white_second[k, i, p] += factor * half[j, p]


@borrows
def find_away(mean: FloatArray, root: FloatArray, x: FloatArray, z: FloatArray) -> None:
    """Fill in ``z`` (n,), how far ``x`` (n,) is from the ``mean``, divided by the ``root``."""
    for i in range(z.size):
        value = x[i] - mean[i]
        for j in range(i):
            value -= root[i, j] * z[j]
        z[i] = value / root[i, i]


@borrows
def find_gain(
    root: FloatArray, jacobian: FloatArray, noise_root: FloatArray, array: FloatArray,
    gain: FloatArray, innovation_root: FloatArray, root_after: FloatArray,
) -> None:  # fmt: skip
    """Fill in what linear measurements of ``jacobian`` (m, n) make of a belief of this ``root``.

    The ``gain`` (n, m), the lower triangular roots of the covariances of the residuals, (m, m),
    and of the belief after, (n, n). ``array`` (m + n, m + n) is scratch space.
    """
    m, n = jacobian.shape
    for i in range(m + n):
        for j in range(m + n):
            array[i, j] = 0.0
    for j in range(m):
        for k in range(j + 1):
            array[k, j] = noise_root[j, k]
        for i in range(n):
            value = 0.0
            for p in range(i, n):
                value += jacobian[j, p] * root[p, i]
            array[m + i, j] = value
    for j in range(n):
        for i in range(j + 1):
            array[m + i, m + j] = root[j, i]
    triangulate(array, m + n)
    for k in range(m + n):
        # Rows of either sign are a root: make it that of Cholesky.
        sign = np.copysign(1.0, array[k, k])
        for j in range(k, m + n):
            array[k, j] *= sign
    for i in range(m):
        for j in range(m):
            innovation_root[i, j] = array[j, i] if j <= i else 0.0
    for i in range(n):
        for j in range(n):
            root_after[i, j] = array[m + j, m + i] if j <= i else 0.0
        divide(array, array[:m, m + i], gain[i])


def second_order_step(
    mean: FloatArray, root: FloatArray, x: FloatArray, about: FloatArray, left: FloatArray,
    jacobian: FloatArray, second: FloatArray, slope: FloatArray, most_bent: float, halvings: int,
    wanted: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Fill in the state ``wanted`` (n,) that Newton's step leads to from ``x`` (n,).

    ``left`` (m,), ``jacobian`` (m, n) and ``second`` (m, n, n) are those that `whiten_residuals`
    makes, in the state ``about`` (n,) in standard deviations, and ``slope`` (n,) is the gradient
    of what is least besides. As residuals bend, the matrix of the step of Gauss and Newton loses a
    part of itself: that is halved, ``halvings`` times at most, until no direction loses more than
    ``most_bent``.

    Returns:
        The size of the step, in standard deviations a component, and what is least in ``x``.
    """
    m, n = jacobian.shape
    z, array, bent = np.empty(n), np.zeros((m + n, n + 1)), np.zeros((n, n))
    change, half = np.empty(n), np.empty((n, n))
    find_away(mean, root, x, z)
    cost = 0.0
    for k in range(m):
        total = left[k]
        for i in range(n):
            turned = 0.0
            for j in range(n):
                turned += second[k, i, j] * (z[j] - about[j])
            total -= (jacobian[k, i] + 0.5 * turned) * (z[i] - about[i])
            array[k, i] = jacobian[k, i] + turned
        array[k, n] = total
        cost += total * total
    for i in range(n):
        array[m + i, i], array[m + i, n] = 1.0, -z[i]
        cost += z[i] * z[i] + 2.0 * slope[i] * (z[i] - about[i])
    own = array[:m].copy()
    triangulate(array, n)
    divide(array, array[:n, n], change)
    # What Gauss and Newton leave out: what is left after their step, times how it bends.
    for k in range(m):
        value = own[k, n]
        for i in range(n):
            value -= own[k, i] * change[i]
        for i in range(n):
            for j in range(n):
                bent[i, j] += value * second[k, i, j]
    for row in range(n):
        divide_transposed(array, bent[row], half[row])
    for row in range(n):
        divide_transposed(array, half[:, row].copy(), bent[row])
    divide_transposed(array, slope, change)
    for i in range(n):
        change[i] = array[i, n] - change[i]
    stiffen(bent, most_bent, halvings, change)
    size = 0.0
    for i in range(n):
        size += change[i] * change[i]
    divide(array, change, z)
    for i in range(n):
        value = x[i]
        for j in range(i + 1):
            value += root[i, j] * z[j]
        wanted[i] = value
    return np.sqrt(size / n), cost


@borrows
def triangulate(array: FloatArray, columns: int) -> None:
    """Make the first ``columns`` of ``array`` upper triangular by reflections (Householder)."""
    rows, all_columns = array.shape
    for c in range(columns):
        square = 0.0
        for r in range(c, rows):
            square += array[r, c] * array[r, c]
        length = -np.copysign(np.sqrt(square), array[c, c])
        first = array[c, c] - length
        if square == 0.0:
            continue
        for column in range(c + 1, all_columns):
            total = first * array[c, column]
            for r in range(c + 1, rows):
                total += array[r, c] * array[r, column]
            total /= length * first
            array[c, column] += total * first
            for r in range(c + 1, rows):
                array[r, column] += total * array[r, c]
        array[c, c] = length


@borrows
def divide(upper: FloatArray, right: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (n,), which ``upper`` (n, n), of its triangle, takes to ``right`` (n,)."""
    for i in range(out.size - 1, -1, -1):
        value = right[i]
        for j in range(i + 1, out.size):
            value -= upper[i, j] * out[j]
        out[i] = value / upper[i, i]


@borrows
def divide_transposed(upper: FloatArray, right: FloatArray, out: FloatArray) -> None:
    """As `divide`, by the transpose of ``upper``."""
    for i in range(out.size):
        value = right[i]
        for j in range(i):
            value -= upper[j, i] * out[j]
        out[i] = value / upper[i, i]


def stiffen(bent: FloatArray, most: float, halvings: int, change: FloatArray) -> None:
    """Divide ``change`` (n,) by 1 - ``bent`` (n, n), in place.

    While a part of ``bent`` is above ``most`` it is halved, ``halvings`` times at most; ``change``
    stays where that does not suffice.
    """
    n = change.size
    for _ in range(halvings):
        square = 0.0
        for i in range(n):
            for j in range(n):
                square += bent[i, j] * bent[i, j]
        # No part is above the root of the sum of all squares.
        if square <= most * most or is_definite(most * np.eye(n) - bent):
            solve_definite((np.eye(n) - bent).reshape(n, n, 1), change.reshape(n, 1))
            return
        bent *= 0.5
