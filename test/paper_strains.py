"""The balance of the closed form at one place of an arm."""

from __future__ import annotations

import numpy as np

from octo_arm_model import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod import arrays
from octo_arm_model.rod.elements import build_elements
from octo_arm_model.rod.paper_equations import tabulate_paper, tendon_moments


def tendon_sums(arm: Arm, tensions: np.ndarray, s: float, active: int) -> FloatArray:
    """The seven sums over the tendons of sections 1 to ``active`` at ``s`` [m]."""
    moments = tendon_moments(arm, np.array([s]), np.array([active]))
    return np.asarray(np.ravel(tensions) @ moments[..., 0])


def closed_form_strains(arm: Arm, tensions: np.ndarray, s: float, active: int) -> FloatArray:
    """Strains tau, xi, k and q there."""
    tables = tabulate_paper(arm, build_elements(arm), np.zeros(1), is_published=False)
    stiffness = np.stack(SectionStiffness.at(arm, np.array([s]))[:4])
    sums = tendon_sums(arm, tensions, s, active).reshape(1, 7, 1)
    twist = arrays.paper_twists(
        tables._replace(stiffness=stiffness, rest=np.zeros((3, 1))), sums, 0.0
    )[0][0, 0]
    return np.append(twist[:3] / twist[3], twist[3] - 1.0)
