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
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.reeling import Tolerance, complementary_step
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting
from octo_arm_model.rod.winches import Winches

NOTHING = np.zeros(6)
IN_AIR = Loads(gravity=(0.0, 0.0, -9.81))
STRETCHING = dataclasses.replace(SHEATHED, axial_stiffness=(100.0,), free_length=(0.05,))


def made(arm: Arm, loads: Loads = Loads(), **setting: object) -> Rod:
    return Rod(arm, loads, setting=Setting(**setting))  # type: ignore[arg-type]


def held(
    rod: Rod, displacements: FloatArray, start: Equilibrium | None = None,
    wrench: FloatArray = NOTHING,
) -> Equilibrium:  # fmt: skip
    """With all tendons driven."""
    driven = np.ones(displacements.size, np.bool_)
    return Winches(rod).solve(displacements, driven, Condition(0.0 * displacements, wrench), start)


def tensions_of(found: Equilibrium) -> FloatArray:
    return found.state.acting.condition.tensions


def tip_of(rod: Rod, found: Equilibrium) -> FloatArray:
    s = np.array([0.0, rod.arm.length])
    return rod.readout(found.level, s).read(found.state)[0][-1]


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
    found = held(made(arm, widens=False), asked)
    assert tensions_of(found).item() == pytest.approx(pull, rel=1e-9)


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
            found = held(rod, asked, start)
            lacking = np.where(
                tensions_of(found) > 0.0, np.abs(asked - found.state.reeled),
                asked - found.state.reeled,
            )  # fmt: skip
            assert lacking.max() <= 1e-9 * rod.arm.length
            assert found.state.residual <= 1e-9
        last = found


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
    found = held(rod, asked, None, wrench)
    assert np.hypot(*tip_of(rod, found)[1:]) < 1e-6
    free = rod.solve(tensions_of(found), wrench)
    assert np.hypot(*tip_of(rod, free)[1:]) > 0.1


def test_a_budget_that_is_spent_is_told(table4: Config) -> None:
    rod = Rod(table4.arm.with_density(1080.0), IN_AIR, budget=Budget(4))
    with pytest.raises(ContinuationError, match='budget of 4 iterations'):
        held(rod, np.full(12, 0.05))


@pytest.mark.parametrize(
    'setting', [{}, {'widens': False, 'shear': True}], ids=['rubber', 'shear']
)
def test_the_border_is_the_derivative_of_what_is_reeled_in(setting: dict[str, bool]) -> None:
    rod = made(STRETCHING, EVERYTHING, **setting)
    reeling = Winches(rod)
    found = held(rod, reeling.displacements(rod.solve(0.4 * TENSIONS, WRENCH)), None, WRENCH)
    border = reeling.reeling(found.level).linearise(found.state)

    def reeled(tensions: FloatArray) -> FloatArray:
        return reeling.displacements(rod.solve(tensions, WRENCH, found))

    expected = jacobian(reeled, tensions_of(found), 1e-3)
    np.testing.assert_allclose(border.changes, expected, rtol=0.0, atol=1e-6 * expected.max())


def test_steps_leave_tendons_taut_or_slack() -> None:
    changes = np.array([[2.0, -1.0, 0.5], [-1.0, 2.0, 0.0], [0.5, 0.0, 1.0]])
    wrong, every = np.array([1.0, -3.0, 0.2]), np.ones(3, np.bool_)
    for tensions in (np.zeros(3), np.array([0.1, 0.4, 0.0])):
        step, kept = complementary_step(changes, wrong, tensions, every, Tolerance.of(1.0, False))
        new = tensions + step
        assert kept == 0.0
        left = wrong - changes @ (new - tensions)
        assert (new >= 0.0).all() and (left <= 1e-3).all()
        assert np.abs(new * left).max() <= 1e-12
