"""Conversion between the twist of the frame and the scaled strain of the `energy`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray, Number
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


def _scaled(energy: SectionEnergy, twist: FloatArray, width: Number) -> FloatArray:
    """`to_scaled` where the widening ``width`` is known."""
    if not energy.law.widens:
        return twist
    strain = twist.copy()
    strain[:3] *= width
    return strain


def gradient_by_twist(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray
) -> FloatArray:
    """Gradient (n, batch, nodes) of the energy by the ``twist``, see `derivatives_by_twist`."""
    return _gradient(energy, twist, local_tensions, energy.gradient)


def pull_by_twist(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray
) -> FloatArray:
    """The part of `gradient_by_twist` that comes of the tendons."""
    return _gradient(energy, twist, local_tensions, energy.tendon_gradient)


def _gradient(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray,
    of: Callable[[FloatArray, FloatArray, Number, Number], FloatArray],
) -> FloatArray:  # fmt: skip
    """Gradient by the ``twist`` from what it is ``of`` the scaled strain."""
    width, slope, _ = energy.widening(twist[3])
    gradient = of(_scaled(energy, twist, width), local_tensions, width, slope)
    if energy.law.widens:
        # The formula of `unscale_gradient`, with the widening that is known here.
        gradient[3] += slope * np.add.reduce(twist[:3] * gradient[:3])
        gradient[:3] *= width
    return gradient


def derivatives_by_twist(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gradient (n, batch, nodes) and Hessian (n, n, batch, nodes) of the energy by the ``twist``.

    The energy is that of the cross sections and of their tendons under ``local_tensions``
    (tendons, batch, nodes) [N].
    """
    widening = energy.widening(twist[3])
    strain = _scaled(energy, twist, widening[0])
    gradient, hessian = energy.derivatives(strain, local_tensions, widening)
    if not energy.law.widens:
        return gradient, hessian
    # From those by the scaled strain; the gradient is the moment and the force in the axes of the
    # cross section.
    width, slope, bend = widening
    kappa, by_kappa = twist[:3], gradient[:3]
    # The chain rule, by rows and then by columns.
    for half in (hessian, hessian.swapaxes(0, 1)):
        half[3] += slope * np.add.reduce(kappa[:, np.newaxis] * half[:3])
        half[:3] *= width
    curved = slope * by_kappa
    hessian[:3, 3] += curved
    hessian[3, :3] += curved
    along = np.add.reduce(kappa * by_kappa)
    hessian[3, 3] += bend * along
    gradient[3] += slope * along
    by_kappa *= width
    return gradient, hessian


def unscale_gradient(energy: SectionEnergy, twist: FloatArray, gradient: FloatArray) -> FloatArray:
    """Gradients (n, ..., batch, nodes) by the ``twist`` from those by the scaled strain."""
    if not energy.law.widens:
        return gradient
    width, slope, _ = energy.widening(twist[3])
    kappa = twist[:3].reshape(3, *(1,) * (gradient.ndim - 3), *twist.shape[1:])
    unscaled = gradient.copy()
    unscaled[:3] *= width
    unscaled[3] += slope * np.add.reduce(kappa * gradient[:3])
    return unscaled


def lengthening_by_twist(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray
) -> FloatArray:
    """Gradient of every tendon's stretch by the ``twist``, (n, tendons, batch, nodes).

    ``twist`` is (n, batch, nodes), ``local_tensions`` are (tendons, batch, nodes) [N].
    """
    _, gradient = energy.lengthening(to_scaled(energy.law, twist), local_tensions)
    return unscale_gradient(energy, twist, gradient)


def scaled_change(energy: SectionEnergy, twist: FloatArray, change: FloatArray) -> FloatArray:
    """Change (n, columns, nodes) of the scaled strain, to first order, of one arm.

    By a ``change`` (n, columns, nodes) of its ``twist`` (n, 1, nodes).
    """
    if not energy.law.widens:
        return change
    width, slope, _ = energy.widening(twist[3])
    scaled = change.copy()
    scaled[:3] *= width
    scaled[:3] += slope * twist[:3] * change[3]
    return scaled


def _shortest_fibres(energy: SectionEnergy, strain: FloatArray) -> FloatArray:
    """Stretch of the most compressed fibre of each section, (batch, nodes)."""
    bend = np.sqrt(strain[1] * strain[1] + strain[2] * strain[2])
    return np.asarray(strain[3] - energy.radius * bend)


def have_fibres(energy: SectionEnergy, strain: FloatArray) -> NDArray[np.bool_]:
    """Whether all fibres of an arm are longer than `SHORTEST_FIBRE`, (batch,)."""
    if not energy.law.widens:
        return np.ones(strain.shape[1], bool)
    return np.asarray((_shortest_fibres(energy, strain) > SHORTEST_FIBRE).all(axis=-1))


def check_fibres(energy: SectionEnergy, strain: FloatArray) -> None:
    """Refuse scaled ``strain`` with a fibre shorter than `SHORTEST_FIBRE`.

    Laws with widening have unbounded stress at zero length, unlike any material.

    Raises:
        SolveError: if there is one; the message states the arc coordinate.
    """
    if not energy.law.widens:
        return
    shortest = _shortest_fibres(energy, strain)
    if not shortest.min(initial=1.0) > SHORTEST_FIBRE:
        number, node = np.unravel_index(np.argmin(shortest), shortest.shape)
        raise SolveError(
            f'tensions compress a fibre of the arm to nothing at s = {energy.s[node]:.4g} m (to '
            f'{shortest[number, node]:.2g} of its length, must be > {SHORTEST_FIBRE})',
            int(number),
        )
