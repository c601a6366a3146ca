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


class CurvedTip:
    """Second derivatives of the tip by a state: where its components are among those by forces."""

    def __init__(self, state: State) -> None:
        """Of ``state``, whose forces on the tip come first."""
        force = np.arange(state.size)[state.tip_force]
        self._others = np.setdiff1d(np.flatnonzero(state.shapes), force)
        each = np.concatenate([force, self._others])
        # In a matrix (n, n) as one row.
        self._where = (each[:, np.newaxis] * state.size + each).ravel()
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
        second = tip_curvature(backbone.position, by, backbone.tip_wrench[:3])
        second[:, :3] /= ratio
        second[:, :, :3] /= ratio
        some = second[:, self._skipped :, self._skipped :]
        found = np.zeros((3, self._size * self._size))
        found[:, self._where] = some.reshape(3, -1)
        one, other, divided = self._divided
        found[:, one * self._size + other] -= pose[-1, :3].take(divided, axis=1)
        return found.reshape(3, self._size, self._size)


def _divided(state: State) -> IntArray:
    """Two components of which one divides, and the one that is divided, (3, pairs)."""
    every, pairs = np.arange(state.size), []
    for loss, tension in zip(every[state.tension_loss], every[state.tension], strict=False):
        pairs += [(loss, loss, loss), (loss, tension, tension), (tension, loss, tension)]
    for modulus in every[state.log_modulus]:
        others = every[state.shapes & (every != modulus)]
        pairs += [(modulus, modulus, modulus), *((modulus, one, one) for one in others)]
        pairs += [(one, modulus, one) for one in others]
    return np.array(pairs, np.intp).reshape(-1, 3).T


def tip_curvature(position: FloatArray, change: FloatArray, force: FloatArray) -> FloatArray:
    """Second derivatives of the tip's position, (3, 3 + n, 3 + n).

    By forces on the tip along all axes, which come first, and by n quantities that are none.
    ``position`` (stations, 3) is that of stations, ``change`` (stations, 6, 3 + n) that of their
    pose by all of these, ``force`` (3,) acts on the tip.
    """
    some = _some(len(position))
    total = change.shape[2]
    second = np.empty((6, total, total))
    at = position.take(some, axis=0).T
    by = np.ascontiguousarray(change.take(some, axis=0).transpose(1, 0, 2))
    _add_up(at, by, force, second)
    found = second[3:]
    # What a unit force along each axis adds, as the one or as the other quantity.
    by_unit = second[:3, :3]
    found[:, :3] += by_unit.transpose(1, 0, 2)
    found[:, :, :3] += by_unit.transpose(1, 2, 0)
    return found


def _add_up(at: FloatArray, change: FloatArray, force: FloatArray, second: FloatArray) -> None:
    """Fill in the ``second`` derivatives of the tip's position, (6, columns, columns).

    First D2 p, then that and D3 (F p), both (3, columns, columns). Stations are ``at`` (3,
    stations); the ``change`` of their pose (6, stations, columns) by a unit ``force`` (3,) along
    each axis comes first.
    """
    middle = 0.5 * (change[:, 1:] + change[:, :-1])
    turn, turned = middle[3:], change[3:, 1:] - change[3:, :-1]
    beyond = np.empty_like(turned)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        lever_i = (at[i, -1] - 0.5 * (at[i, 1:] + at[i, :-1])).reshape(-1, 1)
        lever_j = (at[j, -1] - 0.5 * (at[j, 1:] + at[j, :-1])).reshape(-1, 1)
        beyond[k] = change[k, -1] - middle[k] - (turn[i] * lever_j - turn[j] * lever_i)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        product = np.dot(turned[i].T, beyond[j]) - np.dot(turned[j].T, beyond[i])
        second[k] = product + product.T
        second[3 + k] = second[k]
    if not force.any():
        return
    # F (a x (b x c)) = (F b) (a c) - (F c) (a b)
    f_turned = force[0] * turned[0] + force[1] * turned[1] + force[2] * turned[2]
    f_beyond = force[0] * beyond[0] + force[1] * beyond[1] + force[2] * beyond[2]
    total = change.shape[2]
    turns = np.ascontiguousarray(turn).reshape(-1, total)
    for i in range(3):
        own = slice(i, i + 1)
        along = (turn[:, :, own] * beyond + beyond[:, :, own] * turn).sum(axis=0)
        across = (turn[:, :, own] * turned + turned[:, :, own] * turn).sum(axis=0)
        both = f_turned[:, own] * beyond - f_beyond[:, own] * turned
        product = np.dot(turns.T, both.reshape(-1, total))
        product += np.dot(along.T, f_turned) - np.dot(across.T, f_beyond)
        second[3 + i] += product + product.T


@functools.lru_cache(maxsize=64)
def _some(stations: int) -> IntArray:
    """Numbers of those of so many ``stations`` that are the ends of pieces."""
    return np.unique(np.linspace(0, stations - 1, _MOST + 1).round().astype(np.intp))
