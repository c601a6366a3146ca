"""Whether a balance is seen to be one of least energy."""

from __future__ import annotations

import dataclasses

import numpy as np

from octo_arm_model import Arm, Body, Material, Section, Solver

COLUMN = Arm(Material(1e5), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
EULER = 1e5 * np.pi**3 * 0.01**4 / (16.0 * 0.4**2)  # [N], of a column that is held at its base


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
