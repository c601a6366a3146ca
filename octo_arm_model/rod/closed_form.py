"""The paper's balance (8a) with its constitutive law (3a), solved at each cross section alone.

A frictionless tendon's moment on a cross section is local, so K omega = sum M is a linear system
at every s, symmetric positive definite for non-negative tensions. As offsets have no component
along t, torsion is uncoupled and the two curvatures form a system of two; see `TendonSums` for
the letters.
"""

from __future__ import annotations

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod.paper_balance import (
    Strains,
    curvatures,
    mixed_curvatures,
    routed_torsion,
    twist_of,
)
from octo_arm_model.rod.tendon_sums import TendonSums, TendonWeights


class ClosedForm:
    """Strains from tensions, node by node.

    Attributes:
        weights: from tensions to sums over the tendons at every node.
        stiffness: of the cross section at every node.
    """

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        self.weights = TendonWeights(arm, nodes, section)
        self.stiffness = SectionStiffness.at(arm, nodes)

    def solve(self, tensions: FloatArray) -> Strains:
        """Twist at every node under ``tensions`` (..., tendons) [N].

        Residual and iterations are zero: the equations are linear.
        """
        return Strains(self._twist(self.weights.sums(tensions)), 0.0, 0)

    def local_twist(self, local_tensions: FloatArray) -> FloatArray:
        """Twist (4, batch, nodes) under tensions (tendons, batch, nodes) [N] at the nodes."""
        return self._twist(self.weights.local_sums(local_tensions))

    def _twist(self, sums: TendonSums) -> FloatArray:
        """Twist (4, ..., nodes) in equilibrium with the ``sums`` over the tendons."""
        _, torsion, bending = self.stiffness
        _, n, b, nn, bb, mixed, routing_torque = sums
        tau, xi, k = curvatures(0.0, 0.0, 0.0, n, b, nn, bb, torsion, bending)
        if mixed is not None:
            xi, k = mixed_curvatures(n, b, nn, bb, mixed, bending)
        if routing_torque is not None:
            tau = routed_torsion(routing_torque, nn, bb, torsion)
        return twist_of(tau, xi, k, sums, self.stiffness)
