"""The force that bends an arm, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.arm.stiffness import bending_force


@pytest.mark.parametrize('part', [0.1, 0.02])
def test_of_a_uniform_arm_it_is_that_of_a_cantilever(part):
    """The tip of a cantilever moves by F L^3 / (3 E J)."""
    arm = Arm(Material(2e5), Body(0.3, 0.01, 0.01), (Section(0.3, 0.005, 0.005),))
    stiffness = 2e5 * 0.25 * np.pi * 0.01**4
    expected = 3.0 * stiffness * part / 0.3**2
    assert bending_force(arm, part) == pytest.approx(expected, rel=1e-3)
