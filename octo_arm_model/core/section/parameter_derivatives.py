"""Derivatives of section energy gradients and tendon lengths by parameters of the arm."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.formulas import offset_direction, offset_gradient, unit_change


class ParameterDerivatives:
    """Derivatives of a `SectionEnergy` at fixed strain by parameters of the arm.

    These are Poisson's ratio nu, the tendons' distances from the midline and the stiffness of
    their sheaths.

    Attributes:
        outwards: components along n and b of the unit vector from the midline to each tendon, and
            their slopes, each (tendons, 1, nodes), zero beyond the anchorage.
        rest_stretches: length of each tendon of the unloaded arm per length of the midline,
            (tendons, nodes), zero beyond the anchorage.
        torsion_by_poisson: derivative of G I with Poisson's ratio [N m^2], (1, nodes).
    """

    def __init__(self, energy: SectionEnergy, arm: Arm) -> None:
        """Tabulate the directions of increasing offset of the tendons of ``arm``."""
        self._energy = energy
        self.rest_stretches = (energy.active * np.sqrt(1.0 + energy.squared_slope))[:, 0]
        self.torsion_by_poisson = -energy.stiffness.torsion / (1.0 + energy.poisson)
        x, y, dx, dy = (
            np.ascontiguousarray(table[:, np.newaxis]) * energy.active
            for table in (
                *arm.tendon_outwards(energy.s),
                *arm.tendon_outward_slopes(energy.s),
            )
        )
        self.outwards = x, y, dx, dy

    def gradient_by_poisson(self, strain: FloatArray) -> FloatArray:
        """Derivative of the gradient of `material` by Poisson's ratio, (n, batch, nodes)."""
        energy = self._energy
        change = np.zeros_like(strain)
        change[0] = self.torsion_by_poisson * strain[0]
        if energy.strains == 6:
            change[4:] = -energy.shear_stiffness / (1.0 + energy.poisson) * strain[4:]
        return change

    def gradient_by_offset(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Derivative of the tendons' gradient by each tendon's distance from the midline.

        Returns:
            (n, tendons, batch, nodes).
        """
        condensed = self._energy.condensed(strain, local_tensions)
        energy = self._energy if condensed is None else condensed.sections
        width, slope, _ = energy.widening(strain[3])
        u_t, u_n, u_b, length = energy.stretching(strain, width)
        over = 1.0 / length
        unit = u_t * over, u_n * over, u_b * over
        moved = self.direction_by_offset(strain)
        turned = unit_change(*unit, over, *moved)[1:]
        change = np.empty((energy.strains, *length.shape))
        change[:4] = offset_gradient(
            *unit, *turned, slope, energy.x, energy.y, energy.dx, energy.dy, *self.outwards
        )
        if energy.strains == 6:
            change[4:] = turned[1:]
        change *= local_tensions
        if condensed is not None:
            change -= condensed.answer(condensed.by_path(moved))
        return change

    def direction_by_offset(self, strain: FloatArray) -> FloatArray:
        """Derivative of every tendon's u by its own distance from the midline.

        Returns:
            Components along t, n and b, (3, tendons, batch, nodes) [1/m].
        """
        t, n, b, stretch = strain[:4]
        width = self._energy.widening(stretch)[0]
        return np.stack(offset_direction(t, n, b, width, *self.outwards))

    def gradient_by_sheath(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Derivative of the gradient by the stiffness of each tendon's sheath.

        Returns:
            (n, tendons, batch, nodes), zero for a rigid sheath; (n, 0, batch, nodes) where all
            are rigid.
        """
        condensed = self._energy.condensed(strain, local_tensions)
        if condensed is None:
            return np.zeros((len(strain), 0, *strain.shape[1:]))
        return -condensed.answer(condensed.offset)

    def length_by_sheath(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Derivative of every tendon's stretch by its sheath's stiffness, (tendons, nodes)."""
        condensed = self._energy.condensed(strain, local_tensions)
        if condensed is None:
            return np.zeros((0, strain.shape[2]))
        return -condensed.shortening(condensed.offset)[:, 0]

    def length_by_offset(self, strain: FloatArray, local_tensions: FloatArray) -> FloatArray:
        """Derivative of every tendon's stretch by its distance from the midline, for one arm.

        Returns:
            (tendons, nodes).
        """
        condensed = self._energy.condensed(strain, local_tensions)
        energy = self._energy if condensed is None else condensed.sections
        u_t, u_n, u_b, length = energy.stretching(strain, energy.widening(strain[3])[0])
        moved = self.direction_by_offset(strain)
        c_t, c_n, c_b = moved
        change = (u_t * c_t + u_n * c_n + u_b * c_b) / length
        if condensed is not None:
            change -= condensed.shortening(condensed.by_path(moved))
        return np.asarray(change[:, 0])
