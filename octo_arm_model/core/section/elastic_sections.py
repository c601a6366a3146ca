"""Cross sections without tendons: what they store of elastic energy."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.formulas import bending_factors
from octo_arm_model.core.section.paper_balance import SectionStiffness

# Widening of the sections and its two derivatives by the stretch; numbers where there is none.
Widening: TypeAlias = tuple[Number, Number, Number]


class ElasticSections:
    """The elastic cross sections of an arm at given nodes, independent of each other.

    Arrays of strain are (n, batch, nodes) for n scaled strains, see `energy`.

    Attributes:
        law: the elastic law.
        s: arc coordinate of each node [m].
        strains: how many strains a cross section has: 4, or 6 with shear.
        stiffness: of the undeformed cross sections, (1, nodes) each. The axis of length one, here
            and below, saves NumPy two thirds of the time that broadcasting takes.
        radius: reference radius R [m], (1, nodes).
        squared_radius: R^2 [m^2], (1, nodes).
        twice: 2 E A R^2 [N m^2], (1, nodes).
        fourth: 4 E A R^4 [N m^4], (1, nodes).
        shear_stiffness: G A [N], (1, nodes).
        poisson: Poisson's ratio [-], (1, nodes).
    """

    def __init__(self, arm: Arm, nodes: FloatArray, law: Law, shear: bool) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,)."""
        self.law, self.s = law, nodes
        self.strains = 6 if shear else 4
        stiffness = SectionStiffness.at(arm, nodes)
        self.stiffness = SectionStiffness(*(part[np.newaxis] for part in stiffness))
        self.radius = arm.body.radius(nodes)[np.newaxis]
        self.squared_radius = self.radius**2
        self.twice = 2.0 * self.stiffness.axial * self.squared_radius
        self.fourth = 2.0 * self.squared_radius * self.twice
        self.poisson = arm.material.poisson_ratio_at(nodes)[np.newaxis]
        self.shear_stiffness = arm.material.shear_modulus_at(nodes) * np.pi * self.radius**2

    def widening(self, stretch: FloatArray) -> Widening:
        """Widening and its two derivatives at ``stretch`` (batch, nodes), see `Widening`."""
        return self.law.widening(stretch) if self.law.widens else (1.0, 0.0, 0.0)

    def material(self, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, batch, nodes) and Hessian (n, n, batch, nodes) of the elastic energy."""
        gradient, hessian = np.zeros_like(strain), np.zeros((len(strain), *strain.shape))
        self.add_elastic(strain, gradient, hessian)
        return gradient, hessian

    def add_stress(self, strain: FloatArray, gradient: FloatArray) -> None:
        """Add the gradient of the elastic energy to ``gradient`` (n, batch, nodes)."""
        by_stretch, by_bend = self.law.slopes(strain[3], self._bend(strain[1:3]))
        self._add_stress(strain, by_stretch, self.twice * by_bend, gradient)

    def _bend(self, bending: FloatArray) -> FloatArray:
        """The z = (c R)^2 of elastic laws, from two curvatures (2, batch, nodes)."""
        bend: FloatArray = np.add.reduce(bending * bending) * self.squared_radius
        return bend

    def add_elastic(self, strain: FloatArray, gradient: FloatArray, hessian: FloatArray) -> None:
        """Add gradient and Hessian of the elastic energy to those given."""
        bending = strain[1:3]
        f = self.law.density(strain[3], self._bend(bending))
        once, both, second = bending_factors(
            f.by_bend, f.by_stretch_bend, f.by_bend_bend, self.twice, self.fourth
        )
        self._add_stress(strain, f.by_stretch, once, gradient)
        hessian[0, 0] += self.stiffness.torsion
        hessian[1:3, 1:3] += (second * bending)[:, np.newaxis] * bending
        hessian[1, 1] += once
        hessian[2, 2] += once
        across = both * bending
        hessian[1:3, 3] += across
        hessian[3, 1:3] += across
        hessian[3, 3] += self.stiffness.axial * f.by_stretch_stretch
        if self.strains == 6:
            hessian[4, 4] += self.shear_stiffness
            hessian[5, 5] += self.shear_stiffness

    def _add_stress(
        self, strain: FloatArray, by_stretch: FloatArray, once: FloatArray, gradient: FloatArray
    ) -> None:
        """Add the gradient of the elastic energy; ``once`` as of `bending_factors`."""
        gradient[0] += self.stiffness.torsion * strain[0]
        gradient[1:3] += once * strain[1:3]
        gradient[3] += self.stiffness.axial * by_stretch
        if self.strains == 6:
            gradient[4:] += self.shear_stiffness * strain[4:]
