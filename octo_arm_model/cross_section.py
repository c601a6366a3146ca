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


def twist_of(omega: FloatArray, sums: TendonSums, stiffness: Stiffness) -> FloatArray:
    """Twist of the frame per reference length, (4, batch, nodes).

    The angular strain (1 + q) (tau, xi, k) [1/m] and the stretch 1 + q [-], for ``omega`` =
    (tau, xi, k) (3, batch, nodes) and q = N / (E A) with N from (9a).
    """
    _, xi, k = omega
    force = k * sums.first_n - xi * sums.first_b - sums.axial
    twist = np.empty((4, *force.shape), force.dtype)
    stretch = np.divide(force, stiffness.axial, out=twist[3])
    stretch += 1.0
    np.multiply(omega, stretch, out=twist[:3])
    return twist
