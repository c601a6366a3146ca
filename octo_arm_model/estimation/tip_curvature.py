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
where an arm turns far for small strains. A logarithm l that divides a quantity x, as that of E or
of what friction holds back, makes it x exp(-l): that has second derivatives by l, and by x and l,
of its own, which are those of the first order by l and x.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.estimation.unknowns import State
from octo_arm_model.rod.backbone import Backbone

_MOST = 24  # pieces of the arm: the error of the integrals is a thousandth then
_CYCLES = (0, 1, 2), (1, 2, 0), (2, 0, 1)


class TipCurvature:
    """Second derivatives of the tip by a state: where its components are among those by forces."""

    def __init__(self, state: State) -> None:
        """Of ``state``, whose forces on the tip come first."""
        force = np.arange(state.size)[state.tip_force]
        self._others = np.setdiff1d(np.flatnonzero(state.shapes), force)
        self._each = np.concatenate([force, self._others])
        self._size, self._skipped = state.size, 3 - force.size
        self._divided = _divided(state)

    def by_state(
        self, backbone: Backbone, pose: FloatArray, by_force: FloatArray, ratio: float
    ) -> FloatArray:
        """Second derivatives (3, n, n) of the tip of a ``backbone`` by the state.

        ``pose`` (stations, 6, n) is the change of its pose by the state, ``by_force`` (stations,
        6, 3) that by a force on the tip; forces of the state act divided by ``ratio``.
        """
        by = np.concatenate([by_force, pose.take(self._others, axis=2)], axis=2)
        second = _second_derivatives(backbone.position, by, backbone.tip_wrench[:3])
        second[:, :3] /= ratio
        second[:, :, :3] /= ratio
        found = np.zeros((3, self._size, self._size))
        each, some = self._each, slice(self._skipped, None)
        found[:, each[:, np.newaxis], each] = second[:, some, some]
        one, other, divided = self._divided
        found[:, one, other] -= pose[-1, :3].take(divided, axis=1)
        return found


def _divided(state: State) -> IntArray:
    """Two components of which one divides, and the one that is divided, (3, pairs)."""
    every = np.arange(state.size)
    pairs = list(zip(every[state.tension_loss], every[state.tension], strict=False))
    for modulus in every[state.log_modulus]:
        pairs += [(modulus, one) for one in every[state.shapes] if one != modulus]
    found = [(one, one, one) for one in {divisor for divisor, _ in pairs}]
    for divisor, one in pairs:
        found += [(divisor, one, one), (one, divisor, one)]
    return np.array(found, np.intp).reshape(-1, 3).T


def _second_derivatives(position: FloatArray, change: FloatArray, force: FloatArray) -> FloatArray:
    """Of the tip, (3, 3 + n, 3 + n), by forces on it along all axes, which come first, and others.

    ``position`` (stations, 3) is that of stations, ``change`` (stations, 6, 3 + n) that of their
    pose by all of these, ``force`` (3,) acts on the tip.
    """
    ends = _ends(len(position))
    at = position.take(ends, axis=0).T
    by = np.ascontiguousarray(change.take(ends, axis=0).transpose(1, 0, 2))
    middle = 0.5 * (by[:, 1:] + by[:, :-1])
    turn, turned = middle[3:], by[3:, 1:] - by[3:, :-1]
    lever = (at[:, -1:] - 0.5 * (at[:, 1:] + at[:, :-1]))[..., np.newaxis]
    beyond, second = by[:3, -1:] - middle[:3], np.empty((3, *2 * change.shape[2:]))
    for k, i, j in _CYCLES:
        beyond[k] -= turn[i] * lever[j] - turn[j] * lever[i]
    for k, i, j in _CYCLES:
        product = turned[i].T @ beyond[j] - turned[j].T @ beyond[i]
        second[k] = product + product.T
    by_unit = second[:, :3].copy()
    if force.any():
        # F (a x (b x c)) = (F b) (a c) - (F c) (a b)
        f_turned, f_beyond = (np.tensordot(force, one, axes=1) for one in (turned, beyond))
        turns = turn.reshape(-1, turn.shape[-1])
        for i in range(3):
            own = slice(i, i + 1)
            along = (turn[:, :, own] * beyond + beyond[:, :, own] * turn).sum(axis=0)
            across = (turn[:, :, own] * turned + turned[:, :, own] * turn).sum(axis=0)
            both = f_turned[:, own] * beyond - f_beyond[:, own] * turned
            product = turns.T @ both.reshape(turns.shape) + along.T @ f_turned
            product -= across.T @ f_beyond
            second[i] += product + product.T
    # What a unit force along each axis adds, as the one or as the other quantity.
    second[:, :3] += by_unit.transpose(1, 0, 2)
    second[:, :, :3] += by_unit.transpose(1, 2, 0)
    return second


@functools.lru_cache(maxsize=64)
def _ends(stations: int) -> IntArray:
    """Numbers of those of so many ``stations`` that are the ends of pieces."""
    return np.unique(np.linspace(0, stations - 1, _MOST + 1).round().astype(np.intp))
