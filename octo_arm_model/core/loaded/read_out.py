"""What a loaded rod is at the nodes and stations of the grid, from its state at the points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.state import State
from octo_arm_model.core.numerics.quaternion import product, rotation_matrices
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.strain_measures import derivatives_by_twist, gradient_by_twist

if TYPE_CHECKING:
    from octo_arm_model.core.loaded.rod import LoadedRod

_XYZW = [1, 2, 3, 0]  # of w, x, y, z


def read_out(
    rod: LoadedRod, state: State, hessian: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`ReadOut` of a ``rod``, of one arm or several.

    ``hessian`` (n, n, ..., points) of the energy by the twist, in nearly this state, saves the
    evaluation of that at the stations.
    """
    # Integrals of rates are far more exact than values between the points.
    t, n, b = 0.5 * state.shape.twist[:3]
    a_rate, b_rate = product(*state.shape.orientation, 1j * t, n + 1j * b)
    carried = cross(state.tangent, state.force)
    rates = np.empty((10, *t.shape))
    rates[:3], rates[7:] = state.tangent, carried
    rates[3], rates[4], rates[5], rates[6] = a_rate.real, a_rate.imag, b_rate.real, b_rate.imag
    found = rod.stations.integrate_from_base(rates)
    a, b = rod.base.rotation
    last = *range(1, found.ndim), 0
    position = found[:3].transpose(last) + rod.base.position
    turn = found[3:7]
    at_base = np.array([a.real, a.imag, b.real, b.imag])
    turn += at_base.reshape(4, *(1,) * (turn.ndim - 1))
    turn /= np.sqrt(np.add.reduce(turn * turn))
    twist = rod.nodes.interpolate(state.shape.twist)
    twist[..., rod.station_node] = _at_stations(rod, state, hessian, turn, carried, found[7:])
    return twist, position, turn.take(_XYZW, axis=0).transpose(last).copy()


def _at_stations(
    rod: LoadedRod, state: State, hessian: FloatArray | None, turn: FloatArray,
    carried: FloatArray, before: FloatArray,
) -> FloatArray:  # fmt: skip
    """Twist (n, ..., stations) at the stations, of orientations ``turn`` (4, ..., stations).

    The wrench of the loads is an integral, and far more exact between the points than what is
    interpolated of the twist: one step of Newton's method balances it with the cross section. A
    ``hessian`` at the points is interpolated as well, which is exact enough for so small a step.
    Along s moments change by what is ``carried`` (3, ..., points), with the integrals ``before``
    (3, ..., stations) from the base.

    Raises:
        ConvergenceError: if a cross section has a singular stiffness there.
    """
    stations, own = rod.stations, rod.equilibrium.collocation
    others = rod.equilibrium.moment_apart(state)
    count, lead = len(state.shape.twist), others.shape[1:]
    rows = [others, state.force, state.shape.twist]
    if hessian is not None:
        rows.append(hessian.reshape(count * count, *lead))
    at = stations.interpolate(np.concatenate(rows))
    twist = at[6 : 6 + count]
    # As a batch of cross sections, of one arm or several.
    batch = twist.reshape(count, -1, twist.shape[-1])
    if state.sliding is None:
        tensions = np.atleast_2d(state.condition.tensions)
        energy, tensions = rod.station_sections.pulled(tensions)
    else:
        energy, tensions = rod.station_sections, stations.interpolate(state.sliding.tensions)
    if hessian is None:
        gradient, hessian = derivatives_by_twist(energy, batch, tensions)
    else:
        gradient = gradient_by_twist(energy, batch, tensions)
        hessian = at[6 + count :].reshape(count, count, *batch.shape[1:])
    at[:3] += (carried @ own.weights)[..., np.newaxis] - before
    rotation = rotation_matrices(turn)
    wrench = np.einsum('ji...,kj...->ki...', rotation, at[:6].reshape(2, 3, *at.shape[1:]))
    wrench = wrench.reshape(6, *at.shape[1:])[:count]
    left = (wrench.reshape(batch.shape) - gradient).transpose(1, 2, 0)[..., np.newaxis]
    try:
        step = np.linalg.solve(hessian.transpose(2, 3, 0, 1), left)[..., 0].transpose(2, 0, 1)
    except np.linalg.LinAlgError:
        raise ConvergenceError('the balance of a cross section', np.inf, 0) from None
    return np.asarray(twist + step.reshape(twist.shape))
