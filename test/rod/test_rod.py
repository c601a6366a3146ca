"""Equilibria of the rod: closed forms, the solver, stability, and the branch that is followed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import EVERYTHING, SHEATHED, TENSIONS, WRENCH

from octo_arm_model import (
    Arm,
    Body,
    Config,
    Loads,
    Material,
    Section,
    SolveError,
    Solver,
)
from octo_arm_model.arm.budget import Budget
from octo_arm_model.arm.errors import ContinuationError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.continuation import judge
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting

NOTHING = np.zeros(6)
# A metal rod in discs that hold four tendons.
METAL = Arm(
    Material(200e9, 0.3), Body(0.3, 0.001, 0.001, disc_radius=0.01), (Section(0.3, 0.008, 0.008),)
)
EULER = math.pi**2 * 200e9 * math.pi * 0.001**4 / 4.0 / (4.0 * 0.3**2)


def made(arm: Arm, loads: Loads = Loads(), **setting: object) -> Rod:
    return Rod(arm, loads, setting=Setting(**setting))  # type: ignore[arg-type]


def tip_of(rod: Rod, found: Equilibrium) -> FloatArray:
    s = np.array([0.0, rod.arm.length])
    return rod.readout(found.level, s).read(found.state).position[-1]


def least_stiffness(rod: Rod, found: Equilibrium) -> float:
    return judge(rod.problem(found.level), found.state).variation.softest()[0]


def test_a_moment_bends_a_uniform_rod_into_an_arc() -> None:
    curvature = 2.0 * math.pi * 1.3 / 0.3
    moment = curvature * 200e9 * math.pi * 0.001**4 / 4.0
    rod = made(METAL, widens=False)
    found = rod.solve(np.zeros(4), np.array([0.0, 0.0, 0.0, 0.0, 0.0, moment]))
    s = np.linspace(0.0, 0.3, 21)
    angle = curvature * s
    expected = np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * s], axis=1) / curvature
    reading = rod.readout(found.level, s).read(found.state)
    np.testing.assert_allclose(reading.position, expected, rtol=0.0, atol=1e-8 * 0.3)


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
@pytest.mark.parametrize('is_loaded', [False, True])
def test_it_is_the_arm_of_the_solver(law: str, is_loaded: bool) -> None:
    loads, wrench = (EVERYTHING, WRENCH) if is_loaded else (Loads(), NOTHING)
    tensions = 0.4 * TENSIONS
    solver = Solver(SHEATHED, 'exact', 41, material=law, loads=loads)
    expected = solver.solve(tensions.reshape(2, 3), wrench)
    rod = made(SHEATHED, loads, widens=law == 'neo_hookean')
    found = rod.solve(tensions, wrench)
    readout = rod.readout(found.level, expected.s)
    reading = readout.read(found.state)
    twist = reading.twist
    atol = 1e-7 if is_loaded else 1e-6  # of the solver, at its stations
    np.testing.assert_allclose(reading.position, expected.position, rtol=0.0, atol=atol * 0.4)
    np.testing.assert_allclose(twist[:, 2] / twist[:, 3], expected.k, rtol=0.0, atol=1e-4)


def test_positions_are_as_accurate_as_was_asked_for(table4: Config) -> None:
    arm = table4.arm.with_density(1080.0)
    random = np.random.default_rng(5)
    largest = np.repeat([0.3, 2.0, 6.0], 4)
    s = np.linspace(0.0, arm.length, 31)
    loads = Loads(gravity=(0.0, 0.0, -9.81))
    usual, fine = (made(arm, loads, accuracy=one) for one in (1e-8, 1e-12))
    for _ in range(6):
        tensions = largest * random.uniform(size=12) * random.integers(0, 2, 12)
        found, expected = (
            rod.readout(one.level, s).read(one.state).position
            for rod in (usual, fine)
            for one in (rod.solve(tensions, NOTHING),)
        )
        assert np.abs(found - expected).max() <= 1e-8 * arm.length


def test_an_arm_that_bends_the_other_way_leaves_its_unstable_branch() -> None:
    # Under more than Euler's load it leans to one side or the other, and straightens nowhere.
    rod = made(METAL, widens=False)
    wrench = np.array([-1.2 * EULER, 0.0, 0.0, 0.0, 0.0, 0.0])
    first = rod.solve(np.array([0.13, 0.0, 0.0, 0.0]), wrench)
    assert tip_of(rod, first)[1] > 0.15
    then = rod.solve(np.array([0.0, 0.0, 0.12, 0.0]), wrench, first)
    assert least_stiffness(rod, then) > 0.0
    assert tip_of(rod, then)[1] == pytest.approx(-0.195, abs=1e-3)
    alone = rod.solve(np.array([0.0, 0.0, 0.12, 0.0]), wrench)
    np.testing.assert_allclose(tip_of(rod, then), tip_of(rod, alone), rtol=0.0, atol=1e-7)


@pytest.mark.parametrize('part', [0.999, 1.001])
def test_a_rod_buckles_at_the_load_of_euler(part: float) -> None:
    rod = made(METAL, widens=False)
    found = rod.solve(np.zeros(4), np.array([-part * EULER, 0.0, 0.0, 0.0, 0.0, 0.0]))
    aside = float(np.hypot(*tip_of(rod, found)[1:]))
    assert aside < 1e-9 if part < 1.0 else 0.03 < aside / 0.3 < 0.09


@pytest.mark.parametrize('steps', [6, pytest.param(60, marks=pytest.mark.endurance)])
def test_arms_followed_in_small_steps_stay_stable(steps: int, table4: Config) -> None:
    # Where an equilibrium is stable by a margin the next ones are not judged.
    arm = table4.arm.with_density(1080.0)
    rod = made(arm, Loads(gravity=(-9.81, 0.0, 0.0)))
    random, found = np.random.default_rng(2), None
    tensions = np.repeat([0.05, 0.3, 1.0], 4)
    for _ in range(steps):
        tensions = np.abs(tensions * (1.0 + 0.05 * random.standard_normal(12)))
        found = rod.solve(tensions, NOTHING, found)
        assert least_stiffness(rod, found) > -1e-6
        assert found.state.residual <= 1e-9


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
@pytest.mark.parametrize('fluid', [0.0, 1000.0])
def test_the_arm_of_table_4_finds_its_balance_under_its_weight(
    table4: Config, law: str, fluid: float
) -> None:
    random = np.random.default_rng(2012)
    largest = np.array([0.5, 4.0, 13.0])[:, np.newaxis]
    loads = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=fluid)
    rod = Rod(table4.arm.with_density(1080.0), loads, setting=Setting(law == 'neo_hookean'))
    for _ in range(20):
        shares = random.uniform(size=(3, 4)) * random.integers(0, 2, (3, 4))
        tensions = largest * shares / np.maximum(1.0, shares.sum(axis=1, keepdims=True))
        found = rod.solve(tensions.ravel(), NOTHING)
        assert found.state.residual <= 1e-11
        assert least_stiffness(rod, found) > 0.0


def test_a_budget_that_is_spent_says_how_far_the_arm_was_followed(table4: Config) -> None:
    arm = table4.arm.with_density(1080.0)
    for budget, spent in ((Budget(4), '4 iterations'), (Budget(seconds=1e-9), '1e-09 s')):
        rod = Rod(arm, Loads(gravity=(-9.81, 0.0, 0.0)), setting=Setting(), budget=budget)
        with pytest.raises(ContinuationError, match=f'budget of {spent} at .* % of the'):
            rod.solve(np.zeros(12), NOTHING)


def test_what_has_no_balance_is_refused() -> None:
    rod = made(METAL)
    with pytest.raises(SolveError, match='tensions shorten a tendon to nothing at s = '):
        rod.solve(np.array([1e9, 0.0, 0.0, 0.0]), NOTHING)
