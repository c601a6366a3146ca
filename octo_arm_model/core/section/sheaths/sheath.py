"""Tendons in compliant sheaths, whose offsets are condensed out of every cross section.

A tendon under tension presses towards the inside of the bend. It is displaced from its path by
d = (d_n, d_b) in the undeformed cross section, which stores the energy k |d|^2 / 2 per reference
length in the rubber around it, and psi of `energy` becomes

    min over d of  psi_material + sum T |u(r + d)| + k |d|^2 / 2 .

A section that widens by w carries tendon and rubber along, to w (r + d). k is a constant: an
energy of k |w d|^2 / 2 per deformed length is k |d|^2 / 2 per reference length, since lambda w^2 =
1 at constant volume. It is convex in d, two unknowns per tendon, as u is linear in d. With C the
mixed second derivatives by strain and d, and D those by d, gradient and Hessian by the strain are

    dpsi/de at d    and    d2psi/de2 - C D^-1 C^T .

u includes the slope r' of the path but not d'. A tendon is fixed at the base and at its anchorage,
from where d rises over a length of about (T / k)^1/2, as in a string on an elastic foundation.
This end effect and the variation of d in between are neglected; the page of effects in the manual
quantifies them.
"""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray, IntArray, Number
from octo_arm_model.core.numerics.batched_ldlt import factorise
from octo_arm_model.core.section.condensed import Condensed, Parts
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.energy import SectionEnergy, Widening
from octo_arm_model.core.section.formulas import (
    sheath_inverse,
    sheath_mixed,
    sheath_pull,
    tendon_gradient,
)
from octo_arm_model.core.section.quasi_newton import Tendons
from octo_arm_model.core.section.sheaths.sheathed_tendons import SheathedTendons

# Bound of `softening` in initial strains; the bending stiffness E J is 1/8 of 2 E A R^2.
MOST_SOFTENED = 0.1
_MOST_STEPS = 30  # of Newton's method for the offsets of tendons
_TOLERANCE = 1e-14  # of their residual, over the lever arm
# Sections are stable if the squared sine of the angle between tendons and midline and the relative
# loss of bending stiffness by sheaths are at most these: the neglected terms are of that order.
_SURELY_ALONG, _SURELY_STIFF = 0.1, 0.25


def sections_of(
    arm: Arm, nodes: FloatArray, section: IntArray, law: Law, shear: bool = False
) -> SectionEnergy:
    """The cross sections of ``arm`` at ``nodes`` (n,), with sheaths where it has any."""
    kind = SheathedSections if arm.sheath_stiffness else SectionEnergy
    return kind(arm, nodes, section, law, shear)


class _Placed(NamedTuple):
    """Tendons at their equilibrium offsets, as far as `Condensed` needs them.

    Attributes:
        sections: see `Condensed`.
        offset: see `Condensed`.
        unit: see `Condensed`.
        over: 1 / |u|, (tendons, batch, nodes).
        pull: see `Condensed`.
    """

    sections: SectionEnergy
    offset: FloatArray
    unit: Parts
    over: FloatArray
    pull: tuple[FloatArray, FloatArray]


