"""Stiffness of the cross sections."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray


class SectionStiffness(NamedTuple):
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
    def at(cls, arm: Arm, nodes: FloatArray) -> SectionStiffness:
        """Stiffness of ``arm`` at arc coordinates ``nodes`` (n,) [m]."""
        radius = arm.body.radius(nodes)
        area = np.pi * radius**2
        second_moment = 0.25 * np.pi * radius**4
        young = arm.material.youngs_modulus_at(nodes)
        shear = arm.material.shear_modulus_at(nodes)
        return cls(young * area, shear * 2.0 * second_moment, young * second_moment)
