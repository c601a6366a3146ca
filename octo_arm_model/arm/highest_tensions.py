"""Usual magnitudes of tendon tensions, and of a force that bends the arm."""

from __future__ import annotations

import numpy as np
from scipy.integrate import trapezoid

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import SectionStiffness

_STATIONS = 101  # of the integrals


def default_highest(arm: Arm, part: float = 0.3) -> FloatArray:
    """Default upper bounds of tensions [N], of `Arm.tension_shape`.

    For each tendon the smaller of two tensions, both to first order: the one that compresses the
    cross section at its anchorage by ``part`` [-], and the one that alone bends the arm by 4 pi.
    """
    highest = np.empty(len(arm.tendons))
    for j, (tendon, section) in enumerate(zip(arm.tendons, arm.tendon_section, strict=True)):
        s = np.linspace(0.0, arm.sections[section - 1].anchorage, _STATIONS)
        stiffness = SectionStiffness.at(arm, s)
        turn = float(trapezoid(tendon.offset.value(s) / stiffness.bending, s))
        bending = 4.0 * np.pi / turn if turn > 0.0 else np.inf
        highest[j] = min(part * float(stiffness.axial[-1]), bending)
    return highest.reshape(arm.tension_shape)


def bending_force(arm: Arm, part: float) -> float:
    """Transverse force that deflects the tip by ``part`` of the length, to first order [N]."""
    s = np.linspace(0.0, arm.length, _STATIONS)
    bending = SectionStiffness.at(arm, s).bending
    return part * arm.length / float(trapezoid((arm.length - s) ** 2 / bending, s))
