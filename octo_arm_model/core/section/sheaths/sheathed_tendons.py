"""Tendons in compliant sheaths, for `quasi_newton`.

A tendon nearly parallel to the midline is displaced by T / k times the curvature, and reduces the
bending stiffness of the body by T^2 / k. The offsets are therefore computed from the directions of
the tendons at the last strain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.section.condensed import Parts
from octo_arm_model.core.section.formulas import sheath_pull, tendon_direction, tendon_gradient

if TYPE_CHECKING:
    from octo_arm_model.core.section.sheaths.sheath import SheathedSections


class SheathedTendons:
    """`quasi_newton.Tendons` that are displaced from their paths."""

    has_torsion = True

    def __init__(self, sections: SheathedSections, local_tensions: FloatArray) -> None:
        """Prepare for cross ``sections``, under tensions (tendons, batch, nodes) [N]."""
        self._sections = sections
        pulled = np.flatnonzero(local_tensions.any(axis=(1, 2)))
        self._tensions = local_tensions[pulled]
        self._x, self._y, self._dx, self._dy, compliance = (
            table[pulled]
            for table in (
                sections.x, sections.y, sections.dx, sections.dy, sections.sheath_compliance
            )
        )  # fmt: skip
        self._yielding = compliance * self._tensions
        self._direction: Parts | None = None
        self.softening: Number = 0.0
        self.torsion: Number = 0.0
        self.coupling: Number = 0.0
        self.imbalance = 0.0

    def gradient(self, strain: FloatArray) -> FloatArray:
        """See `quasi_newton.Tendons`."""
        t, n, b, stretch = strain
        width, slope, _ = self._sections.widening(stretch)
        if self._direction is None:
            # First from the direction t, so that a start near equilibrium stays near it.
            self._turn(strain, width, (1.0, 0.0, 0.0))
        assert self._direction is not None
        p_n, p_b, over = self._turn(strain, width, self._direction)
        unit = self._direction
        new_n, new_b = sheath_pull(t, n, b, *unit)
        # Directions hardly change with the offsets, of which the lever arms use the newest.
        x, y = self._x - self._yielding * new_n, self._y - self._yielding * new_b
        left = np.abs(new_n - p_n) + np.abs(new_b - p_b)
        left *= self._yielding
        self.imbalance = float((left / self._sections.lever_max).max(initial=0.0))
        pull = self._tensions * unit[0]
        yielding = self._yielding * pull
        self.softening = np.add.reduce(yielding * unit[0])
        self.coupling = coupling = np.empty((2, *t.shape))
        np.add.reduce(yielding * unit[1], out=coupling[0])
        np.add.reduce(yielding * unit[2], out=coupling[1])
        self.torsion = np.add.reduce(self._tensions * over * (x * x + y * y))
        terms = tendon_gradient(*unit, slope, x, y, self._dx, self._dy)
        gradient = np.empty_like(strain)
        for row, term in zip(gradient, terms, strict=True):
            np.add.reduce(self._tensions * term, out=row)
        return gradient

    def _turn(
        self, strain: FloatArray, width: Number, direction: tuple[Number, Number, Number]
    ) -> tuple[Number, Number, FloatArray]:
        """Update the directions of the tendons, at the offsets that follow from ``direction``.

        Returns:
            Derivatives of |u| by the offset for ``direction``, and the new 1 / |u|.
        """
        t, n, b, stretch = strain
        p_n, p_b = sheath_pull(t, n, b, *direction)
        x, y = self._x - self._yielding * p_n, self._y - self._yielding * p_b
        u_t, u_n, u_b, length = tendon_direction(t, n, b, stretch, width, x, y, self._dx, self._dy)
        over = 1.0 / length
        self._direction = u_t * over, u_n * over, u_b * over
        return p_n, p_b, over

    def stiffened(self, step: FloatArray) -> FloatArray:
        """Never called, as torsion is among the unknowns."""
        raise NotImplementedError
