"""Whether a balance is seen to be one of least energy, and what it is refused for."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from octo_arm_model import Arm, Body, Loads, Material, Section, SolveError, Solver

COLUMN = Arm(Material(1e5), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
EULER = 1e5 * np.pi**3 * 0.01**4 / (16.0 * 0.4**2)  # [N], of a column that is held at its base


def test_instability_is_seen_where_it_is_come_upon_in_small_steps():
    # Where a balance is stable by a margin the next ones are not tested.
    solver, found = Solver(COLUMN, 'exact', material='linear'), None
    for part in np.arange(0.9, 1.05, 0.001):
        found = solver.solve(np.zeros((1, 4)), (-part * EULER, 0, 0, 0, 0, 0), start=found)
        aside = float(np.hypot(*found.tip[1:]))
        assert aside < 1e-9 if part < 0.9999 else part < 1.0005 or aside > 1e-3
    assert found is not None and np.hypot(*found.tip[1:]) > 0.05


def test_a_column_buckles_however_large_the_tensions_in_it_are():
    # Beside large tensions the force that it buckles under is a small change of the loads.
    solver = Solver(COLUMN, 'exact', material='linear')
    tensions = np.full((1, 4), 1.0)  # an eighth of E A together
    found, wrench = solver.solve(tensions), np.zeros(6)
    for part in (0.5, 1.0, 1.5, 2.0):
        wrench[0] = -part * EULER
        found = solver.solve(tensions, wrench, start=found)
    assert np.hypot(*found.tip[1:]) > 0.2
    assert_allclose(
        np.hypot(*found.tip[1:]), np.hypot(*solver.solve(tensions, wrench).tip[1:]), rtol=1e-6
    )


def test_a_column_that_is_pulled_to_the_other_side_leaves_its_unstable_branch():
    # Under more than Euler's load it leans to one side or the other, and straightens nowhere.
    solver, wrench = Solver(COLUMN, 'exact', material='linear'), np.zeros(6)
    wrench[0] = -1.2 * EULER
    one, other = np.array([[0.02, 0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.02, 0.0]])
    first = solver.solve(one, wrench)
    then = solver.solve(other, wrench, start=first)
    assert first.tip[1] > 0.1 and then.tip[1] < -0.1
    assert_allclose(then.tip, solver.solve(other, wrench).tip, rtol=0.0, atol=1e-7)


def test_a_column_buckles_as_tendons_take_its_stiffness():
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


# What a balance is refused for, in the words of the solver ---------------------------------------


AXIAL = 1e5 * np.pi * 0.01**2
BENDING = 0.25 * AXIAL * 0.01**2
LOADS = pytest.mark.parametrize('is_loaded', [False, True])


def refusal(arm: Arm, tensions: list[float], is_loaded: bool, law: str) -> str:
    """What the rod says; nothing where it solves."""
    loads = Loads(gravity=(0.0, 0.0, -0.01)) if is_loaded else Loads()
    try:
        Solver(arm.with_density(1080.0), 'exact', material=law, loads=loads).solve([tensions])
    except SolveError as error:
        return str(error)
    return ''


@LOADS
def test_rubber_is_not_compressed_to_nothing(is_loaded):
    part = [refusal(COLUMN, 4 * [pull * AXIAL], is_loaded, 'neo_hookean')
            for pull in (150.0, 250.0)]  # fmt: skip
    assert not part[0]
    says = 'tensions compress a fibre of the arm to nothing at s = '
    assert part[1].startswith(says) and part[1].endswith('of its length, must be > 0.02)')


@LOADS
def test_a_tendon_stays_in_the_body(is_loaded):
    sections = (Section(0.4, 0.009, 0.009),)
    stiffness = (2.0 * AXIAL**2 / BENDING,)
    arm = dataclasses.replace(COLUMN, sections=sections, sheath_stiffness=stiffness)
    for pull, is_out in ((0.4, False), (1.0, True)):
        says = refusal(arm, [pull * AXIAL, 0.0, 0.0, 0.0], is_loaded, 'neo_hookean')
        expected = 'tensions press a tendon out of the body at s = '
        assert says.startswith(expected if is_out else '') and bool(says) == is_out
        assert says.endswith('m: its sheath is too soft' if is_out else '')


def test_an_unloaded_arm_is_stable_in_its_sheaths():
    # Four tendons of 1 N take nine tenths of the bending stiffness.
    arm = dataclasses.replace(COLUMN, sheath_stiffness=(4.0 / (0.9 * BENDING),))
    assert not refusal(arm, 4 * [1.0], False, 'linear')
    says = refusal(arm, 4 * [1.1], False, 'linear')
    assert says.startswith('tensions bend the arm without end at s = ')
    assert says.endswith('m: sheaths are too soft')
    # Under a load it buckles, and is stable there or finds nothing.
    assert not says == refusal(arm, 4 * [1.1], True, 'linear')
