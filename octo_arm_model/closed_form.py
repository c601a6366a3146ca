"""The paper's balance (8a) with its constitutive law (3a), solved at each cross section alone.

A frictionless tendon's moment on a cross section is local, so K omega = sum M is a linear system
at every s, symmetric positive definite for non-negative tensions. Four tendons along n and b
decouple it; see `TendonSums` for the letters.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm import Arm
from octo_arm_model.cross_section import Stiffness, longitudinal_strain
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.strains import Strains
from octo_arm_model.tendons import TendonWeights


class ClosedForm:
    """Strains from tensions, node by node."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        self._weights = TendonWeights(arm, nodes, section)
        self._stiffness = Stiffness.at(arm, nodes)

    def strains(self, tensions: FloatArray) -> Strains:
        """Strains (batch, nodes) under ``tensions`` (batch, tendons) [N]."""
        sums = self._weights.sums(tensions)
        bending = self._stiffness.bending
        strains = Strains(np.empty((4, *sums.axial.shape)))
        tau, xi, k, q = strains.values
        tau[:] = 0.0
        np.divide(-sums.first_b, bending + sums.second_b, out=xi)
        np.divide(sums.first_n, bending + sums.second_n, out=k)
        q[:] = longitudinal_strain(sums, self._stiffness, xi, k)
        return strains
