"""Tendons with friction in sheaths that give way: closed form, limits, history, derivatives."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helical_arm import PULL, helical_arm
from scipy.optimize import brentq

from octo_arm_model import (
    Arm,
    Body,
    ConfigError,
    Loads,
    Material,
    Section,
    Solver,
)
from octo_arm_model.arm.hints import FloatArray

YOUNG, RADIUS, LENGTH, OFFSET, MU, SHEATH = 1e5, 0.01, 0.4, 0.006, 0.3, 1.5e5
BENDING = YOUNG * math.pi * RADIUS**4 / 4
STRAIGHT = Arm(
    Material(YOUNG, 0.5, 1080.0), Body(LENGTH, RADIUS, RADIUS),
    (Section(LENGTH, OFFSET, OFFSET, angles=(0.0,)),),
    friction=(MU,), sheath_stiffness=(SHEATH,),
)  # fmt: skip
# One slides freely and one keeps its place.
HELICAL = helical_arm(
    Material(1.1e5, 0.5, 1080.0),
    friction=(0.1, 0.2, 0.3, 0.1, 0.0, 0.2),
    sheath_stiffness=(3e5, 5e5, 0.0, 4e5, 2e5, 6e5),
)
LOADS = [
    pytest.param(Loads(), id='free'),
    pytest.param(Loads(gravity=(0.0, 0.0, -9.81)), id='under gravity'),
]


@pytest.mark.parametrize('pull', [0.1, 1.0, 4.0])
def test_one_parallel_tendon_is_that_of_the_closed_form(pull: float) -> None:
    # It stands off its path by T kappa / k, so that E J kappa = T (y + T kappa / k), and
    # T' = -mu T kappa is separable.
    def passed(tension: float) -> float:
        """Where the tension has fallen to this [m]."""
        bent = BENDING * (1.0 / tension - 1.0 / pull) - (pull - tension) / SHEATH
        return bent / (MU * OFFSET)

    backbone = Solver(STRAIGHT, 'exact', material='linear').solve([[pull]])
    expected = np.array([brentq(lambda t: passed(t) - s, 1e-3, pull) for s in backbone.s])
    np.testing.assert_allclose(backbone.tendon_tensions[:, 0], expected, rtol=1e-7)
    bent = expected * OFFSET / (BENDING - expected**2 / SHEATH)
    np.testing.assert_allclose(backbone.k * (1.0 + backbone.q), bent, rtol=1e-6)


@pytest.mark.parametrize('loads', LOADS)
def test_limits_are_friction_alone_and_sheaths_alone(loads: Loads) -> None:
    def tip(**changes: tuple[float, ...]) -> FloatArray:
        arm = dataclasses.replace(HELICAL, **changes)
        return Solver(arm, 'exact', loads=loads).solve(PULL).tip

    both = tip()
    rough, soft = tip(sheath_stiffness=()), tip(friction=())
    assert min(np.linalg.norm(both - rough), np.linalg.norm(both - soft)) > 1e-4
    np.testing.assert_allclose(tip(sheath_stiffness=(1e14,)), rough, atol=1e-8)
    np.testing.assert_allclose(tip(friction=(1e-10,)), soft, atol=1e-8)


def test_the_closed_form_keeps_tendons_in_their_places() -> None:
    with pytest.raises(ConfigError, match=r'tendons\.sheath_stiffness goes with model exact'):
        Solver(STRAIGHT, 'closed_form')
