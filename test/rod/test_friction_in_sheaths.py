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
    PointLoad,
    Section,
    SolveError,
    Solver,
)
from octo_arm_model.arm.budget import Budget
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.forms import is_available

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


@pytest.mark.parametrize('loads', LOADS)
def test_a_loop_closes_and_encloses_something(loads: Loads) -> None:
    solver = Solver(HELICAL, 'exact', loads=loads)
    last, tips = solver.solve(PULL), []
    for part in 2 * (0.7, 0.4, 0.7, 1.0):
        last = solver.follow(part * PULL, last)
        tips.append(last.tip)
    # The first may be on fewer nodes, where a tendon begins to stick a little elsewhere.
    np.testing.assert_allclose(tips[:4], tips[4:], atol=5e-6 * HELICAL.length)
    assert np.linalg.norm(tips[0] - tips[2]) > 2e-3 * HELICAL.length


def test_sheaths_too_soft_are_refused_by_the_tension_that_friction_leaves() -> None:
    soft = dataclasses.replace(STRAIGHT, sheath_stiffness=(5e3,))
    with pytest.raises(SolveError):
        Solver(soft, 'exact').solve([[20.0]])


def test_the_closed_form_keeps_tendons_in_their_places() -> None:
    with pytest.raises(ConfigError, match=r'tendons\.sheath_stiffness goes with model exact'):
        Solver(STRAIGHT, 'closed_form')


# Both forms -------------------------------------------------------------------------------------


@pytest.mark.skipif(not is_available(), reason='numba is not installed')
def test_machine_code_pulls_and_releases_as_numpy_does() -> None:
    loads = Loads(points=(PointLoad(0.2, force=(0.01, 0.02, 0)),))
    machine, plain = (
        Solver(HELICAL, 'exact', 41, loads=loads, compiled=compiled) for compiled in (True, False)
    )
    one = other = None
    for part in (1.0, 0.7, 0.0):
        one, other = machine.follow(part * PULL, one), plain.follow(part * PULL, other)
        atol = 1e-9 * HELICAL.length
        np.testing.assert_allclose(one.position, other.position, rtol=0.0, atol=atol)
        for name in ('tendon_tensions', 'point_tensions'):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=2e-8)
        one, other = other, one  # each may go on from what the other has found


def test_a_movement_is_followed_in_few_steps() -> None:
    wrench = [0.0, 0.01, 0.01, 0.0, 0.0, 0.0]
    solver = Solver(HELICAL, 'exact', 41)
    found = solver.solve(PULL, wrench)
    for part in 1.0 + 0.02 * np.sin(np.arange(8.0)):
        found = solver.follow(part * PULL, found, wrench)
        assert found.residual <= Budget().residual
        assert found.iterations <= 8
