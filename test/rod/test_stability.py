"""Stability of equilibria: buckling, errors, and hard random cases."""

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rods import METAL

from octo_arm_model import Arm, Body, Loads, Material, Section, SolveError, Solver
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.rod.continuation import judge
from octo_arm_model.rod.equilibrium import Condition, Equilibrium
from octo_arm_model.rod.rod import Rod, Setting

COLUMN = Arm(Material(1e5), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
EULER = 1e5 * np.pi**3 * 0.01**4 / (16.0 * 0.4**2)  # Euler's load of a clamped column [N]


def test_column_buckles_at_eulers_load_in_small_steps():
    # After an equilibrium with a margin of stability the next ones are not tested.
    solver, shape = Solver(COLUMN, 'exact', material='linear'), None
    for factor in np.arange(0.9, 1.05, 0.001):
        shape = solver.solve(np.zeros((1, 4)), (-factor * EULER, 0, 0, 0, 0, 0), start=shape)
        deflection = float(np.hypot(*shape.tip[1:]))
        assert deflection < 1e-9 if factor < 0.9999 else factor < 1.0005 or deflection > 1e-3
    assert shape is not None and np.hypot(*shape.tip[1:]) > 0.05


def test_column_with_large_tensions_buckles():
    # Relative to large tensions, the buckling force is a small change of the loads.
    solver = Solver(COLUMN, 'exact', material='linear')
    tensions = np.full((1, 4), 1.0)  # together an eighth of E A
    shape, wrench = solver.solve(tensions), np.zeros(6)
    for factor in (0.5, 1.0, 1.5, 2.0):
        wrench[0] = -factor * EULER
        shape = solver.solve(tensions, wrench, start=shape)
    assert np.hypot(*shape.tip[1:]) > 0.2
    assert_allclose(
        np.hypot(*shape.tip[1:]), np.hypot(*solver.solve(tensions, wrench).tip[1:]), rtol=1e-6
    )


def test_buckled_column_leaves_an_unstable_branch():
    # Above Euler's load both bent shapes are stable, and the straight one is not.
    solver, wrench = Solver(COLUMN, 'exact', material='linear'), np.zeros(6)
    wrench[0] = -1.2 * EULER
    left, right = np.array([[0.02, 0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.02, 0.0]])
    first = solver.solve(left, wrench)
    second = solver.solve(right, wrench, start=first)
    assert first.tip[1] > 0.1 and second.tip[1] < -0.1
    assert_allclose(second.tip, solver.solve(right, wrench).tip, rtol=0.0, atol=1e-7)


def test_column_buckles_when_tendons_reduce_its_stiffness():
    # Four tendons of 1 N leave a tenth of the stiffness; with 4 % more tension the column buckles.
    bending = 1e5 * np.pi * 0.01**4 / 4.0
    arm = dataclasses.replace(COLUMN, sheath_stiffness=(4.0 / (0.9 * bending),))
    solver, shape = Solver(arm, 'exact', material='linear'), None
    for tension in np.arange(0.9, 1.045, 0.01):
        shape = solver.follow(
            np.full((1, 4), tension), shape, (-0.04 * EULER, 0.0, 0.0, 0.0, 0.0, 0.0)
        )
        deflection = np.hypot(*shape.tip[1:])
        assert deflection < 1e-9 if tension < 1.03 else tension < 1.038 or deflection > 1e-3


# Errors ------------------------------------------------------------------------------------------


AXIAL = 1e5 * np.pi * 0.01**2
BENDING = 0.25 * AXIAL * 0.01**2
LOADS = pytest.mark.parametrize('is_loaded', [False, True])


def refusal(arm: Arm, tensions: list[float], is_loaded: bool, law: str) -> str:
    """Return the error of a solve, '' if it succeeds."""
    loads = Loads(gravity=(0.0, 0.0, -0.01)) if is_loaded else Loads()
    try:
        Solver(arm.with_density(1080.0), 'exact', material=law, loads=loads).solve([tensions])
    except SolveError as error:
        return str(error)
    return ''


@LOADS
def test_fully_compressed_rubber_is_an_error(is_loaded):
    errors = [
        refusal(COLUMN, 4 * [pull * AXIAL], is_loaded, 'neo_hookean') for pull in (150.0, 250.0)
    ]
    assert not errors[0]
    message = 'tensions compress a fibre of the arm to nothing at s = '
    assert errors[1].startswith(message) and errors[1].endswith('of its length, must be > 0.02)')


@LOADS
def test_tendon_pressed_out_of_the_body_is_an_error(is_loaded):
    sections = (Section(0.4, 0.009, 0.009),)
    stiffness = (2.0 * AXIAL**2 / BENDING,)
    arm = dataclasses.replace(COLUMN, sections=sections, sheath_stiffness=stiffness)
    for pull, is_out in ((0.4, False), (1.0, True)):
        error = refusal(arm, [pull * AXIAL, 0.0, 0.0, 0.0], is_loaded, 'neo_hookean')
        expected = 'tensions press a tendon out of the body at s = '
        assert error.startswith(expected if is_out else '') and bool(error) == is_out
        assert error.endswith('m: its sheath is too soft' if is_out else '')


def test_unstable_sheaths_are_an_error():
    # Four tendons of 1 N reduce the bending stiffness to a tenth.
    arm = dataclasses.replace(COLUMN, sheath_stiffness=(4.0 / (0.9 * BENDING),))
    assert not refusal(arm, 4 * [1.0], False, 'linear')
    error = refusal(arm, 4 * [1.1], False, 'linear')
    assert error.startswith('tensions bend the arm without end at s = ')
    assert error.endswith('m: sheaths are too soft')
    # With a load the arm buckles to a stable shape, or the solver fails otherwise.
    assert not error == refusal(arm, 4 * [1.1], True, 'linear')


# Hard cases: cold starts, columns and random walks; all of them run as endurance tests -----------


NOTHING = np.zeros(6)
LAWS = pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
# Lowest relative stiffness that counts as stable, because upright arms may rotate freely.
NEUTRAL = -1e-6


def random_tensions(sets: int, seed: int = 2012) -> Iterator[FloatArray]:
    """Yield random tensions (12,) of the arm of Table 4 up to the highest ones [N]."""
    random, largest = np.random.default_rng(seed), np.array([0.5, 4.0, 13.0])[:, np.newaxis]
    for _ in range(sets):
        shares = random.uniform(size=(3, 4)) * random.integers(0, 2, (3, 4))
        tensions = largest * shares / np.maximum(1.0, shares.sum(axis=1, keepdims=True))
        yield tensions.ravel()


def columns() -> Iterator[tuple[FloatArray, float]]:
    """Yield 312 forces (3,) over Euler's load, and the angles of their transverse parts."""
    along = (0.9, 1.0, 1.02, 1.1, 1.3, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 9.5)
    transverse = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1)
    for part, across, angle in itertools.product(along, transverse, (0.0, 0.3, 2.0, 4.4)):
        yield np.array([-part, across * math.cos(angle), across * math.sin(angle)]), angle


