"""Second derivatives of the position of the tip, by the geometry of the arm.

An equilibrium makes the energy less the work of the tip's force F, P(u, x) = W - F p(u), least by
the strains u. The position p of the tip is what P changes by with F, so that its second
derivatives are third derivatives of P along what the strains respond with to a unit force i on the
tip, and to two quantities a and b (adjoint method):

    p_i,ab = D2 p_i [a, b] + D3 (F p) [i, a, b]

and where a is a force along k itself D2 p_k [i, b] besides, likewise b. With the rotation phi, the
displacement d of cross sections by each, and that h = d(L) - d - phi x (p(L) - p) of the tip by
what lies beyond a cross section,

    D2 p [a, b] = sum over both orders of int d phi_a x h_b
    D3 (F p) [a, b, c] = sum over all orders of int F (phi_a x (d phi_b x h_c)).

What the sections' own stiffness changes by is left out, and distributed loads are: it is little
where an arm turns far for small strains.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.numerics.vectors import cross

_MOST = 24  # pieces of the arm: the error of the integrals is a thousandth then


def tip_curvature(
    position: FloatArray, by_force: FloatArray, by: FloatArray, force: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Second derivatives of the tip's position by quantities that are no forces on it.

    ``position`` (stations, 3) is that of stations, ``by_force`` and ``by`` their changes of pose
    (stations, 6, ...) by forces on the tip along all axes and by n quantities, ``force`` (3,) acts
    on the tip. Returns them, (3, n, n), and for each axis k what the first of two quantities adds
    that is a unit force along it, (k, 3, n).
    """
    some = _some(len(position))
    at = position[some].T[:, :, np.newaxis]
    change = np.concatenate([by_force[some], by[some]], axis=2).transpose(1, 0, 2).copy()
    middle, turned = 0.5 * (change[:, 1:] + change[:, :-1]), change[3:, 1:] - change[3:, :-1]
    turn, lever = middle[3:], at[:, -1:] - 0.5 * (at[:, 1:] + at[:, :-1])
    beyond = change[:3, -1:] - middle[:3] - cross(turn, np.broadcast_to(lever, turn.shape))
    y, z = [1, 2, 0], [2, 0, 1]
    second = _products(turned[y], beyond[z]) - _products(turned[z], beyond[y])
    second += second.transpose(0, 2, 1)
    unit, own = slice(0, 3), slice(3, None)
    found = second[:, own, own]
    if force.any():
        # F (a x (b x c)) = (F b) (a c) - (F c) (a b)
        f_turned, f_beyond = (np.tensordot(force, one, 1) for one in (turned, beyond))
        of_turn, of_turned, of_beyond = turn[..., own], turned[..., own], beyond[..., own]
        third = _products(
            _across(turn[..., unit], of_beyond) + _across(beyond[..., unit], of_turn),
            f_turned[:, own],
        ) - _products(
            _across(turn[..., unit], of_turned) + _across(turned[..., unit], of_turn),
            f_beyond[:, own],
        )  # fmt: skip
        for number in range(3):
            turning = f_turned[:, number, np.newaxis] * of_beyond
            turning -= f_beyond[:, number, np.newaxis] * of_turned
            third[number] += _products(of_turn, turning).sum(axis=0)
        found = found + third + third.transpose(0, 2, 1)
    return found, second[:, unit, own]


def _products(left: FloatArray, right: FloatArray) -> FloatArray:
    """Integrals (..., m, n) of products of values (..., pieces, m) and (..., pieces, n)."""
    return left.swapaxes(-1, -2) @ right


def _across(unit: FloatArray, other: FloatArray) -> FloatArray:
    """Scalar products (3, pieces, n) of vectors (3, pieces, 3) and (3, pieces, n)."""
    return np.einsum('ksi,ksn->isn', unit, other)


@functools.lru_cache(maxsize=64)
def _some(stations: int) -> IntArray:
    """Numbers of those of so many ``stations`` that are the ends of pieces."""
    return np.unique(np.linspace(0, stations - 1, _MOST + 1).round().astype(np.intp))
