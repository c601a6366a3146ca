"""Lengths of tendons from the base to their anchorages."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.quadrature import integration_weights
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.parameter_derivatives import ParameterDerivatives
from octo_arm_model.core.section.strain_measures import to_scaled

# From a twist (n, nodes) and tensions (tendons, nodes) [N] to the length of every tendon [m],
# (tendons,). The tensions matter with compliant sheaths only; else they may be None.
Measure: TypeAlias = Callable[[FloatArray, FloatArray | None], FloatArray]


class TendonLengths:
    """Integrals along the arm of the stretch of each tendon.

    Attributes:
        sections: the cross sections at the nodes.
        weights: quadrature weights along each tendon [m], (tendons, nodes).
        under: length of every tendon [m], (tendons,), under a twist (4 or 6, nodes) and tensions
            (tendons, nodes) [N] there, see `Measure`.
    """

    def __init__(self, sections: SectionEnergy, grid: StationGrid) -> None:
        """Integrate over the cross ``sections`` at the nodes of ``grid``."""
        self.sections = sections
        self.weights = sections.active[:, 0] * integration_weights(grid)
        self._slack = np.zeros_like(self.weights)
        self.under: Measure = self._under

    def _under(self, twist: FloatArray, tensions: FloatArray | None) -> FloatArray:
        """The `Measure` by NumPy."""
        sections = self.sections
        strain = to_scaled(sections.law, twist[:, np.newaxis])
        along = self._slack if tensions is None else tensions
        return self._integral(sections.stretches(strain, along[:, np.newaxis])[:, 0])

    def _integral(self, stretches: FloatArray) -> FloatArray:
        lengths: FloatArray = np.einsum('jn,jn->j', stretches, self.weights)
        return lengths

    def integral(self, tensions: FloatArray) -> FloatArray:
        """Integrals of ``tensions`` (tendons, nodes) over unloaded lengths [N m], (tendons,)."""
        return self._integral(tensions * np.sqrt(1.0 + self.sections.squared_slope[:, 0]))

    @functools.cached_property
    def at_rest(self) -> FloatArray:
        """Lengths in the unloaded arm [m], (tendons,)."""
        return self.under(self._straight, self._slack)

    def offset_weights(self, arm: Arm) -> FloatArray:
        """Derivatives of unloaded lengths by the tendons' distances from the midline [-].

        For the tendons of ``arm``, as a sum over nodes: (tendons, nodes). Zero for tendons that do
        not wind about the midline.
        """
        by_offset = ParameterDerivatives(self.sections, arm).length_by_offset(
            self._straight[:, np.newaxis], self._slack[:, np.newaxis]
        )
        return by_offset * self.weights

    @property
    def _straight(self) -> FloatArray:
        """Twist of the unloaded arm, (4 or 6, nodes)."""
        twist = np.zeros((self.sections.strains, self.weights.shape[1]))
        twist[3] = 1.0
        return twist
