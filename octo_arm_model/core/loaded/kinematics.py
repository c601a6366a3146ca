"""Frames at the points of a `Collocation`, from twists there.

A quaternion Q follows Q' = 1/2 Q w with the angular twist w in the axes of the cross section.
Written as a pair of complex numbers (see `quaternion`) that is linear, (a, b)' = (a, b) K / 2 with

    K = ((c, d), (-conj(d), conj(c)))    c = i w_t    d = w_n + i w_b

and collocated at the Gauss points, which keeps the length of Q at the ends of elements.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.numerics.quaternion import Quaternions, cumulative_product


def frames(angular: FloatArray, collocation: Collocation, base: Quaternions) -> Quaternions:
    """Orientations (..., points) at the points under the ``angular`` twist (3, ..., points)."""
    rule, step = collocation.rule, collocation.step
    t, n, b = collocation.by_element(angular) * (0.5 * step[:, np.newaxis])
    *lead, elements, points = t.shape
    # From a and b at point j, one after the other, to a and b at point i of an element.
    blocks = np.empty((*lead, elements, 2, points, 2, points), np.complex128)
    same, other = 1j * t, n + 1j * b
    for row, column, rate in (
        (0, 0, -same), (1, 0, -other), (0, 1, other.conj()), (1, 1, same)
    ):  # fmt: skip
        np.multiply(rule.from_start, rate[..., np.newaxis, :], out=blocks[..., row, :, column, :])
    size = 2 * points
    system = blocks.reshape(*lead, elements, size, size)
    system.reshape(*lead, elements, -1)[..., :: size + 1] += 1.0
    start = np.zeros((*lead, elements, size, 1), np.complex128)
    start[..., :points, :] = 1.0
    found = np.asarray(np.linalg.solve(system, start), dtype=np.complex128)
    found = found.reshape(*lead, elements, 2, points)
    chain = Quaternions.empty(*lead, elements)
    chain.a[..., 0], chain.b[..., 0] = base.a.item(), base.b.item()
    at_end = found[..., :-1, :, :] @ collocation.at_end
    chain.a[..., 1:] = at_end[..., 0] + (1.0 - collocation.at_end.sum())
    chain.b[..., 1:] = at_end[..., 1]
    first = cumulative_product(chain)
    start_of = Quaternions(first.a[..., np.newaxis], first.b[..., np.newaxis])
    at_points = start_of.times((found[..., 0, :], found[..., 1, :]))
    return unit(Quaternions(*(part.reshape(*lead, -1) for part in at_points)))


def unit(orientation: Quaternions) -> Quaternions:
    """Quaternions divided by their length."""
    a, b = orientation
    length = np.sqrt(a.real**2 + a.imag**2 + b.real**2 + b.imag**2)
    return Quaternions(a / length, b / length)
