"""Stiffness of a cross section, and its equilibrium in the paper's models."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray, Number
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod.tendon_sums import TendonSums


class Strains(NamedTuple):
    """What the equations of one of the paper's models give.

    Attributes:
        twist: (1 + q) (tau, xi, k) [1/m] and 1 + q [-], (4, ..., nodes).
        residual: relative residual, (...), or one for all arms.
        iterations: likewise.
    """

    twist: FloatArray
    residual: FloatArray | float
    iterations: IntArray | int


def curvatures(
    p_t: Number, p_n: Number, p_b: Number, first_n: Number, first_b: Number,
    second_n: Number, second_b: Number, torsion: Number, bending: Number,
) -> tuple[Number, Number, Number]:  # fmt: skip
    """Strains (tau, xi, k) [1/m] at which the imbalance of moments is p [N m], see `renda2012`.

    From first [N m] and second moments [N m^2] of the tendons, see `TendonSums`, torsional and
    bending stiffness [N m^2]. With p = 0 it is the equilibrium (8a).
    """
    return (
        p_t / (torsion + (second_n + second_b)),
        (p_n - first_b) / (bending + second_b),
        (p_b + first_n) / (bending + second_n),
    )


def mixed_curvatures(
    first_n: Number, first_b: Number, second_n: Number, second_b: Number, mixed: Number,
    bending: Number,
) -> tuple[Number, Number]:  # fmt: skip
    """Curvatures (xi, k) [1/m] in equilibrium where the ``mixed`` second moment couples them."""
    about_n, about_b = bending + second_b, bending + second_n
    determinant = about_n * about_b - mixed * mixed
    return (
        (mixed * first_n - about_b * first_b) / determinant,
        (about_n * first_n - mixed * first_b) / determinant,
    )


def routed_torsion(
    routing_torque: Number, second_n: Number, second_b: Number, torsion: Number
) -> Number:
    """Torsion tau [1/m] in equilibrium with tendons that wind about the midline."""
    return -routing_torque / (torsion + (second_n + second_b))


def imbalance_of(
    tau: Number, xi: Number, k: Number, first_n: Number, first_b: Number,
    second_n: Number, second_b: Number, torsion: Number, bending: Number,
) -> tuple[Number, Number, Number]:  # fmt: skip
    """Imbalance p [N m] of moments at strains (tau, xi, k) [1/m]; the inverse of `curvatures`."""
    return (
        tau * (torsion + (second_n + second_b)),
        xi * (bending + second_b) + first_b,
        k * (bending + second_n) - first_n,
    )


def added_curvature(first: Number, second: Number, bending: Number) -> Number:
    """Jump (11) of a curvature at an anchorage [1/m].

    From the ``first`` and ``second`` moments of the tendons that end there, and E J.
    """
    return first / (second + bending)


def stretch(
    xi: Number, k: Number, pull: Number, first_n: Number, first_b: Number, axial: Number
) -> Number:
    """1 + q = 1 + N / (E A) with N from (9a); ``pull`` is the sum of tensions [N]."""
    return (k * first_n - xi * first_b - pull) / axial + 1.0


def twist_of(
    tau: FloatArray, xi: FloatArray, k: FloatArray, sums: TendonSums, stiffness: SectionStiffness
) -> FloatArray:
    """Twist (4, ..., nodes) of the frame: (1 + q) (tau, xi, k) [1/m] and 1 + q [-]."""
    stretched = stretch(xi, k, sums.axial, sums.first_n, sums.first_b, stiffness.axial)
    twist = np.empty((4, *stretched.shape), stretched.dtype)
    for strain, out in zip((tau, xi, k), twist):
        np.multiply(strain, stretched, out=out)
    twist[3] = stretched
    return twist
