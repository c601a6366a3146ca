"""How tensions along tendons with friction and the cross sections that they pull change together.

The rate c_j at which a tendon turns follows from the tensions T_k of all at the same place, and
these from the angles theta_k by which they have turned since the base, dT_k = sigma_k mu_k T_k
dtheta_k, for sigma_k of -1 or 1 where a tendon slips and 0 where it sticks. So the change of
angles that leaves nothing of left_j = int_0^s c_j ds - theta_j solves

    dtheta_j(s) = left_j(s) + int_0^s sum_k (dc_j / dT_k) sigma_k mu_k T_k dtheta_k ds

(Volterra's equation), by iteration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.sliding.friction import Friction, Sliding, Turning
from octo_arm_model.core.numerics.batched_ldlt import factorise, substitute
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.strain_measures import derivatives_by_twist, lengthening_by_twist

# Relative tolerance of a change of angles, and most iterations for it.
EXACT, MOST_INNER = 1e-2, 20


class Coupling(NamedTuple):
    """Derivatives of cross sections in balance by the local tension of each tendon.

    Attributes:
        by_pull: of the twist [1/(N m) and 1/N], (n, tendons, batch, points).
        rates: of the rate at which each tendon (first axis) turns, by the tension of each (second
            axis) [rad / (N m)], (tendons, tendons, batch, points).
    """

    by_pull: FloatArray
    rates: FloatArray


def couplings(
    energy: SectionEnergy, twist: FloatArray, local_tensions: FloatArray, turning: Turning
) -> Coupling:
    """`Coupling` of cross sections in balance at ``twist`` (n, batch, points).

    Under ``local_tensions`` (tendons, batch, points) [N] of tendons that turn as in ``turning``.
    Approximate: the change of the tendons' directions within the sections is neglected.
    """
    _, hessian = derivatives_by_twist(energy, twist, local_tensions)
    towards = lengthening_by_twist(energy, twist, local_tensions)
    by_pull = -substitute(factorise(hessian), towards)
    # |kappa x e| changes by this times a change of kappa.
    rate = np.where(turning.rate > 0.0, turning.rate, np.inf)
    across = cross(turning.tangents.unit, turning.curvature / rate)
    return Coupling(by_pull, np.einsum('ijbn,ikbn->jkbn', across, by_pull[:3]))


def predicted_angle(
    friction: Friction, known: Sliding, angle: FloatArray, coupling: Coupling, now: Sliding
) -> FloatArray:
    """Angles (tendons, batch, points) [rad] where tendons at ``angle`` are pulled otherwise.

    From a balance in which they were ``known``, whose angle and ``coupling`` these are; ``now``
    they would be at the same angles. To first order, and without what loads make of it.
    """
    rate = np.einsum('jkbn,kbn->jbn', coupling.rates, now.tensions - known.tensions)
    turned = angle + friction.collocation.integrate_from_base(rate)
    return next_angle(friction, angle, turned, coupling, now)


def next_angle(
    friction: Friction, angle: FloatArray, turned: FloatArray, coupling: Coupling, sliding: Sliding
) -> FloatArray:
    """Angles (tendons, batch, points) [rad] after a Newton step from ``angle``, never negative.

    ``sliding`` are the tendons at ``angle``, and ``turned`` the angles by which they turn in the
    balance under those tensions. Where both agree there is no step, however rough ``coupling`` is.
    """
    by_angle = sliding.slip * friction.mu * sliding.tensions
    left = turned - angle
    moved, small = left, EXACT * largest_of(left)
    rates, integrate = coupling.rates, friction.collocation.integrate_from_base
    for _ in range(MOST_INNER):
        rate = np.einsum('jkbn,kbn->jbn', rates, by_angle * moved)
        last, moved = moved, left + integrate(rate)
        if largest_of(moved - last) <= small:
            break
    return np.asarray(np.maximum(angle + moved, 0.0))


def largest_of(values: FloatArray) -> float:
    """The largest absolute one of ``values``, 0 of none; NaN where any is."""
    return float(np.abs(values).max(initial=0.0))


def change_of(friction: Friction, angle: FloatArray, new: FloatArray) -> float:
    """Largest relative change of the tensions as angles change from ``angle`` to ``new``."""
    return largest_of(friction.mu * (new - angle))
