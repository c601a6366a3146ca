"""Offsets of tendons in compliant sheaths, and their derivatives by static condensation."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.formulas import sheath_pull

if TYPE_CHECKING:
    from octo_arm_model.core.section.energy import SectionEnergy

# Components along t, n and b of a vector for each tendon.
Parts: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


class Condensed(NamedTuple):
    """Equilibrium offsets d of tendons in their sheaths, and second derivatives of the energy.

    See `sheaths.sheath` for d, C and D. All arrays but ``strain`` end in (tendons, batch, nodes);
    pairs are along n and b.

    Attributes:
        sections: the cross sections with the tendons displaced by d.
        offset: d [m], (2, ...).
        pull: derivative of |u| by d [1/m], (2, ...).
        compliance: inverse of the second derivatives by d, D^-1 [m^2/N]: nn, nb and bb, (3, ...).
        mixed: second derivatives C by d and strain, (2, n, ...).
        strain: the scaled strain at which they hold, (n, batch, nodes).
        weight: T / |u| [N].
        unit: u / |u|, three arrays.
    """

    sections: SectionEnergy
    offset: FloatArray
    pull: FloatArray
    compliance: FloatArray
    mixed: FloatArray
    strain: FloatArray
    weight: FloatArray
    unit: Parts

    def moved(self, by_offset: FloatArray) -> FloatArray:
        """D^-1 ``by_offset``, (2, ...) [m]: minus the change of d in equilibrium.

        ``by_offset`` (2, ...) [N/m] is a change of the gradient of the energy by d at fixed d.
        """
        nn, nb, bb = self.compliance
        n, b = by_offset
        return np.stack([nn * n + nb * b, nb * n + bb * b])

    def answer(self, by_offset: FloatArray) -> FloatArray:
        """C D^-1 ``by_offset``, (n, ...): decrease of the gradient by the strain.

        As d follows a change ``by_offset`` (2, ...) [N/m] of the gradient by d.
        """
        n, b = self.moved(by_offset)
        lost: FloatArray = self.mixed[0] * n + self.mixed[1] * b
        return lost

    def shortening(self, by_offset: FloatArray) -> FloatArray:
        """Decrease of |u| as d follows a change ``by_offset`` (2, ...) [N/m] of the gradient."""
        lost: FloatArray = np.add.reduce(self.pull * self.moved(by_offset))
        return lost

    def by_path(self, change: FloatArray) -> FloatArray:
        """Change (2, ...) [N/m] of the gradient by d, by a ``change`` (3, ...) of u alone."""
        t, n, b = self.strain[:3]
        along = sum(e * c for e, c in zip(self.unit, change, strict=True))
        across = np.stack(sheath_pull(t, n, b, *change))
        moved: FloatArray = self.weight * (across - self.pull * along)
        return moved
