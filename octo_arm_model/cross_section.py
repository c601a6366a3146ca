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
        return cls(
            arm.material.youngs_modulus * area,
            arm.material.shear_modulus * 2.0 * second_moment,
            arm.material.youngs_modulus * second_moment,
        )


def longitudinal_strain(
    sums: TendonSums, stiffness: Stiffness, xi: FloatArray, k: FloatArray
) -> FloatArray:
    """Longitudinal strain q = N / (E A) with N from (9a) [-]."""
    return (k * sums.first_n - xi * sums.first_b - sums.axial) / stiffness.axial
