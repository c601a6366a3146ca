"""Unbalanced wrenches at the cross sections by changes of parameters, at fixed twist."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.parameter_derivatives import ParameterDerivatives
from octo_arm_model.core.section.strain_measures import (
    lengthening_by_twist,
    to_scaled,
    unscale_gradient,
)


class Imbalance:
    """Unbalanced wrenches on the cross sections per unit of each quantity, at fixed twist.

    In the axes of the cross section, (n, quantities, points) [N m and N].

    Attributes:
        strain: scaled strain, (n, 1, points).
    """

    def __init__(
        self,
        energy: SectionEnergy,
        parameters: ParameterDerivatives,
        twist: FloatArray,
        local_tensions: FloatArray,
    ) -> None:
        """At ``twist`` (n, points) and ``local_tensions`` (tendons, 1, points) [N]."""
        self._energy, self._parameters = energy, parameters
        self._twist, self._local_tensions = twist[:, np.newaxis], local_tensions
        self.strain = to_scaled(energy.law, self._twist)

    def _imbalance_by(self, gradient: FloatArray) -> FloatArray:
        """Imbalance by a change of the energy's ``gradient`` (n, quantities, 1, points)."""
        return -unscale_gradient(self._energy, self._twist, gradient)[:, :, 0]

    @functools.cached_property
    def length_by_twist(self) -> FloatArray:
        """Gradient of every tendon's stretch by the twist, (n, tendons, points)."""
        return lengthening_by_twist(self._energy, self._twist, self._local_tensions)[:, :, 0]

    @property
    def by_tension(self) -> FloatArray:
        """Per newton of each tendon's tension at the base, without friction."""
        return -self.length_by_twist * self._energy.transmission[:, 0]

    @property
    def by_youngs_modulus(self) -> FloatArray:
        """Per relative change of E."""
        elastic, _ = self._energy.material(self.strain)
        return self._imbalance_by(elastic[:, np.newaxis])

    @property
    def by_poisson_ratio(self) -> FloatArray:
        """Per unit of nu."""
        return self._imbalance_by(self._parameters.gradient_by_poisson(self.strain)[:, np.newaxis])

    @property
    def by_offset(self) -> FloatArray:
        """Per metre of each tendon's distance from the midline."""
        return self._imbalance_by(
            self._parameters.gradient_by_offset(self.strain, self._local_tensions)
        )

    @property
    def by_sheath_stiffness(self) -> FloatArray:
        """Per pascal of each tendon's sheath; no quantities where no tendon has a sheath."""
        return self._imbalance_by(
            self._parameters.gradient_by_sheath(self.strain, self._local_tensions)
        )
