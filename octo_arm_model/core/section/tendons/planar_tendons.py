"""Tendons without a moment about t, in sections without torsion, for `quasi_newton`.

Then u = (u_t, w r') with the widening w, and only the component along t of u / w depends on the
strain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number

if TYPE_CHECKING:
    from octo_arm_model.core.section.energy import SectionEnergy


class PlanarTendons:
    """`quasi_newton.Tendons` that stay on their paths."""

    has_torsion = False
    imbalance = 0.0
    softening: Number = 0.0
    torsion: Number = 0.0
    coupling: Number = 0.0

    def __init__(self, energy: SectionEnergy, local_tensions: FloatArray) -> None:
        """Prepare for sections ``energy``, under tensions (tendons, batch, nodes) [N]."""
        self._energy, self._tensions = energy, local_tensions

    def gradient(self, strain: FloatArray) -> FloatArray:
        """See `quasi_newton.Tendons`."""
        self._width, self._slope, self._bend = self._energy.widening(strain[2])
        u_t = self._u_t = self._energy.along(strain / self._width)
        self._over = 1.0 / (u_t * u_t + self._energy.squared_slope)
        pull = self._tensions * np.sqrt(self._over)
        gradient = self._energy.resultants(u_t * pull)
        self._across = pull * self._energy.squared_slope
        if self._energy.law.widens:
            gradient[2] += self._slope * np.add.reduce(self._across)
        return gradient

    def stiffened(self, step: FloatArray) -> FloatArray:
        """See `quasi_newton.Tendons`: exact, as |u| is w times a function of u_t / w."""
        turned = self._energy.along(step) - (self._slope * step[2]) * self._u_t
        along = (self._across * self._over / self._width) * turned
        change = self._energy.resultants(along)
        if self._energy.law.widens:
            change[2] += self._bend * np.add.reduce(self._across) * step[2]
            change[2] -= self._slope * np.add.reduce(self._u_t * along)
        return change
