"""Kernels of a posterior to second order, compiled by numba; `posterior` has the same for NumPy.

One call makes everything of one state, or a whole iteration within what is known about it.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.compiled import compiled, helper


@helper
def divide(upper: FloatArray, right: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (n,), which ``upper`` (n, n), of its triangle, takes to ``right`` (n,)."""
    for i in range(out.size - 1, -1, -1):
        value = right[i]
        for j in range(i + 1, out.size):
            value -= upper[i, j] * out[j]
        out[i] = value / upper[i, i]


@helper
def divide_transposed(upper: FloatArray, right: FloatArray, out: FloatArray) -> None:
    """As `divide`, by the transpose of ``upper``."""
    for i in range(out.size):
        value = right[i]
        for j in range(i):
            value -= upper[j, i] * out[j]
        out[i] = value / upper[i, i]


@helper
def find_away(mean: FloatArray, root: FloatArray, x: FloatArray, z: FloatArray) -> None:
    """Fill in ``z`` (n,), how far ``x`` (n,) is from the ``mean``, divided by the ``root``."""
    for i in range(z.size):
        value = x[i] - mean[i]
        for j in range(i):
            value -= root[i, j] * z[j]
        z[i] = value / root[i, i]


@helper
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


@helper
def eliminate_definite(matrix: FloatArray) -> None:
    """Factorise definite matrices (n, n, count) in place as L D L^T, in their lower halves.

    L D is stored below the diagonal and the inverse of D on it.
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


@helper
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


@helper
def solve_definite(matrix: FloatArray, right: FloatArray) -> None:
    """Solve for ``right`` (n, count) in place, with definite matrices (n, n, count).

    The lower halves of ``matrix`` are overwritten by the factors of `eliminate_definite`.
    """
    eliminate_definite(matrix)
    substitute_definite(matrix, right)


@helper
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


@helper
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


@compiled
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


@helper
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


@helper
def add_up_gradient(gain: FloatArray, second: FloatArray, gradient: FloatArray) -> None:
    """Fill in the ``gradient`` (n,) of `posterior_mean.gradient`."""
    n, m = gain.shape
    for p in range(n):
        gradient[p] = 0.0
    for k in range(m):
        for i in range(n):
            factor = gain[i, k]
            for p in range(n):
                gradient[p] += factor * second[k, i, p]


@helper
def find_gradient(
    part: FloatArray, jacobian: FloatArray, second: FloatArray, innovation_root: FloatArray,
    gain: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``gain`` (n, m) of the ``part`` (n, n) of a covariance, and its ``gradient``.

    The latter (n,) is of ln(det S) / 2, see `posterior_mean`.
    """
    m, n = jacobian.shape
    for i in range(n):
        row = gain[i]
        for k in range(m):
            value = 0.0
            for j in range(n):
                value += jacobian[k, j] * part[j, i]
            for j in range(k):
                value -= innovation_root[k, j] * row[j]
            row[k] = value / innovation_root[k, k]
        for k in range(m - 1, -1, -1):
            value = row[k]
            for j in range(k + 1, m):
                value -= innovation_root[j, k] * row[j]
            row[k] = value / innovation_root[k, k]
    add_up_gradient(gain, second, gradient)


@helper
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