def is_stable(rod: Rod, equilibrium: Equilibrium) -> bool:
    """Return whether the second variation and the residual at the equilibrium are acceptable."""
    softest = judge(rod.problem(equilibrium.level), equilibrium.state).variation.softest()[0]
    return bool(softest > NEUTRAL and equilibrium.state.residual <= 1e-7)


def problems_of(rod: Rod, family: Iterator[FloatArray], wrench: FloatArray = NOTHING) -> list[str]:
    """Return errors and unstable results of cold starts at a ``family`` of tensions."""
    problems = []
    for number, tensions in enumerate(family):
        try:
            equilibrium = rod.solve(Condition(tensions, wrench))
        except SolveError as error:
            problems.append(f'{number}: {error}')
            continue
        if not is_stable(rod, equilibrium):
            problems.append(f'{number}: unstable')
    return problems


@LAWS
@pytest.mark.parametrize(
    'direction',
    [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)],
    ids=['level', 'hanging', 'upright'],
)
@pytest.mark.parametrize('sets', [8, pytest.param(1525, marks=pytest.mark.endurance)])
def test_cold_starts_of_arms_in_air_are_stable(table4, law, direction, sets):
    x, y, z = direction
    loads = Loads(gravity=(9.81 * x, 9.81 * y, 9.81 * z))
    rod = Rod(table4.arm.with_density(1080.0), loads, setting=Setting(law == 'neo_hookean'))
    assert problems_of(rod, random_tensions(sets)) == []


