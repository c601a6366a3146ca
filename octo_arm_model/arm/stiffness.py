"""The stiffness of cross sections and sheaths, and tensions and forces that bend an arm."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive

_STATIONS = 101  # number of points of the integrals
_WIDEST = 0.5  # largest radius of a sheath for which the formula holds, over that of the body


class SectionStiffness(NamedTuple):
    """The stiffness of the cross section at each node, each (nodes,)."""

    axial: FloatArray  #: E A [N]
    torsion: FloatArray  #: G I [N m^2]
    bending_n: FloatArray  #: E J of bending about n [N m^2]
    bending_b: FloatArray  #: E J of bending about b [N m^2]
    shear: FloatArray  #: G A [N]

    @classmethod
    def at(cls, arm: Arm, nodes: FloatArray) -> SectionStiffness:
        """Return the stiffness of ``arm`` at arc coordinates ``nodes`` (n,) [m]."""
        body = arm.body.geometry(nodes)
        young = arm.material.youngs_modulus_at(nodes)
        shear = arm.material.shear_modulus_at(nodes)
        computed = cls(
            young * body.area,
            shear * body.torsion,
            young * body.about_n,
            young * body.about_b,
            shear * body.area,
        )
        given = arm.stiffness.profiles.items()
        return computed._replace(**{name: profile.value(nodes) for name, profile in given})

    @property
    def bending(self) -> FloatArray:
        """The smaller of both bending stiffnesses [N m^2], (nodes,)."""
        return np.minimum(self.bending_n, self.bending_b)


def default_highest(arm: Arm, part: float = 0.3) -> FloatArray:
    """Return default upper bounds of tensions [N], of `Arm.tension_shape`.

    For each tendon it is the smallest of three tensions, to first order: the one that compresses
    the cross section at the anchorage by ``part`` [-], the one that alone bends the arm by 4 pi,
    and ``part`` of the one that alone folds the arm between discs.
    """
    highest = np.empty(len(arm.tendons))
    gap = np.diff([0.0, *arm.discs.faces]).max(initial=0.0)
    for j, (tendon, section) in enumerate(zip(arm.tendons, arm.tendon_section, strict=True)):
        s = np.linspace(0.0, arm.sections[section - 1].anchorage, _STATIONS)
        stiffness = SectionStiffness.at(arm, s)
        angle = float(trapezoid(np.hypot(*(tendon.path(s)[1::-1] / stiffness[2:4])), s))
        bending = 4.0 * np.pi / angle if angle > 0.0 else np.inf
        folding = 12.0 * float(stiffness.bending.min()) / gap**2 if gap else np.inf
        highest[j] = min(part * float(stiffness.axial[-1]), bending, part * folding)
    return highest.reshape(arm.tension_shape)


def bending_force(arm: Arm, part: float) -> float:
    """Return the transverse force [N] that moves the tip by ``part`` of the length, linearly."""
    s = np.linspace(0.0, arm.length, _STATIONS)
    bending = SectionStiffness.at(arm, s).bending
    return part * arm.length / float(trapezoid((arm.length - s) ** 2 / bending, s))


def estimate_sheath_stiffness(
    thread_radius: float, body_radius: float, shear_modulus: float
) -> float:
    """Return the stiffness k [Pa] of rubber of ``shear_modulus`` [Pa] around a tendon or sheath.

    An incompressible disc of ``body_radius`` R [m] is in plane strain under a force per length
    that is uniform on a ring of ``thread_radius`` r [m] about the centre and balanced by a uniform
    body force, the shear of the beam. Per unit of force, Kelvin's solution displaces the ring by
    (1/2 - ln r) / (4 pi G) and the section on average by (1 - ln R) / (4 pi G), and with the body
    force leaves the rim free of traction:

        k = 4 pi G / (ln(R / r) - 1/2) .

    Kelvin's solution in the plane: e.g. Timoshenko and Goodier, Theory of Elasticity, section 42
    (force at a point of a plate), for plane strain and nu = 1/2. For tapered arms take the
    mean radius; off the centre the rubber is a little softer.

    Raises:
        ArmDefinitionError: if a value is not > 0, or the thread is wider than half of the body.
    """
    thread = positive('thread_radius', thread_radius, 'm')
    body = positive('body_radius', body_radius, 'm')
    modulus = positive('shear_modulus', shear_modulus, 'Pa')
    if thread > _WIDEST * body:
        expected = f'at most {_WIDEST} of the radius of the body, {_WIDEST * body:.6g} [m]'
        raise ArmDefinitionError('thread_radius', thread, expected)
    return 4.0 * math.pi * modulus / (math.log(body / thread) - 0.5)
