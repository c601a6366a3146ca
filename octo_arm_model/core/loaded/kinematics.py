"""Frames at the points of a `Collocation`, from twists there.

A quaternion Q follows Q' = 1/2 Q w with the angular twist w in the axes of the cross section.
Written as the matrix M = ((a, b), (-conj(b), conj(a))) of its pair of complex numbers (see
`quaternion`), whose products are those of quaternions, that is M' = M K / 2 with

    K = ((c, d), (-conj(d), conj(c)))    c = i w_t    d = w_n + i w_b

and collocated at the Gauss points, which keeps the length of Q at the ends of elements.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import ComplexArray, FloatArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.numerics.gauss import gauss_rule
from octo_arm_model.core.numerics.quaternion import Quaternions

# Real and imaginary parts of -K / 2, row by row, from t, n and b.
_RATES = 0.5 * np.array([
    [0, -1, 0, 0, 0, 0, 0, 1],
    [0, 0, -1, 0, 1, 0, 0, 0],
    [0, 0, 0, -1, 0, -1, 0, 0],
])  # fmt: skip


def matrix_of(orientation: Quaternions) -> ComplexArray:
    """The matrix M, see the module, of a single ``orientation``, (2, 2)."""
    a, b = orientation
    return np.array([[a, b], [-np.conj(b), np.conj(a)]]).reshape(2, 2)


def frames(angular: FloatArray, collocation: Collocation, base: ComplexArray) -> Quaternions:
    """Orientations (..., points) at the points of ``collocation``.

    ``angular`` is the angular twist there [1/m], (3, ..., points), and ``base`` the `matrix_of`
    the orientation of the base, (2, 2).
    """
    _, *lead, _ = angular.shape
    elements, points = collocation.step.size, collocation.rule.points.size
    from_start, start = _tables(points)
    rates = (collocation.steps * angular).reshape(3, -1).T @ _RATES
    by_point = rates.view(np.complex128).reshape(-1, 1, points, 2, 2).transpose(0, 4, 1, 3, 2)
    # Of a row of M, from a and b at point j, one after the other, to a and b at point i.
    blocks = np.empty((len(by_point), 2, points, 2, points), np.complex128)
    np.multiply(from_start, by_point, out=blocks)
    system = blocks.reshape(-1, 2 * points, 2 * points)
    diagonal = system.reshape(len(system), -1)[:, :: 2 * points + 1]
    diagonal += 1.0
    within = np.linalg.solve(system, start).swapaxes(1, 2).reshape(*lead, elements, 2, -1)
    # At the starts of all elements, as products of two, of four, and so on.
    chain = np.empty((*lead, elements, 2, 2), np.complex128)
    chain[..., 0, :, :] = base
    at_end = within.reshape(*chain.shape, points) @ collocation.at_end
    at_end += collocation.at_start
    chain[..., 1:, :, :] = at_end[..., :-1, :, :]
    done = 1
    while done < elements:
        chain[..., done:, :, :] = chain[..., :-done, :, :] @ chain[..., done:, :, :]
        done *= 2
    rows = (chain[..., :1, :] @ within).reshape(-1, elements, 2, points)
    pair = rows.transpose(2, 0, 1, 3).reshape(2, *lead, -1)
    pair /= np.sqrt(np.add.reduce((pair * pair.conj()).real))
    return Quaternions(*pair)


@functools.cache
def _tables(points: int) -> tuple[ComplexArray, ComplexArray]:
    """Constants of the collocation equations of an element with so many ``points``.

    Returns:
        Matrix of the integrals from its start to each point, (points, 1, points), and the right
        side for M = 1 at its start, (1, 2 points, 2).
    """
    from_start = gauss_rule(points).from_start[:, np.newaxis].astype(np.complex128)
    start = np.repeat(np.eye(2, dtype=np.complex128), points, axis=0)
    return from_start, start[np.newaxis]


def unit(orientation: Quaternions) -> Quaternions:
    """Quaternions divided by their length."""
    a, b = orientation
    length = np.sqrt(a.real**2 + a.imag**2 + b.real**2 + b.imag**2)
    return Quaternions(a / length, b / length)
