"""Offsets of tendons in compliant sheaths, and how these follow small changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.formulas import sheath_pull

if TYPE_CHECKING:
    from octo_arm_model.core.section.energy import SectionEnergy

# Of a vector for each tendon: along t, n and b.
Parts: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


class Condensed(NamedTuple):
    """Offsets of tendons, and how these follow changes.

    All arrays end in (tendons, batch, nodes); pairs are along n and b.

    Attributes:
        sections: the cross sections with tendons at their offsets.
        offset: d [m], (2, ...).
        pull: derivative of |u| by d [1/m], (2, ...).
        compliance: inverse of the second derivatives by d, D^-1 [m^2/N]: nn, nb and bb, (3, ...).
        mixed: second derivatives C by d and strain, (2, n, ...).
        strain: what it is for, (n, batch, nodes).
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
        """Product of D^-1 and ``by_offset`` (2, ...)."""
        nn, nb, bb = self.compliance
        n, b = by_offset
        return np.stack([nn * n + nb * b, nb * n + bb * b])

    def answer(self, by_offset: FloatArray) -> FloatArray:
        """What the gradient by strain, (n, ...), loses by a change ``by_offset`` of that by d."""
        n, b = self.moved(by_offset)
        lost: FloatArray = self.mixed[0] * n + self.mixed[1] * b
        return lost

    def shortening(self, by_offset: FloatArray) -> FloatArray:
        """What |u| loses by a change ``by_offset`` (2, ...) of the gradient by d."""
        lost: FloatArray = np.add.reduce(self.pull * self.moved(by_offset))
        return lost

    def by_path(self, change: FloatArray) -> FloatArray:
        """Change of the gradient by d, (2, ...), where u changes by ``change`` (3, ...) itself."""
        t, n, b = self.strain[:3]
        along = sum(e * c for e, c in zip(self.unit, change, strict=True))
        across = np.stack(sheath_pull(t, n, b, *change))
        moved: FloatArray = self.weight * (across - self.pull * along)
        return moved
