"""Lengths of tendons from the base to their anchorages."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.quadrature import integration_weights
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.strain_measures import to_scaled


class TendonLengths:
    """Integrals of what each tendon is stretched by along the arm."""

    def __init__(self, sections: SectionEnergy, grid: StationGrid) -> None:
        """For the cross ``sections`` at the nodes of ``grid``."""
        self._sections = sections
        self._weights = sections.active[:, 0] * integration_weights(grid)

    def under(self, twist: FloatArray, tensions: FloatArray) -> FloatArray:
        """Length of every tendon [m], (tendons,), under ``twist`` (4 or 6, nodes).

        And ``tensions`` (tendons,) [N].
        """
        sections = self._sections
        strain = to_scaled(sections.law, twist[:, np.newaxis])
        local_tensions = sections.local_tensions(tensions[np.newaxis])
        stretches = sections.stretches(strain, local_tensions)[:, 0]
        lengths: FloatArray = np.einsum('jn,jn->j', stretches, self._weights)
        return lengths

    @functools.cached_property
    def at_rest(self) -> FloatArray:
        """Those of the unloaded arm."""
        twist = np.zeros((self._sections.strains, self._weights.shape[1]))
        twist[3] = 1.0
        return self.under(twist, np.zeros(len(self._weights)))
