"""The four degrees of freedom of a cross section."""

from __future__ import annotations

from dataclasses import dataclass

from octo_arm_model.hints import FloatArray


@dataclass(frozen=True)
class Strains:
    """Strains of the cross section at each node.

    Attributes:
        values: torsion about t [1/m], curvature about n [1/m], curvature about b [1/m] and
            longitudinal strain [-], (4, batch, nodes).
    """

    values: FloatArray

    @property
    def tau(self) -> FloatArray:
        """Torsion about t [1/m], (batch, nodes)."""
        return self.values[0]

    @property
    def xi(self) -> FloatArray:
        """Curvature about n [1/m], (batch, nodes)."""
        return self.values[1]

    @property
    def k(self) -> FloatArray:
        """Curvature about b [1/m], (batch, nodes)."""
        return self.values[2]

    @property
    def q(self) -> FloatArray:
        """Longitudinal strain [-], (batch, nodes)."""
        return self.values[3]
