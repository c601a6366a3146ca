"""Derivatives of the energy by the twist of the frame instead of the scaled strain."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.energy import SectionEnergy


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
