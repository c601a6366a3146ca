"""Whether a balance is seen to be one of least energy, and what it is refused for."""

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
    part = [
        refusal(COLUMN, 4 * [pull * AXIAL], is_loaded, 'neo_hookean') for pull in (150.0, 250.0)
    ]
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


# Hard sets: arms from nothing, columns, and random walks; all of them in the tests of endurance --


NOTHING = np.zeros(6)
LAWS = pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
# Part of the stiffness of the sections that may be missing where an arm may turn about a vertical.
NEUTRAL = -1e-6


def family_of(sets: int, seed: int = 2012) -> Iterator[FloatArray]:
    """Random tensions (12,) of the arm of Table 4 [N], as large as its sections bear."""
    random, largest = np.random.default_rng(seed), np.array([0.5, 4.0, 13.0])[:, np.newaxis]
    for _ in range(sets):
        shares = random.uniform(size=(3, 4)) * random.integers(0, 2, (3, 4))
        given = largest * shares / np.maximum(1.0, shares.sum(axis=1, keepdims=True))
        yield given.ravel()


def columns() -> Iterator[tuple[FloatArray, float]]:
    """312 forces (3,) over Euler's load: 13 along, 6 aside in 4 directions; and the one aside."""
    along = (0.9, 1.0, 1.02, 1.1, 1.3, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 9.5)
    asides = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1)
    for part, aside, angle in itertools.product(along, asides, (0.0, 0.3, 2.0, 4.4)):
        yield np.array([-part, aside * math.cos(angle), aside * math.sin(angle)]), angle


def is_stable(rod: Rod, found: Equilibrium) -> bool:
    """Whether the system at the equilibrium itself says so."""
    least = judge(rod.problem(found.level), found.state).variation.softest()[0]
    return bool(least > NEUTRAL and found.state.residual <= 1e-7)


def refused(rod: Rod, family: Iterator[FloatArray], wrench: FloatArray = NOTHING) -> list[str]:
    """What is refused of a ``family`` of tensions from nothing, or is unstable."""
    problems = []
    for number, tensions in enumerate(family):
        try:
            found = rod.solve(Condition(tensions, wrench))
        except SolveError as error:
            problems.append(f'{number}: {error}')
            continue
        if not is_stable(rod, found):
            problems.append(f'{number}: unstable')
    return problems


@LAWS
@pytest.mark.parametrize(
    'direction',
    [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)],
    ids=['level', 'hanging', 'upright'],
)
@pytest.mark.parametrize('sets', [8, pytest.param(1525, marks=pytest.mark.endurance)])
def test_arms_in_air_are_balanced_from_nothing(table4, law, direction, sets):
    x, y, z = direction
    loads = Loads(gravity=(9.81 * x, 9.81 * y, 9.81 * z))
    rod = Rod(table4.arm.with_density(1080.0), loads, setting=Setting(law == 'neo_hookean'))
    assert refused(rod, family_of(sets)) == []


@pytest.mark.parametrize('sets', [8, pytest.param(1000, marks=pytest.mark.endurance)])
@pytest.mark.parametrize('force', [(0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (0.0, -0.1, 0.0)])
def test_the_metal_rod_is_balanced_under_any_tensions(force, sets):
    random = np.random.default_rng(2021)
    rod = Rod(METAL, setting=Setting(law=LINEAR))
    family = iter(random.uniform(0.0, 6.0, (sets, 6)))
    assert refused(rod, family, np.array([*force, 0.0, 0.0, 0.0])) == []


@LAWS
@pytest.mark.parametrize('every', [26, pytest.param(1, marks=pytest.mark.endurance)])
def test_columns_fall_to_the_side_that_they_are_pushed_to(law, every):
    rod, problems = Rod(COLUMN, setting=Setting(law == 'neo_hookean')), []
    for number, (force, angle) in enumerate(itertools.islice(columns(), 0, None, every)):
        wrench = np.array([*(EULER * force), 0.0, 0.0, 0.0])
        try:
            found = rod.solve(Condition(np.zeros(4), wrench))
        except SolveError as error:
            problems.append(f'{number}: {error}')
            continue
        s = np.array([0.0, COLUMN.length])
        tip = rod.readout(found.level, s).read(found.state)[0][-1]
        aside = float(tip[1] * math.cos(angle) + tip[2] * math.sin(angle))
        least = 0.1 * COLUMN.length if -force[0] > 1.05 else 0.0
        if not (is_stable(rod, found) and aside > least):
            problems.append(f'{number}: {force} leads to {tip}')
    assert problems == []


@pytest.mark.parametrize('pace', [0.05, 0.3, 1.0])
@pytest.mark.parametrize('gravity', [(0.0, 0.0, -9.81), (-9.81, 0.0, 0.0)], ids=['level', 'up'])
@pytest.mark.parametrize('steps', [15, pytest.param(1000, marks=pytest.mark.endurance)])
def test_a_random_walk_stays_on_stable_balances(table4, pace, gravity, steps):
    rod = Rod(table4.arm.with_density(1080.0), Loads(gravity=gravity))
    random, found, problems = np.random.default_rng(7), None, []
    largest = np.repeat([0.2, 1.5, 5.0], 4)
    tensions = 0.3 * largest * random.uniform(size=12)
    wrench = np.zeros(6)
    for number in range(steps):
        step = pace * largest * random.standard_normal(12)
        tensions = np.clip(np.abs(tensions + 0.2 * step), 0.0, largest)
        wrench[:3] = 0.9 * wrench[:3] + 0.005 * pace * random.standard_normal(3)
        try:
            found = rod.solve(Condition(tensions, wrench.copy()), found)
        except SolveError as error:
            problems.append(f'{number}: {error}')
            found = None
            continue
        if not is_stable(rod, found):
            problems.append(f'{number}: unstable')
    assert problems == []


@LAWS
@pytest.mark.parametrize('part', [0.0, 0.1, pytest.param(0.2, marks=pytest.mark.endurance)])
def test_an_upright_arm_may_fall_to_any_side(table4, law, part):
    # Energy is level all around the vertical, but for little that four tendons add.
    rod = Rod(
        table4.arm.with_density(1080.0),
        Loads(gravity=(-9.81, 0.0, 0.0)),
        setting=Setting(law == 'neo_hookean'),
    )
    found = rod.solve(Condition(part * np.repeat([1.0, 2.0, 3.0], 4), NOTHING))
    assert is_stable(rod, found)
    tip = rod.readout(found.level, np.array([0.0, 0.45])).read(found.state)[0][-1]
    assert tip[0] < -0.1 and 0.05 < np.hypot(tip[1], tip[2]) < 0.2
