"""Kernels for a belief that measurements correct which are known to second order about a state.

The compiled counterpart of `Posterior`: one call makes everything of one state, or a whole
iteration within what is known about it. Arguments have the names and shapes that they have in
`least_squares_kernels`.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.least_squares_kernels import (
    find_away,
    find_gain,
    second_order_step,
    whiten_residuals,
)
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray


@borrows
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


@borrows
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
