"""The energy of a cross section with its tendons: the model beyond the paper.

Per reference length a cross section stores

    psi = psi_material + sum T |u|    u = (lambda, v_n, v_b) + kappa x r + r'

as a frictionless tendon of tension T is stretched by |u|. kappa is the rotation of the frame per
reference length, r the offset of the tendon, both in the axes t, n, b; psi_material comes from
`elastic_laws`. A section that widens by w(lambda) carries its tendons along, so that their offset
is w r. In terms of the *scaled* strain

    (w kappa_t, w kappa_n, w kappa_b, lambda[, v_n, v_b])

u is affine but for the small w r', so that psi is convex for all practical purposes, for straight
tendons in planes through the midline exactly.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.paper_balance import SectionStiffness
from octo_arm_model.core.section.tendon_sums import transmission


class SectionEnergy:
    """The cross sections of an arm at given nodes, each by itself.

    Arrays of strain are (n, batch, nodes) for n strains, those of tendons (tendons, batch, nodes).

    Attributes:
        law: the elastic law.
        s: arc coordinate of each node [m].
        strains: how many strains a cross section has: 4, or 6 with shear.
        planar: whether tendons cannot twist an unloaded arm, so that its first strain is zero.
        stiffness: of the undeformed cross sections.
        radius: reference radius at each node [m].
        lever_max: that, or the distance of the outermost tendon from the midline if it is larger
            [m].
        active: 1 where a tendon passes and 0 beyond its anchorage, (tendons, 1, nodes).
        transmission: part of its tension that each tendon has there, likewise.
        x: offset of each tendon along n where it passes, else zero [m], likewise.
        y: along b.
        dx: slope of ``x`` [-].
        dy: slope of ``y`` [-].
        shear_stiffness: G A [N], (nodes,).
        poisson: Poisson's ratio [-], (nodes,).
    """

    def __init__(
        self, arm: Arm, nodes: FloatArray, section: IntArray, law: Law, shear: bool = False
    ) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        self.law, self.s = law, nodes
        self.strains = 6 if shear else 4
        self.stiffness = SectionStiffness.at(arm, nodes)
        self.radius = arm.body.radius(nodes)
        self.active = (arm.tendon_section[:, np.newaxis] <= section).astype(np.float64)[
            :, np.newaxis
        ]
        self.transmission = transmission(arm, nodes, section)[:, np.newaxis]
        self.poisson = arm.material.poisson_ratio_at(nodes)
        self.shear_stiffness = arm.material.shear_modulus_at(nodes) * np.pi * self.radius**2
        # Offsets along n and b and their slopes, zero where the tendon does not act.
        self.x, self.y, self.dx, self.dy = (
            np.ascontiguousarray(table[:, np.newaxis]) * self.active
            for table in (*arm.tendon_offsets(nodes), *arm.tendon_slopes(nodes))
        )
        # From curvatures and stretch to the part of u along t, and back to moments and force.
        self._levers = np.stack([self.y, -self.x, np.ones_like(self.x)])
        lever = np.hypot(self.x, self.y)
        self.lever_max = np.maximum(self.radius, np.max(lever, axis=(0, 1), initial=0.0))
        routing_torque = np.abs(self.x * self.dy - self.y * self.dx)
        scale = max(float(np.max(lever)), 1e-300)
        self.planar = not shear and float(routing_torque.max()) <= 1e-14 * scale
        self._slope_squared = self.dx**2 + self.dy**2
        self._twice = 2.0 * self.stiffness.axial * self.radius**2
        self._squared = self.radius**2
        self._four = 2.0 * self._squared * self._twice

    def local_tensions(self, tensions: FloatArray) -> FloatArray:
        """Tension of every tendon at every node [N] for ``tensions`` (batch, tendons)."""
        return tensions.T[:, :, np.newaxis] * self.transmission

    def resultants(self, local_tensions: FloatArray) -> FloatArray:
        """Moments about n and b and axial force (3, batch, nodes) of ``local_tensions``.

        As a gradient, by the two curvatures and the stretch, with their signs.
        """
        total: FloatArray = np.einsum('ij...,j...->i...', self._levers, local_tensions)
        return total

    def _along(self, bending: FloatArray) -> FloatArray:
        """Part of u along t, for two curvatures and the stretch (3, batch, nodes)."""
        u_t: FloatArray = np.einsum('ij...,i...->j...', self._levers, bending)
        return u_t

    def tendon_gradient(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Gradient (n, batch, nodes) of the tendons' energy sum T |u|."""
        flat = len(strain) == 3
        bending = slice(None) if flat else slice(1, 4)
        slope = None
        if self.law.widens:
            width, slope, _ = self.law.widening(strain[-1] if flat else strain[3])
            strain = strain / width  # u points where u / w does, in which r' does not widen
        u_t = self._along(strain[bending])
        square = u_t * u_t
        if flat:
            square += self._slope_squared
        else:
            u_n, u_b = self._across(strain, None)
            square += u_n * u_n
            square += u_b * u_b
        np.sqrt(square, out=square)
        pull = np.divide(local_tensions, square, out=square)
        u_t *= pull
        gradient = np.empty_like(strain)
        gradient[bending] = self.resultants(u_t)
        if flat:
            if slope is not None:
                gradient[2] += slope * np.einsum('j...,j...->...', pull, self._slope_squared)
            return gradient
        u_n *= pull
        u_b *= pull
        gradient[0] = np.add.reduce(self.x * u_b - self.y * u_n)
        if slope is not None:
            gradient[3] += slope * np.add.reduce(self.dx * u_n + self.dy * u_b)
        if len(strain) == 6:
            np.add.reduce(u_n, out=gradient[4])
            np.add.reduce(u_b, out=gradient[5])
        return gradient

    def _across(
        self, strain: FloatArray, width: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Components of u along n and b."""
        torsion = strain[0]
        dx, dy = (self.dx, self.dy) if width is None else (width * self.dx, width * self.dy)
        u_n, u_b = dx - torsion * self.y, dy + torsion * self.x
        if self.strains == 6:
            u_n += strain[4]
            u_b += strain[5]
        return u_n, u_b

    def stretching(
        self, strain: FloatArray, width: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Components of u along t, n and b, and the stretch |u| of every tendon."""
        u_t = self._along(strain[1:4])
        u_n, u_b = self._across(strain, width)
        length = u_t * u_t
        length += u_n * u_n
        length += u_b * u_b
        return u_t, u_n, u_b, np.sqrt(length, out=length)

    def stretches(self, strain: FloatArray) -> FloatArray:
        """Stretch |u| of every tendon, (tendons, batch, nodes)."""
        width = self.law.widening(strain[3])[0] if self.law.widens else None
        return self.stretching(strain, width)[3]

    def lengthening(self, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stretch |u| of every tendon and its gradient, (n, tendons, batch, nodes)."""
        width, slope = self.law.widening(strain[3])[:2] if self.law.widens else (None, None)
        u_t, u_n, u_b, length = self.stretching(strain, width)
        u_t, u_n, u_b = u_t / length, u_n / length, u_b / length
        gradient = np.empty((self.strains, *length.shape))
        gradient[0] = self.x * u_b - self.y * u_n
        gradient[1] = self.y * u_t
        gradient[2] = -self.x * u_t
        gradient[3] = u_t
        if slope is not None:
            gradient[3] += slope * (self.dx * u_n + self.dy * u_b)
        if self.strains == 6:
            gradient[4], gradient[5] = u_n, u_b
        return length, gradient * self.active

    def tendon_derivatives(
        self, strain: FloatArray, local_tensions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, batch, nodes) and Hessian (n, n, batch, nodes) of sum T |u|."""
        length, towards = self.lengthening(strain)
        gradient = np.einsum('jbn,ijbn->ibn', local_tensions, towards)
        weight = local_tensions / length
        x, y, dx, dy = self.x, self.y, self.dx, self.dy
        count = self.strains
        hessian = np.empty((count, *strain.shape))
        # What of each change of u is across u: all of it less what is along.
        np.einsum('ijbn,kjbn->ikbn', -weight * towards, towards, out=hessian)
        weight_x, weight_y = weight * x, weight * y
        moment_x, moment_y = np.add.reduce(weight_x), np.add.reduce(weight_y)
        xx, yy = np.add.reduce(weight_x * x), np.add.reduce(weight_y * y)
        total = np.add.reduce(weight)
        hessian[0, 0] += xx + yy
        hessian[1, 1] += yy
        hessian[2, 1] -= np.add.reduce(weight_x * y)
        hessian[2, 2] += xx
        hessian[3, 1] += moment_y
        hessian[3, 2] -= moment_x
        hessian[3, 3] += total
        if self.law.widens:
            width, slope, bend = self.law.widening(strain[3])
            routing_torque = np.add.reduce(weight_x * dy - weight_y * dx)
            hessian[3, 0] += slope * routing_torque
            # w' applies to u itself, w'' to what of r' is along u.
            u_n, u_b = self._across(strain, width)
            straight = np.add.reduce(weight * (dx * u_n + dy * u_b))
            squares = np.add.reduce(weight * self._slope_squared)
            hessian[3, 3] += slope * slope * squares + bend * straight
            if count == 6:
                hessian[4, 3] += slope * np.add.reduce(weight * dx)
                hessian[5, 3] += slope * np.add.reduce(weight * dy)
        if count == 6:
            hessian[4, 0] -= moment_y
            hessian[5, 0] += moment_x
            hessian[4, 4] += total
            hessian[5, 5] += total
        for i in range(count):
            for j in range(i):
                hessian[j, i] = hessian[i, j]
        return gradient, hessian

    def material(self, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, batch, nodes) of the elastic energy and its Hessian (n, n, batch, nodes).

        Both are NaN where a section cannot be.
        """
        first = 0 if len(strain) == 3 else 1
        curving, stretch = strain[first : first + 2], strain[first + 2]
        squares = curving * curving
        bend = np.add(squares[0], squares[1], out=squares[0])
        bend *= self._squared
        f = self.law.density(stretch, bend)
        gradient = np.empty_like(strain)
        hessian = np.empty((len(strain), *strain.shape))
        if first:
            hessian[...] = 0.0
            torsional = self.stiffness.torsion
            hessian[0, 0] = torsional
            np.multiply(torsional, strain[0], out=gradient[0])
        axial = self.stiffness.axial
        once = self._twice * f.by_bend
        np.multiply(once, curving, out=gradient[first : first + 2])
        np.multiply(axial, f.by_stretch, out=gradient[first + 2])
        core = hessian[first : first + 3, first : first + 3]
        second = (self._four * f.by_bend_bend) * curving
        np.multiply(second[:, np.newaxis], curving, out=core[:2, :2])
        core[0, 0] += once
        core[1, 1] += once
        np.multiply(self._twice * f.by_stretch_bend, curving, out=core[2, :2])
        core[:2, 2] = core[2, :2]
        np.multiply(axial, f.by_stretch_stretch, out=core[2, 2])
        if len(strain) == 6:
            gradient[4:] = self.shear_stiffness * strain[4:]
            hessian[4, 4] = hessian[5, 5] = self.shear_stiffness
        return gradient, hessian
