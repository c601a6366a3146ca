"""Winches that hold tendons of the rod at a length: tensions, shapes, stability."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from differences import jacobian
from rods import EVERYTHING, SHEATHED, TENSIONS, WRENCH

from octo_arm_model import Arm, Body, Config, Loads, Material, Section
from octo_arm_model.arm.budget import Budget
from octo_arm_model.arm.errors import ContinuationError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.complementarity import complementary_step
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting
from octo_arm_model.rod.winches import Held, Winches

NOTHING = np.zeros(6)
IN_AIR = Loads(gravity=(0.0, 0.0, -9.81))
STRETCHING = dataclasses.replace(SHEATHED, axial_stiffness=(100.0,), free_length=(0.05,))


def made(arm: Arm, loads: Loads = Loads(), **setting: object) -> Rod:
    return Rod(arm, loads, setting=Setting(**setting))  # type: ignore[arg-type]


def wound(
    rod: Rod, displacements: FloatArray, start: Equilibrium | None = None,
    wrench: FloatArray = NOTHING,
) -> Held:  # fmt: skip
    """With all tendons driven."""
    driven = np.ones(displacements.size, np.bool_)
    return Winches(rod).solve(displacements, driven, Condition(0.0 * displacements, wrench), start)


def tip_of(rod: Rod, found: Equilibrium) -> FloatArray:
    s = np.array([0.0, rod.arm.length])
    return rod.readout(found.level, s).read(found.state).position[-1]


@pytest.mark.parametrize('loads', [Loads(), EVERYTHING], ids=['free', 'loaded'])
@pytest.mark.parametrize(
    'setting', [{}, {'widens': False, 'shear': True}], ids=['rubber', 'shear']
)
def test_tensions_come_back_from_what_they_reel_in(loads: Loads, setting: dict[str, bool]) -> None:
    wrench = WRENCH if loads.any else NOTHING
    rod = made(STRETCHING, loads, **setting)
    pulled = rod.solve(0.4 * TENSIONS, wrench)
    asked = Winches(rod).displacements(pulled)
    cold = wound(rod, asked, None, wrench)
    np.testing.assert_allclose(cold.reached.tensions, 0.4 * TENSIONS, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(cold.reached.displacement, asked, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(
        tip_of(rod, cold.equilibrium), tip_of(rod, pulled), rtol=0.0, atol=1e-9
    )
    # From nearby: the first lengths again, from those a little further.
    more = rod.solve(0.404 * TENSIONS, wrench, pulled)
    further = wound(rod, Winches(rod).displacements(more), cold.equilibrium, wrench)
    np.testing.assert_allclose(further.reached.tensions, 0.404 * TENSIONS, rtol=0.0, atol=1e-8)
    assert further.equilibrium.iterations <= 5


def test_a_straight_tendon_gives_way_with_its_arm_and_stretches_by_itself() -> None:
    young, radius, length, offset, pull, stiffness, free = 1e5, 0.01, 0.4, 0.006, 3.0, 200.0, 0.5
    arm = Arm(
        Material(young, 0.5), Body(length, radius, radius),
        (Section(length, offset, offset, angles=(0.0,)),),
        axial_stiffness=(stiffness,), free_length=(free,),
    )  # fmt: skip
    # The arm bends by T y / (E J), is compressed by T / (E A), and the tendon stretches besides.
    axial = young * math.pi * radius**2
    gives_way = offset**2 / (axial * radius**2 / 4) + 1.0 / axial
    asked = np.array([pull * (gives_way * length + (length + free) / stiffness)])
    found = wound(made(arm, widens=False), asked)
    assert found.reached.tensions.item() == pytest.approx(pull, rel=1e-9)


@pytest.mark.parametrize('loads', [Loads(), IN_AIR], ids=['free', 'in air'])
def test_mixed_commands_hold_what_each_is_told(table4: Config, loads: Loads) -> None:
    rod = made(table4.arm.with_density(1080.0), loads)
    driven, asked, given = np.zeros(12, np.bool_), np.full(12, np.nan), np.zeros(12)
    driven[[0, 5]], asked[[0, 5]], given[8] = True, [0.02, 0.01], 1.0
    found = Winches(rod).solve(asked, driven, Condition(given, NOTHING))
    tensions = found.reached.tensions
    np.testing.assert_allclose(found.reached.displacement[[0, 5]], [0.02, 0.01], atol=1e-9)
    assert tensions[8] == 1.0 and tensions[0] > 0.0 and np.count_nonzero(tensions) == 3
    # The other tension changes while these are held.
    given[8], given[9] = 0.8, 0.1
    then = Winches(rod).solve(asked, driven, Condition(given, NOTHING), found.equilibrium)
    np.testing.assert_allclose(then.reached.displacement[[0, 5]], [0.02, 0.01], atol=1e-9)
    again = rod.solve(then.reached.tensions, NOTHING, then.equilibrium)
    np.testing.assert_allclose(tip_of(rod, again), tip_of(rod, then.equilibrium), atol=1e-8)


@pytest.mark.parametrize('stiffness', [(), (500.0,)])
def test_one_slack_tendon_among_four_is_found(
    table2: Config, stiffness: tuple[float, ...]
) -> None:
    arm = dataclasses.replace(table2.arm, axial_stiffness=stiffness)
    rod = made(arm)
    tensions = np.zeros(len(arm.tendons))
    tensions[:4] = 0.4, 0.3, 0.0, 0.1
    asked = Winches(rod).displacements(rod.solve(tensions, NOTHING))
    asked[2] -= 3e-3
    driven = np.arange(tensions.size) < 4
    found = Winches(rod).solve(asked, driven, Condition(0.0 * tensions, NOTHING))
    np.testing.assert_allclose(found.reached.tensions, tensions, rtol=0.0, atol=1e-9)
    assert found.reached.tensions[2] == 0.0
    assert found.reached.displacement[2] - asked[2] == pytest.approx(3e-3, abs=1e-10)


def test_stiffer_tendons_come_as_near_as_one_likes_to_those_that_do_not_stretch(
    table4: Config,
) -> None:
    asked, driven = np.zeros(12), np.zeros(12, np.bool_)
    driven[[0, 5]], asked[[0, 5]] = True, [0.02, 0.01]
    tips = []
    for stiffness in ((), (1e3,), (1e4,), (1e5,)):
        rod = made(dataclasses.replace(table4.arm, axial_stiffness=stiffness))
        found = Winches(rod).solve(asked, driven, Condition(0.0 * asked, NOTHING))
        tips.append(tip_of(rod, found.equilibrium))
    apart = np.linalg.norm(np.array(tips[1:]) - tips[0], axis=1)
    np.testing.assert_allclose(apart[:-1] / apart[1:], 10.0, rtol=0.05)


def test_tendons_that_lengths_do_not_tell_apart_share_the_tension(table4: Config) -> None:
    # Four of equal length shorten the arm, and no lengths say by which of them.
    rod = made(table4.arm)
    found = Winches(rod).solve(
        np.full(12, 0.03), np.arange(12) < 4, Condition(np.zeros(12), NOTHING)
    ).reached.tensions  # fmt: skip
    np.testing.assert_allclose(found[:4], found[0], rtol=1e-6)
    assert not found[4:].any()


@pytest.mark.parametrize('loads', [Loads(), IN_AIR], ids=['free', 'in air'])
def test_any_tensions_of_the_arm_of_table_4_are_held_by_lengths(
    table4: Config, loads: Loads
) -> None:
    random = np.random.default_rng(7)
    largest = np.array([0.5, 4.0, 13.0])[:, np.newaxis]
    rod = made(table4.arm.with_density(1080.0), loads)
    last: Equilibrium | None = None
    for _ in range(4):
        shares = random.uniform(size=(3, 4)) * random.integers(0, 2, (3, 4))
        tensions = largest * shares / np.maximum(1.0, shares.sum(axis=1, keepdims=True))
        pulled = rod.solve(tensions.ravel(), NOTHING)
        asked = Winches(rod).displacements(pulled)
        for start in (None, last) if last else (None,):
            found = wound(rod, asked, start)
            lacking = np.where(
                found.reached.tensions > 0.0, np.abs(asked - found.reached.displacement),
                asked - found.reached.displacement,
            )  # fmt: skip
            assert lacking.max() <= 1e-9 * rod.arm.length
            assert found.equilibrium.state.residual <= 1e-9
        last = found.equilibrium


def test_an_arm_that_buckles_under_tension_is_held_by_lengths() -> None:
    # A rod under less than Euler's load of a clamped free one: with its tendons held it is a stiff
    # one, stable beyond, where tensions that do not follow the shape would let it go.
    arm = Arm(
        Material(200e9, 0.3), Body(0.3, 0.001, 0.001, disc_radius=0.01),
        (Section(0.3, 0.008, 0.008),),
    )  # fmt: skip
    euler = math.pi**2 * 200e9 * math.pi * 0.001**4 / 4.0 / (4.0 * 0.3**2)
    rod = made(arm, widens=False)
    pretension = np.full(4, 2.0)
    asked = Winches(rod).displacements(rod.solve(pretension, NOTHING))
    wrench = np.array([-1.2 * euler, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = wound(rod, asked, None, wrench)
    assert np.hypot(*tip_of(rod, found.equilibrium)[1:]) < 1e-6
    free = rod.solve(found.reached.tensions, wrench)
    assert np.hypot(*tip_of(rod, free)[1:]) > 0.1


def test_a_budget_that_is_spent_is_told(table4: Config) -> None:
    rod = Rod(table4.arm.with_density(1080.0), IN_AIR, budget=Budget(4))
    with pytest.raises(ContinuationError, match='budget of 4 iterations'):
        wound(rod, np.full(12, 0.05))


@pytest.mark.parametrize(
    'setting', [{}, {'widens': False, 'shear': True}], ids=['rubber', 'shear']
)
def test_the_border_is_the_derivative_of_what_is_reeled_in(setting: dict[str, bool]) -> None:
    rod = made(STRETCHING, EVERYTHING, **setting)
    reeling = Winches(rod)
    found = wound(rod, reeling.displacements(rod.solve(0.4 * TENSIONS, WRENCH)), None, WRENCH)
    equilibrium = found.equilibrium
    border = reeling.reeling(equilibrium.level).border(equilibrium.state)

    def reeled(tensions: FloatArray) -> FloatArray:
        return reeling.displacements(rod.solve(tensions, WRENCH, equilibrium))

    expected = jacobian(reeled, found.reached.tensions, 1e-3)
    np.testing.assert_allclose(border.changes, expected, rtol=0.0, atol=1e-6 * expected.max())


def test_steps_leave_tendons_taut_or_slack() -> None:
    changes = np.array([[2.0, -1.0, 0.5], [-1.0, 2.0, 0.0], [0.5, 0.0, 1.0]])
    wrong, every = np.array([1.0, -3.0, 0.2]), np.ones(3, np.bool_)
    for tensions in (np.zeros(3), np.array([0.1, 0.4, 0.0])):
        new = tensions + complementary_step(changes, wrong, tensions, every, 1.0)
        left = wrong - changes @ (new - tensions)
        assert (new >= 0.0).all() and (left <= 1e-3).all()
        assert np.abs(new * left).max() <= 1e-12
