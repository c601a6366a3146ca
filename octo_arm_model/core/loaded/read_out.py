"""What a loaded rod is at the nodes and stations of the grid, from its state at the points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.state import State
from octo_arm_model.core.numerics.batched_ldlt import factorise, substitute
from octo_arm_model.core.numerics.quaternion import Quaternions, product
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.strain_measures import derivatives_by_twist

if TYPE_CHECKING:
    from octo_arm_model.core.loaded.rod import LoadedRod


def read_out(rod: LoadedRod, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`ReadOut` of a ``rod``, of one arm or several."""
    # Integrals of rates are far more exact than values between the points.
    t, n, b = 0.5 * state.shape.twist[:3]
    a_rate, b_rate = product(*state.shape.orientation, 1j * t, n + 1j * b)
    rates = np.stack([a_rate.imag, b_rate.real, b_rate.imag, a_rate.real])
    carried = cross(state.tangent, state.force)
    found = rod.stations.integrate_from_base(np.concatenate([state.tangent, rates, carried]))
    a, b = rod.base.rotation
    position = np.moveaxis(found[:3], 0, -1) + rod.base.position
    at_base = [a.imag.item(), b.real.item(), b.imag.item(), a.real.item()]
    turn = np.moveaxis(found[3:7], 0, -1) + at_base
    turn /= np.sqrt(np.add.reduce(turn * turn, axis=-1, keepdims=True))
    twist = rod.nodes.interpolate(state.shape.twist)
    twist[..., rod.station_node] = _at_stations(rod, state, turn, carried, found[7:])
    return twist, position, turn


def _at_stations(
    rod: LoadedRod, state: State, turn: FloatArray, carried: FloatArray, before: FloatArray
) -> FloatArray:
    """Twist (n, ..., stations) at the stations, of orientations ``turn`` (..., stations, 4).

    The wrench of the loads is an integral, and far more exact between the points than what is
    interpolated of the twist: one step of Newton's method balances it with the cross section.
    Along s moments change by what is ``carried`` (3, ..., points), with the integrals ``before``
    (3, ..., stations) from the base.
    """
    stations, own = rod.stations, rod.equilibrium.collocation
    others = state.moment - own.integrate_from_tip(carried)
    at = stations.interpolate(np.concatenate([others, state.force, state.shape.twist]))
    twist = at[6:]
    # As a batch of cross sections, of one arm or several.
    batch = twist.reshape(len(twist), -1, twist.shape[-1])
    if state.sliding is None:
        tensions = np.atleast_2d(state.condition.tensions)
        energy, tensions = rod.station_sections.pulled(tensions)
    else:
        energy, tensions = rod.station_sections, stations.interpolate(state.sliding.tensions)
    gradient, hessian = derivatives_by_twist(energy, batch, tensions)
    at[:3] += (carried @ own.weights)[..., np.newaxis] - before
    rotation = Quaternions.from_xyzw(turn).matrix()
    wrench = np.einsum('ji...,kj...->ki...', rotation, at[:6].reshape(2, 3, *at.shape[1:]))
    wrench = wrench.reshape(6, *at.shape[1:])[: len(twist)]
    step = substitute(factorise(hessian), wrench.reshape(batch.shape) - gradient)
    return np.asarray(twist + step.reshape(twist.shape))
