"""How stiff a cross section is, and how far it compresses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm import Arm
from octo_arm_model.hints import FloatArray
from octo_arm_model.tendons import TendonSums


class Stiffness(NamedTuple):
    """Stiffness of the cross section at each node, each (nodes,).

    Attributes:
        axial: E A [N].
        torsion: G I [N m^2].
        bending: E J [N m^2].
    """

    axial: FloatArray
    torsion: FloatArray
    bending: FloatArray

    @classmethod
    def at(cls, arm: Arm, nodes: FloatArray) -> Stiffness:
        """Stiffness of ``arm`` at arc coordinates ``nodes`` (n,) [m]."""
        radius = arm.body.radius(nodes)
        area = np.pi * radius**2
        second_moment = 0.25 * np.pi * radius**4
        young = arm.material.youngs_modulus_at(nodes)
        shear = arm.material.shear_modulus_at(nodes)
        return cls(young * area, shear * 2.0 * second_moment, young * second_moment)


def complete_twist(twist: FloatArray, sums: TendonSums, stiffness: Stiffness) -> None:
    """Make the twist of the frame of what begins, in ``twist`` (4, ..., nodes), with omega.

    From omega = (tau, xi, k) [1/m] follows q = N / (E A) with N from (9a); the twist is the
    angular strain (1 + q) omega and the stretch 1 + q [-].
    """
    tau, xi, k, stretch = twist
    np.multiply(k, sums.first_n, out=stretch)
    stretch -= xi * sums.first_b
    stretch -= sums.axial
    stretch /= stiffness.axial
    stretch += 1.0
    tau *= stretch
    xi *= stretch
    k *= stretch
