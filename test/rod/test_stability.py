"""Whether a balance is seen to be one of least energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Material, Section, Solver
from octo_arm_model.rod.continuation import judge
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.newton import settle
from octo_arm_model.rod.rod import Rod, Setting

COLUMN = Arm(Material(1e5), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
EULER = 1e5 * np.pi**3 * 0.01**4 / (16.0 * 0.4**2)  # [N], of a column that is held at its base


@pytest.mark.parametrize('shear', [False, True])
@pytest.mark.parametrize('part', [0.5, 0.98, 1.02, 5.0, 26.0, 38.0, 42.0])
def test_a_straight_column_is_one_of_least_energy_below_eulers_load(
    part: float, shear: bool
) -> None:
    problem = Rod(COLUMN, setting=Setting(widens=False, shear=shear)).problem(0)
    straight = np.zeros((problem.elements.s.size, problem.strains))
    straight[:, 3] = 1.0
    condition = Condition(np.zeros(4), np.array([-part * EULER, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found = settle(problem, problem.evaluate(problem.acting(condition), straight), 1e-11)
    assert found.state.residual <= 1e-11 and not found.state.z[:, 1:3].any()
    stability = judge(problem, found.state).stability
    # Shear lets it buckle a little earlier.
    assert stability.is_stable == (part < 1.0)
    assert stability.is_firm == (part <= 0.5)


def test_instability_is_seen_where_it_is_come_upon_in_small_steps() -> None:
    # Where a balance is stable by a margin the next ones are not tested.
    solver, found = Solver(COLUMN, 'exact', material='linear'), None
    for part in np.arange(0.9, 1.05, 0.001):
        found = solver.solve(np.zeros((1, 4)), (-part * EULER, 0, 0, 0, 0, 0), start=found)
        aside = float(np.hypot(*found.tip[1:]))
        assert aside < 1e-9 if part < 0.9999 else part < 1.0005 or aside > 1e-3
    assert found is not None and np.hypot(*found.tip[1:]) > 0.05


def test_a_column_buckles_however_large_the_tensions_in_it_are() -> None:
    # Beside large tensions the force that it buckles under is a small change of the loads.
    solver = Solver(COLUMN, 'exact', material='linear')
    tensions = np.full((1, 4), 1.0)  # an eighth of E A together
    found, wrench = solver.solve(tensions), np.zeros(6)
    for part in (0.5, 1.0, 1.5, 2.0):
        wrench[0] = -part * EULER
        found = solver.solve(tensions, wrench, start=found)
    assert np.hypot(*found.tip[1:]) > 0.2
    np.testing.assert_allclose(
        np.hypot(*found.tip[1:]), np.hypot(*solver.solve(tensions, wrench).tip[1:]), rtol=1e-6
    )


def test_a_column_that_is_pulled_to_the_other_side_leaves_its_unstable_branch() -> None:
    # Under more than Euler's load it leans to one side or the other, and straightens nowhere.
    solver, wrench = Solver(COLUMN, 'exact', material='linear'), np.zeros(6)
    wrench[0] = -1.2 * EULER
    one, other = np.array([[0.02, 0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.02, 0.0]])
    first = solver.solve(one, wrench)
    then = solver.solve(other, wrench, start=first)
    assert first.tip[1] > 0.1 and then.tip[1] < -0.1
    np.testing.assert_allclose(then.tip, solver.solve(other, wrench).tip, rtol=0.0, atol=1e-7)


def test_a_column_buckles_as_tendons_take_its_stiffness() -> None:
    # Four tendons of 1 N leave a tenth of it, and 4 % more tension less than it is loaded with.
    bending = 1e5 * np.pi * 0.01**4 / 4.0
    arm = dataclasses.replace(COLUMN, sheath_stiffness=(4.0 / (0.9 * bending),))
    solver, found = Solver(arm, 'exact', material='linear'), None
    for tension in np.arange(0.9, 1.045, 0.01):
        found = solver.follow(
            np.full((1, 4), tension), found, (-0.04 * EULER, 0.0, 0.0, 0.0, 0.0, 0.0)
        )
        aside = np.hypot(*found.tip[1:])
        assert aside < 1e-9 if tension < 1.03 else tension < 1.038 or aside > 1e-3


@pytest.mark.parametrize('seed', range(4))
def test_least_energy_is_seen_where_the_whole_second_variation_is_positive(seed: int) -> None:
    random, expected, arms = np.random.default_rng(seed), [], 40
    rod = Rod(COLUMN)
    problem = rod.problem(0)
    for _ in range(arms):
        tensions = random.uniform(0.0, 1.0) * random.uniform(0.0, 1.5, 4)
        z = rod.unloaded(problem, Condition(tensions, np.zeros(6)))[0]
        free = problem.evaluate(problem.acting(Condition(tensions, np.zeros(6))), z)
        tangent = problem.work.rotation[-1, :, 0]
        # From 3 to 300 % of Euler's load, against the tip of an arm that tendons bend.
        force = EULER * (0.3 * random.normal(size=3) - 10.0 ** random.uniform(-1.5, 0.5) * tangent)
        condition = Condition(tensions, np.append(force, np.zeros(3)))
        state = problem.evaluate(problem.acting(condition), free.z)
        is_stable = judge(problem, state).stability.is_stable
        # All changes of the twist at all points take energy.
        rows = np.repeat(problem.elements.weights, problem.strains)[:, np.newaxis]
        variation = rows * problem.work.jacobian
        expected.append(np.linalg.eigvalsh(0.5 * (variation + variation.T))[0] > 0.0)
        assert is_stable == expected[-1]
    assert 3 <= sum(expected) <= arms - 3