class SheathedSections(SectionEnergy):
    """Cross sections whose tendons are displaced from their paths.

    Attributes:
        sheath_compliance: 1 / k of each tendon [1/Pa], zero in a rigid sheath and beyond its
            anchorage, (tendons, 1, nodes).
        farthest: largest admissible distance of each tendon from the midline [m], (tendons, 1,
            nodes).
    """

    displaces_tendons = True
    _of_tendons = (*SectionEnergy._of_tendons, 'sheath_compliance', 'farthest', '_safe_force')

    def __init__(
        self, arm: Arm, nodes: FloatArray, section: IntArray, law: Law, shear: bool = False
    ) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        super().__init__(arm, nodes, section, law, shear)
        stiffness = np.array(arm.sheath_stiffness)
        compliance = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)
        self.sheath_compliance = compliance[:, np.newaxis, np.newaxis] * self.active
        off_midline = np.hypot(self.x, self.y)
        self.farthest = np.maximum(self.radius, off_midline)
        # Lateral force [N/m] up to which a tendon cannot be displaced beyond that.
        clearance, is_compliant = self.farthest - off_midline, self.sheath_compliance > 0.0
        self._safe_force = np.full_like(clearance, np.inf)
        np.divide(clearance, self.sheath_compliance, out=self._safe_force, where=is_compliant)
        per_square = self.sheath_compliance * self.transmission**2 / self.stiffness.bending
        self._softest = per_square.max(axis=(1, 2))
        # A displaced tendon whose path has a slope has a moment about t.
        self._in_planes, self.planar = self.planar, False

    def condensed(self, strain: FloatArray, local_tensions: FloatArray) -> Condensed:
        """Offsets of the tendons under scaled ``strain``, and their derivatives.

        Raises:
            ConvergenceError: if Newton's method for the offsets does not converge.
        """
        t, n, b = strain[:3]
        slope = self.widening(strain[3])[1]
        moved, offset, unit, over, pull = self._placed(strain, local_tensions)
        yielding = self.sheath_compliance * local_tensions
        inverse = sheath_inverse(t, n, b, *pull, yielding * over)
        g = tendon_gradient(*unit, slope, moved.x, moved.y, self.dx, self.dy)
        weight = local_tensions * over
        mixed = np.empty((2, len(strain), *weight.shape))
        terms = sheath_mixed(
            t, n, b, slope, moved.x, moved.y, self.dx, self.dy, *unit, *pull, *g, local_tensions,
            weight,
        )  # fmt: skip
        for place, term in enumerate(terms):
            mixed[divmod(place, 4)] = term
        if len(strain) == 6:
            (_, e_n, e_b), (p_n, p_b) = unit, pull
            mixed[0, 4], mixed[0, 5] = -weight * p_n * e_n, weight * (t - p_n * e_b)
            mixed[1, 4], mixed[1, 5] = -weight * (t + p_b * e_n), -weight * p_b * e_b
        compliance = self.sheath_compliance * np.stack(inverse)
        return Condensed(moved, offset, np.stack(pull), compliance, mixed, strain, weight, unit)

    def placed(self, strain: FloatArray, local_tensions: FloatArray) -> SectionEnergy:
        """These cross sections with the tendons at their offsets under ``strain``.

        Raises:
            ConvergenceError: as `condensed`.
        """
        return self._placed(strain, local_tensions).sections

    def _placed(self, strain: FloatArray, local_tensions: FloatArray) -> _Placed:
        """Find the offsets of the tendons by Newton's method.

        Raises:
            ConvergenceError: if it does not converge.
        """
        t, n, b, stretch = strain[:4]
        yielding = self.sheath_compliance * local_tensions
        # Start: for tendons parallel to the midline, where that shortens them little; else zero.
        near = yielding * np.where(yielding * (n * n + b * b) < 0.25 * stretch, 1.0, 0.0)
        offset = np.stack([near * b, -near * n])
        moved = copy.copy(self)
        width, worst, is_last = self.widening(stretch)[0], np.inf, False
        for _ in range(_MOST_STEPS):
            moved.x, moved.y = self.x + offset[0], self.y + offset[1]
            u_t, u_n, u_b, length = SectionEnergy.stretching(moved, strain, width)
            over = 1.0 / length
            unit = u_t * over, u_n * over, u_b * over
            pull = sheath_pull(t, n, b, *unit)
            if is_last:
                break
            residual_n, residual_b = offset[0] + yielding * pull[0], offset[1] + yielding * pull[1]
            worst = float(
                ((np.abs(residual_n) + np.abs(residual_b)) / self.lever_max).max(initial=0.0)
            )
            if not worst > _TOLERANCE:  # also for NaN of an impossible strain
                break
            nn, nb, bb = sheath_inverse(t, n, b, *pull, yielding * over)
            offset[0] -= nn * residual_n + nb * residual_b
            offset[1] -= nb * residual_n + bb * residual_b
            # A step leaves no more than the square of what was left before.
            is_last = worst * worst <= _TOLERANCE
        else:
            raise ConvergenceError('the offsets of tendons in their sheaths', worst, _MOST_STEPS)
        return _Placed(moved, offset, unit, over, pull)

    def softening(self, local_tensions: FloatArray) -> FloatArray:
        """Estimated loss of bending stiffness by sheaths, over 2 E A R^2, (batch, nodes).

        As if tendons were parallel to the midline, and at most `MOST_SOFTENED`.
        """
        return np.minimum(self._softening(local_tensions), MOST_SOFTENED)

    def most_softened(self, tensions: FloatArray) -> float:
        """See `SectionEnergy`."""
        return float(self._softest @ (tensions * tensions))

    def _softening(self, local_tensions: FloatArray) -> FloatArray:
        taken: FloatArray = np.einsum(
            'jbn,jbn,jbn->bn', self.sheath_compliance, local_tensions, local_tensions
        )
        return taken / (2.0 * self.stiffness.axial * self.squared_radius)

    def tendons(self, local_tensions: FloatArray) -> Tendons | None:
        """The tendons as `quasi_newton` needs them; None where paths leave their planes."""
        return SheathedTendons(self, local_tensions) if self._in_planes else None

    def tendon_gradient(
        self, strain: FloatArray, local_tensions: FloatArray, width: Number, slope: Number
    ) -> FloatArray:
        """Gradient (n, batch, nodes) of the energy of tendons and sheaths, minimal over d."""
        moved = self.placed(strain, local_tensions)
        return SectionEnergy.tendon_gradient(moved, strain, local_tensions, width, slope)

    def tendon_derivatives(
        self, strain: FloatArray, local_tensions: FloatArray, widening: Widening
    ) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, batch, nodes) and condensed Hessian (n, n, batch, nodes) by the strain.

        Of the energy of tendons and sheaths, minimal over d.
        """
        found = self.condensed(strain, local_tensions)
        gradient, hessian = SectionEnergy.tendon_derivatives(
            found.sections, strain, local_tensions, widening
        )
        hessian -= np.einsum('aijbn,akjbn->ikbn', found.mixed, found.moved(found.mixed))
        return gradient, hessian

    def stretches(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Stretch |u| of every tendon at its offset, (tendons, batch, nodes)."""
        moved = self.placed(strain, local_tensions)
        return SectionEnergy.stretches(moved, strain, local_tensions)

    def lengthening(
        self, strain: FloatArray, local_tensions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Stretch |u| of every tendon and its gradient, (n, tendons, batch, nodes)."""
        found = self.condensed(strain, local_tensions)
        length, gradient = SectionEnergy.lengthening(found.sections, strain, local_tensions)
        return length, gradient - found.answer(found.pull)

    def length_by_tension(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Derivative of the stretches by the local tension at fixed strain [1/N]."""
        found = self.condensed(strain, local_tensions)
        return -found.shortening(found.pull)

    def check_tendons(self, strain: FloatArray, local_tensions: FloatArray) -> None:
        """Refuse tendons that are pressed out of the body.

        Raises:
            SolveError: if one is; the message states the arc coordinate.
        """
        # Derivatives of |u| by the offset are no larger than the curvature.
        curvature = np.sqrt(np.add.reduce(strain[:3] ** 2))
        if not (local_tensions * curvature > self._safe_force).any():
            return
        moved = self.placed(strain, local_tensions)
        outside = np.any(np.hypot(moved.x, moved.y) > self.farthest, axis=0)
        self._refuse(outside, 'press a tendon out of the body', 'its sheath is')

    def check_stable(self, strain: FloatArray, local_tensions: FloatArray) -> None:
        """Refuse an unloaded equilibrium that is no minimum of the energy.

        Raises:
            SolveError: if a section is unstable; the message states its arc coordinate.
        """
        if self._is_surely_stable(strain, local_tensions):
            return
        _, hessian = self.derivatives(strain, local_tensions, self.widening(strain[3]))
        factors = factorise(hessian)
        unstable = np.zeros(strain.shape[1:], dtype=bool)
        for row in range(len(strain)):
            unstable |= ~(factors[row, row] > 0.0)
        self._refuse(unstable, 'bend the arm without end', 'sheaths are')

    def _is_surely_stable(self, strain: FloatArray, local_tensions: FloatArray) -> bool:
        """Whether sheaths cannot make a section unstable, estimated without a Hessian.

        The entries of C are at most T but for terms of the order of the sine of the angle between
        tendon and midline, and G I is at least 2/3 of E J.
        """
        z = (strain[1] * strain[1] + strain[2] * strain[2]) * self.squared_radius
        f = self.law.density(strain[3], z)
        # In the plane in which the section bends, and across it; all over 2 E A R^2.
        along = f.by_bend + 2.0 * z * (
            f.by_bend_bend - f.by_stretch_bend * f.by_stretch_bend / f.by_stretch_stretch
        )
        taken = self._softening(local_tensions)
        _, u_n, u_b, length = self.stretching(strain, self.widening(strain[3])[0])
        return not (
            np.any(taken > _SURELY_STIFF * np.minimum(f.by_bend, along))
            or np.any(u_n * u_n + u_b * u_b > _SURELY_ALONG * length * length)
        )

    def _refuse(self, where: NDArray[np.bool_], effect: str, soft: str) -> None:
        """Raise a `SolveError` at the first of the places ``where`` (batch, nodes), if any."""
        if where.any():
            number, node = np.argwhere(where)[0]
            at = f's = {self.s[node]:.4g} m'
            raise SolveError(f'tensions {effect} at {at}: {soft} too soft', int(number))