@compiled
def find_posterior(
    mean: FloatArray, root: FloatArray, scattered: FloatArray, noise_root: FloatArray,
    per_noise: FloatArray, weight: float, x: FloatArray, residuals: FloatArray,
    derivatives: FloatArray, seconds: FloatArray, most_bent: float, halvings: int,
    gain: FloatArray, innovation_root: FloatArray, root_after: FloatArray, z: FloatArray,
    left: FloatArray, jacobian: FloatArray, second: FloatArray, slope: FloatArray,
    wanted: FloatArray,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Fill in what measurements make of a belief by themselves, and all about one state ``x``.

    ``residuals``, ``derivatives`` and ``seconds`` are in their own units; ``left``, ``jacobian``
    and ``second`` are the same in standard deviations. ``scattered`` (n, n) is `Belief.scattered`,
    ``slope`` (n,) is `Local.slope` of this ``weight``, and ``wanted`` (n,) is where Newton's step
    leads.

    Returns:
        As `second_order_step`, and by how much measurements bend on the step as
        `Bend` has it: what they predict and its spread, in parts of the noise.
    """
    m, n = derivatives.shape
    bent, half, whole = np.empty((n, n)), np.empty((n, n)), np.empty((m + n, m + n))
    find_gain(root, derivatives, noise_root, whole, gain, innovation_root, root_after)
    whiten_residuals(
        mean, root, per_noise, x, residuals, derivatives, seconds, bent, half, z, left, jacobian,
        second,
    )  # fmt: skip
    change = np.empty(n)
    slope[:] = 0.0
    if weight != 0.0:
        find_gradient(scattered, derivatives, seconds, innovation_root, np.empty((n, m)), change)
        for i in range(n):
            for j in range(i, n):
                slope[i] += weight * change[j] * root[j, i]
    size, cost = second_order_step(
        mean, root, x, z, left, jacobian, second, slope, most_bent, halvings, wanted
    )
    find_away(mean, root, wanted, change)
    for i in range(n):
        change[i] -= z[i]
    # The root after, in standard deviations before.
    for j in range(n):
        for i in range(n):
            value = root_after[i, j]
            for p in range(i):
                value -= root[i, p] * half[p, j]
            half[i, j] = value / root[i, i]
    off, turned, row = 0.0, 0.0, np.empty(n)
    for k in range(m):
        total = 0.0
        for i in range(n):
            row[i] = 0.0
            for j in range(n):
                row[i] += second[k, i, j] * change[j]
            total += row[i] * change[i]
        off += 0.25 * total * total
        for j in range(n):
            value = 0.0
            for i in range(n):
                value += row[i] * half[i, j]
            turned += value * value
    return size, cost, np.sqrt(off), np.sqrt(turned)


@compiled
def second_order_mean(
    mean: FloatArray, root: FloatArray, about: FloatArray, left: FloatArray, jacobian: FloatArray,
    second: FloatArray, slope: FloatArray, most_bent: float, halvings: int, first: int, stop: int,
    steps: int, last: float, shortened: int, start: FloatArray, size: float, cost: float,
    wanted: FloatArray,
) -> bool:  # fmt: skip
    """Iterate within what is known about one state, `Posterior.mean` where nothing is slack.

    From a step of this ``size`` and ``cost`` that leads from ``start`` to ``wanted`` (n,), which
    are both overwritten, the latter by the mean. There are ``steps`` at most, the last of the size
    ``last``; each is halved until what is least does not grow, ``shortened`` times at most.

    Returns:
        Whether nothing was slack: whether no component from ``first`` to ``stop`` came below zero.
    """
    new, tried, new_size, new_cost = np.empty(start.size), np.empty(start.size), size, cost
    for _ in range(steps):
        if size <= last:
            break
        factor, is_less = 1.0, False
        for _ in range(shortened):
            for i in range(start.size):
                tried[i] = start[i] + factor * (wanted[i] - start[i])
            new_size, new_cost = second_order_step(
                mean, root, tried, about, left, jacobian, second, slope, most_bent, halvings, new
            )
            for i in range(first, stop):
                if new[i] < 0.0:
                    return False
            if new_cost <= cost:
                is_less = True
                break
            factor *= 0.5
        if not is_less:
            wanted[:] = tried
            break
        start[:], wanted[:], size, cost = tried, new, new_size, new_cost
    return True


@compiled
def conclude(
    mean: FloatArray, scattered: FloatArray, x: FloatArray, left: FloatArray, jacobian: FloatArray,
    second: FloatArray, gain: FloatArray, innovation_root: FloatArray, root_after: FloatArray,
    innovation: FloatArray, scatter: FloatArray,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Fill in the ``innovation`` (m,) of measurements and the ``scatter`` (n, n) after them.

    They are linearised about ``x``, where so much is ``left`` (m,), in their own units.

    Returns:
        The normalised square of the innovation; how much it draws the mode along the shift, what
        is expected of that and its standard deviation, as `agreement_by` takes them; and
        `share_of`.
    """
    m, n = jacobian.shape
    part, whole, of_part = np.empty(n), np.empty(n), np.empty((n, m))
    find_gradient(scattered, jacobian, second, innovation_root, of_part, part)
    add_up_gradient(gain, second, whole)
    white = np.empty(m)
    for k in range(m):
        innovation[k] = left[k]
        for i in range(n):
            innovation[k] += jacobian[k, i] * (x[i] - mean[i])
    find_away(np.zeros(m), innovation_root, innovation, white)
    square = 0.0
    for k in range(m):
        square += white[k] * white[k]
    # (1 - gain jacobian) scattered (1 - gain jacobian)'
    kept, half = np.eye(n), np.zeros((n, n))
    for i in range(n):
        for k in range(m):
            for j in range(n):
                kept[i, j] -= gain[i, k] * jacobian[k, j]
    for i in range(n):
        for j in range(n):
            for p in range(n):
                half[i, p] += kept[i, j] * scattered[j, p]
    for i in range(n):
        for j in range(n):
            value = 0.0
            for p in range(n):
                value += half[i, p] * kept[j, p]
            scatter[i, j] = value
    # The shift, and the share and the draw along it.
    shift, all_of_it, along = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        for j in range(i, n):
            shift[i] += root_after[j, i] * part[j]
            all_of_it[i] += root_after[j, i] * whole[j]
    own, expected = 0.0, 0.0
    for i in range(n):
        expected += shift[i] * all_of_it[i]
        own += all_of_it[i] * all_of_it[i]
        for j in range(i + 1):
            along[i] += root_after[i, j] * shift[j]
    turned, form = np.empty((m, m)), np.empty((m, m))
    for k in range(m):
        for j in range(m):
            turned[k, j] = 0.0
        for i in range(n):
            value = 0.0
            for p in range(n):
                value += second[k, i, p] * along[p]
            for j in range(m):
                turned[k, j] += value * gain[i, j]
    for j in range(m):
        # One column of turned innovation_root, divided by that root.
        for k in range(m):
            value = 0.0
            for p in range(j, m):
                value += turned[k, p] * innovation_root[p, j]
            for p in range(k):
                value -= innovation_root[k, p] * form[p, j]
            form[k, j] = value / innovation_root[k, k]
    drawn, variance = 0.0, 0.0
    for k in range(m):
        for j in range(m):
            value = 0.5 * (form[k, j] + form[j, k])
            drawn += white[k] * value * white[j]
            variance += 2.0 * value * value
    share = min(max(0.0, expected / own), 1.0) if own != 0.0 else 0.0
    return square, drawn, expected, np.sqrt(variance), share
