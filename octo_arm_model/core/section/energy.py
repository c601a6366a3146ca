"""The energy of a cross section with its tendons, on which the model `exact` is built.

Per reference length a cross section stores

    psi = psi_material + sum T |u|    u = (lambda, v_n, v_b) + kappa x r + r'

with the deformed length |u| of a tendon of tension T. kappa is the rotation of the frame per
reference length, r the offset of the tendon, both in the axes t, n, b; psi_material comes from
`elastic_laws`. Where a section widens by w(lambda), the offsets of its tendons become w r. In
terms of the *scaled* strain

    (w kappa_t, w kappa_n, w kappa_b, lambda[, v_n, v_b])

u is affine except for the small term w r', so that psi is convex in practice, and exactly so for
straight tendons in planes through the midline.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray, IntArray, Number
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.elastic_sections import ElasticSections, Widening
from octo_arm_model.core.section.formulas import tendon_direction
from octo_arm_model.core.section.quasi_newton import Tendons
from octo_arm_model.core.section.tendons.planar_tendons import PlanarTendons
from octo_arm_model.core.section.tendons.tendon_sums import transmission
from octo_arm_model.core.section.tendons.tendon_tables import TendonTables, by_strain

if TYPE_CHECKING:
    from octo_arm_model.core.section.condensed import Condensed

MOST_PULLED = 64  # sets of tendons that pull whose tables are kept


class SectionEnergy(ElasticSections):
    """The energies of the cross sections of an arm at given nodes, independent of each other.

    Arrays of tendons are (tendons, batch, nodes).

    Attributes:
        planar: whether tendons cannot twist an unloaded arm, so that its first strain is zero.
        lever_max: larger of R and the offset of the outermost tendon [m], (1, nodes).
        active: 1 up to the anchorage of a tendon and 0 beyond, (tendons, 1, nodes).
        transmission: local tension of each tendon over that at its base [-], (tendons, 1, nodes).
        x: offset of each tendon along n where it acts, else zero [m], (tendons, 1, nodes).
        y: offset along b, of the same shape.
        dx: slope of ``x`` [-], of the same shape.
        dy: slope of ``y`` [-], of the same shape.
        squared_slope: sum of the squares of both slopes, of the same shape.
    """

    displaces_tendons = False  # so that what they do is not in proportion to their tensions
    # Names of the tables with an axis of tendons.
    _of_tendons: tuple[str, ...] = (
        'active', 'transmission', 'x', 'y', 'dx', 'dy', 'squared_slope'
    )  # fmt: skip

    def __init__(
        self, arm: Arm, nodes: FloatArray, section: IntArray, law: Law, shear: bool = False
    ) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        super().__init__(arm, nodes, law, shear)
        self.active = (arm.tendon_section[:, np.newaxis] <= section).astype(np.float64)[
            :, np.newaxis
        ]
        self.transmission = transmission(arm, nodes, section)[:, np.newaxis]
        # Offsets along n and b and their slopes, zero where the tendon does not act.
        self.x, self.y, self.dx, self.dy = (
            np.ascontiguousarray(table[:, np.newaxis]) * self.active
            for table in (*arm.tendon_offsets(nodes), *arm.tendon_slopes(nodes))
        )
        # Maps curvatures and stretch to u_t; its transpose, forces along t to moments and force.
        self._levers = np.stack([self.y, -self.x, np.ones_like(self.x)])
        lever = np.hypot(self.x, self.y)
        self.lever_max = np.maximum(self.radius, np.max(lever, axis=0, initial=0.0))
        routing_torque = np.abs(self.x * self.dy - self.y * self.dx)
        scale = max(float(np.max(lever)), 1e-300)
        self.planar = not shear and float(routing_torque.max()) <= 1e-14 * scale
        self.squared_slope = self.dx**2 + self.dy**2
        self._pulled: dict[bytes, SectionEnergy] = {}
        self._tabulated: TendonTables | None = None

    def pulled(self, tensions: FloatArray) -> tuple[SectionEnergy, FloatArray]:
        """These cross sections with only the tendons under tension, and their local tensions.

        Tendons whose ``tensions`` (batch, tendons) are zero in all arms are left out; local
        tensions are (tendons under tension, batch, nodes) [N].
        """
        pull = np.logical_or.reduce(tensions)
        key = pull.tobytes()
        some = self._pulled.get(key)
        if some is None:
            some = copy.copy(self)
            for name in self._of_tendons:
                setattr(some, name, getattr(self, name)[pull])
            some._levers, some._tabulated = self._levers[:, pull], None
            if len(self._pulled) >= MOST_PULLED:
                self._pulled.clear()
            self._pulled[key] = some
        return some, some.local_tensions(tensions[:, pull])

    def local_tensions(self, tensions: FloatArray) -> FloatArray:
        """Tension of every tendon at every node [N] for ``tensions`` (batch, tendons)."""
        return tensions.T[:, :, np.newaxis] * self.transmission

    def resultants(self, local_tensions: FloatArray) -> FloatArray:
        """Derivatives (3, batch, nodes) of sum T u_t by the two curvatures and the stretch.

        These are the moments about n and b [N m] and the axial force [N] of ``local_tensions`` T
        parallel to t, with opposite sign.
        """
        total: FloatArray = np.einsum('ij...,j...->i...', self._levers, local_tensions)
        return total

    def along(self, bending: FloatArray) -> FloatArray:
        """Part of u along t, for two curvatures and the stretch (3, batch, nodes)."""
        u_t: FloatArray = np.einsum('ij...,i...->j...', self._levers, bending)
        return u_t

    def softening(self, local_tensions: FloatArray) -> Number:
        """Estimated loss of bending stiffness by sheaths, over 2 E A R^2, (batch, nodes)."""
        return 0.0

    def most_softened(self, tensions: FloatArray) -> float:
        """Estimate of the largest part of E J that sheaths take under ``tensions`` (tendons,)."""
        return 0.0

    def tendons(self, local_tensions: FloatArray) -> Tendons | None:
        """The tendons as `quasi_newton` needs them; None where that method does not apply."""
        return PlanarTendons(self, local_tensions) if self.planar else None

    def stretching(
        self, strain: FloatArray, width: Number
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Components of u along t, n and b, and the stretch |u| of every tendon."""
        t, n, b, stretch = strain[:4]
        u_t, u_n, u_b, length = tendon_direction(
            t, n, b, stretch, width, self.x, self.y, self.dx, self.dy
        )
        if self.strains == 6:
            u_n, u_b = u_n + strain[4], u_b + strain[5]
            length = np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
        return u_t, u_n, u_b, length

    def stretches(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Stretch |u| of every tendon, (tendons, batch, nodes)."""
        return self.stretching(strain, self.widening(strain[3])[0])[3]

    def lengthening(
        self, strain: FloatArray, local_tensions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Stretch |u| of every tendon and its gradient, (n, tendons, batch, nodes)."""
        width, slope, _ = self.widening(strain[3])
        tables = self._tables()
        u, length = tables.directions(strain, width)
        gradient = np.einsum('cmj...,cj...->mj...', tables.by, u / length)
        return length, by_strain(gradient, slope) * self.active

    def condensed(self, strain: FloatArray, local_tensions: FloatArray) -> Condensed | None:
        """Offsets of tendons in compliant sheaths; None where tendons stay on their paths."""
        return None

    def placed(self, strain: FloatArray, local_tensions: FloatArray) -> SectionEnergy:
        """These cross sections with the tendons at their offsets under ``strain``."""
        return self

    def length_by_tension(self, strain: FloatArray, local_tensions: FloatArray) -> Number:
        """Derivative of the stretches by the local tension at fixed strain [1/N]."""
        return 0.0

    def check_tendons(self, strain: FloatArray, local_tensions: FloatArray) -> None:
        """Refuse tendons pressed out of the body; see `sheath`, here they stay on their paths."""

    def check_stable(self, strain: FloatArray, local_tensions: FloatArray) -> None:
        """Refuse an unloaded equilibrium that is no minimum of the energy; here every one is."""

    def _tables(self) -> TendonTables:
        """Tables of the tendons at their present offsets."""
        if self._tabulated is None:
            self._tabulated = TendonTables(self.x, self.y, self.dx, self.dy, self.strains)
        return self._tabulated

    def gradient(
        self, strain: FloatArray, local_tensions: FloatArray, width: Number, slope: Number
    ) -> FloatArray:
        """Gradient (n, batch, nodes) of the whole energy, for a `widening` and its derivative."""
        gradient = self.tendon_gradient(strain, local_tensions, width, slope)
        self.add_stress(strain, gradient)
        return gradient

    def tendon_gradient(
        self, strain: FloatArray, local_tensions: FloatArray, width: Number, slope: Number
    ) -> FloatArray:
        """Gradient (n, batch, nodes) of sum T |u|, with arguments of `gradient`."""
        tables = self._tables()
        u, length = tables.directions(strain, width)
        pull = (local_tensions / length) * u
        return by_strain(np.einsum('cmj...,cj...->m...', tables.by, pull), slope)

    def tendon_derivatives(
        self, strain: FloatArray, local_tensions: FloatArray, widening: Widening
    ) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, batch, nodes) and Hessian (n, n, batch, nodes) of sum T |u|."""
        width, slope, bend = widening
        tables = self._tables()
        u, length = tables.directions(strain, width)
        weight = local_tensions / length
        along = np.einsum('cmj...,cj...->mj...', tables.by, u / length)
        gradient = np.einsum('j...,mj...->m...', local_tensions, along)
        hessian = np.einsum('mkj...,j...->mk...', tables.products, weight)
        hessian -= np.einsum('mj...,kj...->mk...', weight * along, along)
        for half in (hessian, hessian.swapaxes(0, 1)):
            by_strain(half, slope)
        hessian[3, 3] += bend * gradient[-1]
        return by_strain(gradient, slope), hessian[:-1, :-1]

    def derivatives(
        self, strain: FloatArray, local_tensions: FloatArray, widening: Widening
    ) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, batch, nodes) and Hessian (n, n, batch, nodes) of the whole energy.

        Both are NaN where a fibre has no positive length, see `Density`.
        """
        gradient, hessian = self.tendon_derivatives(strain, local_tensions, widening)
        self.add_elastic(strain, gradient, hessian)
        return gradient, hessian
