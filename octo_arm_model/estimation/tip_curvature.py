"""Second derivatives of the position of the tip, by the geometry of the arm.

In equilibrium the strains u minimise the energy less the work of the tip's force F,
P(u, x) = W - F p(u). The position p of the tip is the derivative of -P by F. So its second
derivatives are third derivatives of P along the responses of the strains to a unit force i on the
tip and to two quantities a and b (adjoint method):

    p_i,ab = D2 p_i [a, b] + D3 (F p) [i, a, b]

If a is a force along k itself, D2 p_k [i, b] is added, and the same holds for b. Let phi be the
rotation and d the displacement of cross sections by each quantity, and
h = d(L) - d - phi x (p(L) - p) the part of the tip's displacement from beyond a section. Then

    D2 p [a, b] = sum over both orders of int d phi_a x h_b
    D3 (F p) [a, b, c] = sum over all orders of int F (phi_a x (d phi_b x h_c)).

Changes of the stiffness of the sections are left out, and so are distributed loads: both are small
where an arm turns far for small strains. A logarithm l that divides a quantity x, such as that of
E or of the loss by friction, makes it x exp(-l). The second derivatives of this product by l, and
by x and l, follow from the first derivatives by l and x.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.estimation.unknowns import State
from octo_arm_model.rod.backbone import Backbone

_MOST = 24  # pieces of the arm, for an error of the integrals of a thousandth
_CYCLES = (0, 1, 2), (1, 2, 0), (2, 0, 1)


def tip_curvature(
    state: State, backbone: Backbone, pose: FloatArray, by_force: FloatArray, ratio: float
) -> FloatArray:
    """Return the second derivatives (3, n, n) of the tip of a ``backbone`` by the ``state``.

    ``pose`` (stations, 6, n) and ``by_force`` (stations, 6, 3) are the derivatives of its pose by
    the state and by a force on the tip. Forces of the state are divided by ``ratio``.
    """
    force, tip, ends = backbone.tip_wrench[:3], pose[-1, :3], _ends(len(pose))
    points = backbone.position.take(ends, axis=0).T
    change = np.concatenate([by_force, pose], axis=2).take(ends, axis=0)
    ends_change = np.ascontiguousarray(change.transpose(1, 0, 2))
    mean_change = 0.5 * (ends_change[:, 1:] + ends_change[:, :-1])
    turn, turn_step = mean_change[3:], ends_change[3:, 1:] - ends_change[3:, :-1]
    lever = (points[:, -1:] - 0.5 * (points[:, 1:] + points[:, :-1]))[..., np.newaxis]
    beyond, second = ends_change[:3, -1:] - mean_change[:3], np.empty((3, *2 * change.shape[2:]))
    for k, i, j in _CYCLES:
        beyond[k] -= turn[i] * lever[j] - turn[j] * lever[i]
    for k, i, j in _CYCLES:
        product = turn_step[i].T @ beyond[j] - turn_step[j].T @ beyond[i]
        second[k] = product + product.T
    by_unit = second[:, :3, 3:].copy()
    if force.any():
        # F (a x (b x c)) = (F b) (a c) - (F c) (a b)
        f_turn_step = np.tensordot(force, turn_step, axes=1)
        f_beyond = np.tensordot(force, beyond, axes=1)
        all_turns = turn.reshape(-1, turn.shape[-1])
        for i in range(3):
            axis = slice(i, i + 1)
            along = (turn[:, :, axis] * beyond + beyond[:, :, axis] * turn).sum(axis=0)
            across = (turn[:, :, axis] * turn_step + turn_step[:, :, axis] * turn).sum(axis=0)
            both = f_turn_step[:, axis] * beyond - f_beyond[:, axis] * turn_step
            product = all_turns.T @ both.reshape(all_turns.shape) + along.T @ f_turn_step
            product -= across.T @ f_beyond
            second[i] += product + product.T
    # A force on the tip also acts directly, as the first or as the second quantity.
    direct = np.tensordot(by_unit, state.tip_wrench[:3] / ratio, axes=(0, 0))
    curvature = np.asarray(second[:, 3:, 3:] + direct + direct.transpose(0, 2, 1))
    # A logarithm divides the quantities of the state, or the tension of its tendon.
    for component in range(state.size)[state.log_modulus]:
        curvature[:, component] -= tip
        curvature[:, :, component] -= tip
        curvature[:, component, component] += tip[:, component]
    loss = np.arange(state.size)[state.tension_loss]
    tension = np.arange(state.size)[state.tension][: loss.size]
    curvature[:, loss, tension] -= tip[:, tension]
    curvature[:, tension, loss] -= tip[:, tension]
    curvature[:, loss, loss] -= tip[:, loss]
    return curvature


@functools.lru_cache(maxsize=64)
def _ends(stations: int) -> IntArray:
    """Return the indices of the stations, of so many ``stations``, at the ends of pieces."""
    return np.unique(np.linspace(0, stations - 1, _MOST + 1).round().astype(np.intp))
