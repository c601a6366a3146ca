"""Balance of an arm that tendons with friction alone load.

The unknowns are the angles theta_j that the tendons turn by since the base. The rate c_j of each
follows from the tensions T_k of all at the same place, and these from the angles, dT_k = sigma_k
mu_k T_k dtheta_k, for sigma_k of -1 or 1 where a tendon slips and 0 where it sticks. So the change
of angles that leaves nothing of left_j = int_0^s c_j ds - theta_j solves

    dtheta_j(s) = left_j(s) + int_0^s sum_k (dc_j / dT_k) sigma_k mu_k T_k dtheta_k ds

(Volterra's equation), and Newton's method takes few steps.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.friction import Friction, Sliding, Turning
from octo_arm_model.core.numerics.batched_ldlt import factorise, substitute
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import initial_strain, minimise
from octo_arm_model.core.section.strain_measures import (
    check_fibres,
    derivatives_by_twist,
    to_scaled,
    to_twist,
    unscale_gradient,
)

TOLERANCE = 1e-9  # of the angles by which tendons turn [rad]
MOST = 100  # steps
# A change of the angles is found to this part of it, in so many iterations at most.
EXACT, MOST_INNER = 1e-2, 20


class Sections(Protocol):
    """Twist of cross sections under given tensions along the tendons.

    Attributes:
        residual: what is left of their equations after the last call, relative, (batch,).
    """

    residual: FloatArray

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """Twist (n, batch, points) under ``local_tensions`` (tendons, batch, points) [N].

        Raises:
            SolveError: if there is no balance.
        """


def balance(
    friction: Friction,
    sections: Sections,
    tensions: FloatArray,
    before: FloatArray | None,
) -> tuple[FloatArray, Sliding, int]:
    """Twist (n, batch, points), the tendons along it, and the steps that took.

    ``tensions`` (batch, tendons) [N] are those at the base, ``before`` is as in `Friction.slide`.
    How far a tendon has turned at a place depends on the arm up to there alone, so that the
    iteration converges (it is one of Volterra's equations).

    Raises:
        ConvergenceError: if it does not.
    """
    angle = np.zeros((friction.coefficient.size, len(tensions), friction.points))
    left = 0.0
    for iteration in range(1, MOST + 1):
        local_tensions, slip = friction.tensions(tensions, before, angle)
        twist = sections(local_tensions)
        turning = friction.turning(twist, local_tensions)
        if iteration == 1:
            # Exact for a curvature in proportion to the tension of a tendon that is drawn in.
            angle = np.log1p(friction.mu * turning.angle) / friction.mu
            continue
        if iteration == 2:
            # From here on it hardly changes.
            coupling = couplings(friction.energy, twist, local_tensions, turning)
        by_angle = slip * friction.mu * local_tensions
        new = next_angle(friction, angle, turning.angle, coupling, by_angle)
        last, left = left, float(np.abs(new - angle).max(initial=0.0))
        angle = new
        if has_converged(left, last):
            local_tensions, slip = friction.tensions(tensions, before, angle)
            return sections(local_tensions), Sliding(local_tensions, slip, turning), iteration
    raise ConvergenceError('the tension along the tendons', left, MOST)


def couplings(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray, turning: Turning
) -> FloatArray:
    """Derivatives of the rates that tendons turn by with each tension at the same place.

    Of cross sections in balance, ``twist`` (n, batch, points), in which the directions of tendons
    hardly change; (tendons, tendons, batch, points) [rad / (N m)].
    """
    strain = to_scaled(energy.law, twist)
    towards = energy.lengthening(strain, local_tensions)[1]
    _, hessian = derivatives_by_twist(energy, twist, local_tensions)
    bends = substitute(factorise(hessian), unscale_gradient(energy, twist, towards))[:3]
    # |kappa x e| changes by this times a change of kappa.
    rate = np.where(turning.rate > 0.0, turning.rate, np.inf)
    across = cross(turning.tangents.unit, turning.curvature / rate)
    return -np.asarray(np.einsum('ijbn,ikbn->jkbn', across, bends))


def next_angle(
    friction: Friction, angle: FloatArray, turned: FloatArray, coupling: FloatArray,
    by_angle: FloatArray,
) -> FloatArray:  # fmt: skip
    """Nearer angles than ``angle``, at whose tensions tendons have ``turned`` otherwise.

    ``coupling`` is that of `couplings`, and ``by_angle`` the derivative of each tension by the
    angle, (tendons, batch, points) [N/rad]. Angles that stay are right whatever these are.
    """
    left = turned - angle
    moved, small = left, EXACT * np.abs(left).max(initial=0.0)
    for _ in range(MOST_INNER):
        rate = np.einsum('jkbn,kbn->jbn', coupling, by_angle * moved)
        last, moved = moved, left + friction.collocation.integrate_from_base(rate)
        if np.abs(moved - last).max(initial=0.0) <= small:
            break
    return np.asarray(np.maximum(angle + moved, 0.0))


def has_converged(left: float, last: float) -> bool:
    """Whether a next step would leave nothing, which makes this part of the one before, or less.

    False for NaN.
    """
    return left <= TOLERANCE or (left * left <= TOLERANCE * last and left < last)


class ExactSections:
    """`Sections` of least energy, found from those of the call before."""

    def __init__(self, energy: SectionEnergy) -> None:
        """Begin without a call before."""
        self._energy = energy
        self._strain: FloatArray | None = None
        self.residual: FloatArray = np.zeros(0)

    def __call__(self, local_tensions: FloatArray) -> FloatArray:
        """See `Sections`."""
        start = self._strain
        if start is None:
            start = initial_strain(self._energy, local_tensions)
        found = minimise(self._energy, local_tensions, start)
        check_fibres(self._energy, found.strain)
        self._strain, self.residual = found.strain, found.residual
        return to_twist(self._energy.law, found.strain)