@pytest.mark.parametrize('sets', [8, pytest.param(1000, marks=pytest.mark.endurance)])
@pytest.mark.parametrize('force', [(0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (0.0, -0.1, 0.0)])
def test_cold_starts_of_the_metal_rod_are_stable(force, sets):
    random = np.random.default_rng(2021)
    rod = Rod(METAL, setting=Setting(law=LINEAR))
    family = iter(random.uniform(0.0, 6.0, (sets, 6)))
    assert problems_of(rod, family, np.array([*force, 0.0, 0.0, 0.0])) == []


@LAWS
@pytest.mark.parametrize('every', [26, pytest.param(1, marks=pytest.mark.endurance)])
def test_columns_buckle_to_the_side_of_the_transverse_force(law, every):
    rod, problems = Rod(COLUMN, setting=Setting(law == 'neo_hookean')), []
    for number, (force, angle) in enumerate(itertools.islice(columns(), 0, None, every)):
        wrench = np.array([*(EULER * force), 0.0, 0.0, 0.0])
        try:
            equilibrium = rod.solve(Condition(np.zeros(4), wrench))
        except SolveError as error:
            problems.append(f'{number}: {error}')
            continue
        s = np.array([0.0, COLUMN.length])
        tip = rod.readout(equilibrium.level, s).read(equilibrium.state)[0][-1]
        deflection = float(tip[1] * math.cos(angle) + tip[2] * math.sin(angle))
        least = 0.1 * COLUMN.length if -force[0] > 1.05 else 0.0
        if not (is_stable(rod, equilibrium) and deflection > least):
            problems.append(f'{number}: {force} leads to {tip}')
    assert problems == []


@pytest.mark.parametrize('pace', [0.05, 0.3, 1.0])
@pytest.mark.parametrize('gravity', [(0.0, 0.0, -9.81), (-9.81, 0.0, 0.0)], ids=['level', 'up'])
@pytest.mark.parametrize('steps', [15, pytest.param(1000, marks=pytest.mark.endurance)])
def test_random_walk_stays_stable(table4, pace, gravity, steps):
    rod = Rod(table4.arm.with_density(1080.0), Loads(gravity=gravity))
    random, equilibrium, problems = np.random.default_rng(7), None, []
    largest = np.repeat([0.2, 1.5, 5.0], 4)
    tensions = 0.3 * largest * random.uniform(size=12)
    wrench = np.zeros(6)
    for number in range(steps):
        step = pace * largest * random.standard_normal(12)
        tensions = np.clip(np.abs(tensions + 0.2 * step), 0.0, largest)
        wrench[:3] = 0.9 * wrench[:3] + 0.005 * pace * random.standard_normal(3)
        try:
            equilibrium = rod.solve(Condition(tensions, wrench.copy()), equilibrium)
        except SolveError as error:
            problems.append(f'{number}: {error}')
            equilibrium = None
            continue
        if not is_stable(rod, equilibrium):
            problems.append(f'{number}: unstable')
    assert problems == []


@LAWS
@pytest.mark.parametrize('part', [0.0, 0.1, pytest.param(0.2, marks=pytest.mark.endurance)])
def test_upright_arm_falls_to_a_stable_shape(table4, law, part):
    # The energy is nearly the same for all directions around the vertical.
    rod = Rod(
        table4.arm.with_density(1080.0),
        Loads(gravity=(-9.81, 0.0, 0.0)),
        setting=Setting(law == 'neo_hookean'),
    )
    equilibrium = rod.solve(Condition(part * np.repeat([1.0, 2.0, 3.0], 4), NOTHING))
    assert is_stable(rod, equilibrium)
    tip = rod.readout(equilibrium.level, np.array([0.0, 0.45])).read(equilibrium.state)[0][-1]
    assert tip[0] < -0.1 and 0.05 < np.hypot(tip[1], tip[2]) < 0.2
