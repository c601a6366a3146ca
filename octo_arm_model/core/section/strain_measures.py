"""The twist of the frame and the scaled strain of the `energy`: one from the other."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.energy import SectionEnergy

SHORTEST_FIBRE = 0.02  # of its reference length


def to_twist(law: Law, strain: FloatArray) -> FloatArray:
    """Twist of the frame (n, batch, nodes) from the scaled strain."""
    if not law.widens:
        return strain
    twist = strain.copy()
    twist[:3] /= law.widening(strain[3])[0]
    return twist


def to_scaled(law: Law, twist: FloatArray) -> FloatArray:
    """Scaled strain (n, batch, nodes) from the twist of the frame."""
    if not law.widens:
        return twist
    strain = twist.copy()
    strain[:3] *= law.widening(twist[3])[0]
    return strain


def unscale(
    energy: SectionEnergy, twist: FloatArray, gradient: FloatArray, hessian: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gradient (n, batch, nodes) and Hessian (n, n, batch, nodes) by the ``twist``.

    From those by the scaled strain; the gradient is the moment and the force in the axes of the
    cross section.
    """
    if not energy.law.widens:
        return gradient, hessian
    width, slope, bend = energy.law.widening(twist[3])
    kappa = twist[:3]
    scaled_moment = gradient[:3]
    work = np.add.reduce(kappa * scaled_moment)
    new_gradient = gradient.copy()
    new_gradient[:3] *= width
    new_gradient[3] += slope * work
    new_hessian = hessian.copy()
    by_kappa = np.einsum('ijbn,jbn->ibn', hessian[:3, :3], kappa)
    new_hessian[:3, :3] *= width * width
    mixed = width * (hessian[:3, 3] + slope * by_kappa) + slope * scaled_moment
    new_hessian[:3, 3] = new_hessian[3, :3] = mixed
    new_hessian[3, 3] += slope * (
        2.0 * np.add.reduce(kappa * hessian[:3, 3]) + slope * np.add.reduce(kappa * by_kappa)
    )
    new_hessian[3, 3] += bend * work
    if energy.strains == 6:
        sheared = hessian[:3, 4:]
        new_hessian[:3, 4:] *= width
        new_hessian[3, 4:] += slope * np.einsum('ibn,ijbn->jbn', kappa, sheared)
        new_hessian[4:, :3] = new_hessian[:3, 4:].swapaxes(0, 1)
        new_hessian[4:, 3] = new_hessian[3, 4:]
    return new_gradient, new_hessian


def unscale_gradient(energy: SectionEnergy, twist: FloatArray, gradient: FloatArray) -> FloatArray:
    """Gradients (n, ..., batch, nodes) by the ``twist`` from those by the scaled strain."""
    if not energy.law.widens:
        return gradient
    width, slope, _ = energy.law.widening(twist[3])
    kappa = twist[:3].reshape(3, *(1,) * (gradient.ndim - 3), *twist.shape[1:])
    unscaled = gradient.copy()
    unscaled[:3] *= width
    unscaled[3] += slope * np.add.reduce(kappa * gradient[:3])
    return unscaled


def check_fibres(energy: SectionEnergy, strain: FloatArray) -> None:
    """Refuse scaled ``strain`` that compresses a fibre to (next to) nothing.

    The elastic laws that widen resist that without end, which no material does.

    Raises:
        SolveError: if it does; the message says where.
    """
    if not energy.law.widens:
        return
    bend = np.sqrt(strain[1] * strain[1] + strain[2] * strain[2])
    shortest = strain[3] - energy.radius * bend
    if not shortest.min(initial=1.0) > SHORTEST_FIBRE:
        number, node = np.unravel_index(np.argmin(shortest), shortest.shape)
        raise SolveError(
            f'tensions compress a fibre of the arm to nothing at s = {energy.s[node]:.4g} m (to '
            f'{shortest[number, node]:.2g} of its length, must be > {SHORTEST_FIBRE})',
            int(number),
        )
