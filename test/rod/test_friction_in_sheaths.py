"""Tendons with friction in sheaths that give way: closed form, limits, history, derivatives."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from differences import along, jacobian
from helical_arm import PULL, helical_arm
from scipy.optimize import brentq
from sliding_arms import assert_pulled_alike

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


@pytest.mark.parametrize(
    ('loads', 'material'),
    [(LOADS[0].values[0], 'linear'), (LOADS[1].values[0], 'neo_hookean')],
    ids=['free-linear', 'under gravity-neo_hookean'],
)
def test_derivatives_are_those_of_differences(loads: Loads, material: str) -> None:
    def outcome(arm: Arm, pull: FloatArray = PULL) -> FloatArray:
        near = Solver(arm, 'exact', 41, material=material, loads=loads)
        backbone = near.solve(pull, start=balanced)
        return np.concatenate([
            backbone.position[::8].ravel(), backbone.xi[::8],
            near.tendon_lengths(backbone).ravel(), near.tension_integrals(backbone).ravel(),
        ])  # fmt: skip

    def stiffer(x: FloatArray) -> FloatArray:
        young = float(HELICAL.material.youngs_modulus) * (1.0 + x.item())
        softer = dataclasses.replace(HELICAL.material, youngs_modulus=young)
        return outcome(dataclasses.replace(HELICAL, material=softer))

    def rougher(x: FloatArray) -> FloatArray:
        return outcome(dataclasses.replace(HELICAL, friction=tuple(mu * (1.0 + x))))

    def tighter(x: FloatArray) -> FloatArray:
        return outcome(dataclasses.replace(HELICAL, sheath_stiffness=tuple(stiffness * (1.0 + x))))

    solver = Solver(HELICAL, 'exact', 41, material=material, loads=loads)
    balanced = solver.solve(PULL)
    found = solver.sensitivity(balanced)
    assert found.by_friction is not None and found.by_sheath_stiffness is not None
    mu, stiffness = np.array(HELICAL.friction), np.array(HELICAL.sheath_stiffness)
    rest, random = solver.rest_lengths.ravel(), np.random.default_rng(5)
    # All tendons at once, each by another part of its own.
    step, one = random.uniform(-1.0, 1.0, 6), np.ones(1)
    for change, scale, direction, function in (
        (found.by_tension, np.ones(6), 2e-3 * step,
         lambda x: outcome(HELICAL, PULL + x.reshape(2, 3))),
        (found.by_youngs_modulus, one, 1e-3 * one, stiffer),
        (found.by_friction, mu, 1e-2 * step, rougher),
        (found.by_sheath_stiffness, stiffness, 1e-2 * step, tighter),
    ):  # fmt: skip
        assert change.tendon_tension is not None
        expected, moved = along(function, np.zeros_like(direction), direction), scale * direction
        got = np.concatenate([
            np.ravel(change.pose[::8, :3] @ moved), change.strain[::8, 1] @ moved,
            change.tendon_length @ moved, (change.tendon_tension @ moved) * rest,
        ])  # fmt: skip
        for one_kind, other in zip(np.split(got, [18, 24, 30]), np.split(expected, [18, 24, 30])):
            np.testing.assert_allclose(one_kind, other, rtol=1e-5, atol=1e-5 * np.abs(other).max())


def test_offsets_have_derivatives_too() -> None:
    def straight(offset: float) -> Solver:
        arm = Arm(
            STRAIGHT.material, STRAIGHT.body,
            (Section(LENGTH, offset, offset, angles=(0.0, 1.0), twist=(2.0, 3.0)),),
            friction=(MU,), sheath_stiffness=(SHEATH,),
        )  # fmt: skip
        return Solver(arm, 'exact', 41)

    pull = [[0.5, 0.2]]
    solver = straight(OFFSET)
    found = solver.sensitivity(solver.solve(pull)).by_offset
    assert found is not None
    expected = jacobian(lambda x: straight(x.item()).solve(pull).tip, np.array([OFFSET]), 1e-5)
    got = found.tip[:3].sum(axis=1, keepdims=True)
    np.testing.assert_allclose(got, expected, atol=1e-6 * np.abs(expected).max())


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
    assert_pulled_alike(machine, plain, (1.0, 0.7, 0.0))


def test_a_movement_is_followed_in_few_steps() -> None:
    wrench = [0.0, 0.01, 0.01, 0.0, 0.0, 0.0]
    solver = Solver(HELICAL, 'exact', 41)
    found = solver.solve(PULL, wrench)
    for part in 1.0 + 0.02 * np.sin(np.arange(8.0)):
        found = solver.follow(part * PULL, found, wrench)
        assert found.residual <= Budget().residual
        assert found.iterations <= 8
