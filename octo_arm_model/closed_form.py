"""The paper's balance (8a) with its constitutive law (3a), solved at each cross section alone.

A frictionless tendon's moment on a cross section is local, so K omega = sum M is a linear system
at every s, symmetric positive definite for non-negative tensions. As offsets have no component
along t, torsion stands alone and the two curvatures form a system of two; see `TendonSums` for
the letters.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm import Arm
from octo_arm_model.cross_section import Stiffness, complete_twist
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.statics import Solution
from octo_arm_model.tendons import TendonWeights


class ClosedForm:
    """Strains from tensions, node by node."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        self._weights = TendonWeights(arm, nodes, section)
        self._stiffness = Stiffness.at(arm, nodes)

    def solve(self, tensions: FloatArray) -> Solution:
        """Twist at every node under ``tensions`` (..., tendons) [N]; nothing is left over."""
        sums = self._weights.sums(tensions)
        bending = self._stiffness.bending
        twist = np.zeros((4, *sums.axial.shape), sums.axial.dtype)
        tau, xi, k, _ = twist
        about_n, about_b = bending + sums.second_b, bending + sums.second_n
        if sums.mixed is None:
            np.divide(-sums.first_b, about_n, out=xi)
            np.divide(sums.first_n, about_b, out=k)
        else:
            determinant = about_n * about_b - sums.mixed * sums.mixed
            xi[...] = (sums.mixed * sums.first_n - about_b * sums.first_b) / determinant
            k[...] = (about_n * sums.first_n - sums.mixed * sums.first_b) / determinant
        if sums.swirl is not None:
            polar = self._stiffness.torsion + sums.second_n + sums.second_b
            np.divide(-sums.swirl, polar, out=tau)
        complete_twist(twist, sums, self._stiffness)
        return Solution(twist, 0.0, 0)
