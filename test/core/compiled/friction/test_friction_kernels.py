"""Friction of tendons in machine code: Capstan's law, the shapes of NumPy, and its history."""

from __future__ import annotations

import dataclasses
import itertools
import math
import types

import numpy as np
import pytest
from helical_arm import PULL, helical_arm
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sliding_arms import assert_pulled_alike, assert_same
from strategies import fractions, loaded_arms

from octo_arm_model import (
    Arm,
    Body,
    Config,
    Loads,
    Material,
    PointLoad,
    Section,
    SolveError,
    Solver,
)
from octo_arm_model.config.config import load_config
from octo_arm_model.core.compiled.compiled_rod import state_of
from octo_arm_model.core.compiled.friction.sliding_kernels import SQUARED
from octo_arm_model.core.compiled.loaded.rod_state import empty_state, rod_work
from octo_arm_model.core.compiled.loaded.state_kernels import find_state
from octo_arm_model.core.compiled.numba_build import is_available
from octo_arm_model.core.budget import Budget
from octo_arm_model.core.loaded.continuation import TOLERANCE
from octo_arm_model.core.loaded.read_out import read_out
from octo_arm_model.core.loaded.sliding import sliding_balance
from octo_arm_model.core.models import loaded_exact
from octo_arm_model.core.models.exact import Exact

pytestmark = pytest.mark.skipif(not is_available(), reason='numba is not installed')
MODELS = ('closed_form', 'exact')


@pytest.mark.parametrize('material', ['linear', 'neo_hookean'])
@pytest.mark.parametrize('model', MODELS)
def test_machine_code_pulls_and_releases_as_numpy_does(model: str, material: str) -> None:
    arm = helical_arm(friction=tuple(np.linspace(0.05, 0.4, 6).tolist()))
    machine, plain = (
        Solver(arm, model, material=material, compiled=compiled) for compiled in (True, False)
    )
    assert_pulled_alike(machine, plain, (1.0, 0.7, 0.75, 0.2, 0.0, 0.4))


@pytest.mark.parametrize('compiled', [False, True])
@pytest.mark.parametrize('model', MODELS)
def test_a_movement_does_not_depend_on_what_is_kept_of_the_balance_before(
    model: str, compiled: bool
) -> None:
    """Followed by one solver, and by another that knows of each backbone no more than it has."""
    arm = helical_arm(friction=tuple(np.linspace(0.05, 0.4, 6).tolist()))
    solver = Solver(arm, model, compiled=compiled)
    backbone = solver.solve(PULL)
    for part in (1.003, 1.006, 1.0, 0.9, 0.9, 0.91, 1.1, 0.3, 0.301):
        expected = Solver(arm, model, compiled=compiled).follow(part * PULL, backbone)
        backbone = solver.follow(part * PULL, backbone)
        assert_same(backbone, expected, arm.length)
        assert backbone.residual <= SQUARED


@pytest.mark.parametrize('sheath', [0.0, 7.0])
def test_a_small_movement_takes_few_steps_for_sections_and_tensions_together(
    sheath: float,
) -> None:
    arm = load_config('renda2012_prototype').arm
    stiffness = (sheath * arm.material.shear_modulus,) if sheath else ()
    rough = dataclasses.replace(arm, friction=(0.1,), sheath_stiffness=stiffness)
    solver, pull = Solver(rough, 'exact', compiled=True), np.array([[2.0, 0.5, 0.0, 0.0]])
    backbone = solver.solve(pull)
    for part in (1.0005, 1.001, 1.0015):
        backbone = solver.follow(part * pull, backbone)
        assert backbone.iterations <= 2
        assert backbone.residual <= SQUARED


@settings(max_examples=20, deadline=None)
@given(loaded_arms(3), fractions(0.01, 0.6), fractions(0.0, 1.0), st.sampled_from(MODELS))
def test_machine_code_follows_any_arm_as_numpy_does(
    case: tuple[Arm, np.ndarray], friction: float, part: float, model: str
) -> None:
    arm, tensions = case
    rough = dataclasses.replace(arm, friction=(friction,))
    plain = Solver(rough, model, 41)
    try:
        pulled = plain.solve(tensions)
        released = plain.follow(part * tensions, pulled)
    except SolveError:
        assume(False)
    machine = Solver(rough, model, 41, compiled=True)
    assert_same(machine.solve(tensions), pulled, arm.length)
    assert_same(machine.follow(part * tensions, pulled), released, arm.length)


@pytest.mark.parametrize('compiled', [False, True])
def test_tensions_of_a_movement_foretold_well_are_as_near_as_others(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first step leaves 1e-4 of what there was, which the next one does not."""
    angles = tuple(0.5 * math.pi * turn for turn in range(4))
    sections = (
        Section(1.0, 0.03125, 0.015625, angles=angles),
        Section(0.6, 0.03125, 0.015625, angles=angles),
    )
    arm = Arm(Material(1e4, 0.0), Body(1.0, 0.0625, 0.0625), sections, friction=(0.28125,))
    tensions = np.array([[0.0, 0.0, 16.1, 0.0], [16.1, 0.0, 10.74, 0.0]])
    pulled = Solver(arm, 'exact', 41).solve(tensions)
    released = Solver(arm, 'exact', 41, compiled=compiled).follow(0.90625 * tensions, pulled)
    monkeypatch.setattr(sliding_balance, 'TOLERANCE', 1e-13)
    expected = Solver(arm, 'exact', 41).follow(0.90625 * tensions, pulled)
    np.testing.assert_allclose(
        released.tendon_tensions, expected.tendon_tensions, rtol=0.0, atol=1e-9 * 16.1
    )


def test_one_parallel_tendon_is_that_of_the_closed_form() -> None:
    young, radius, length, offset, mu, pull = 1e5, 0.01, 0.4, 0.006, 0.3, 3.0
    arm = Arm(
        Material(young, 0.5), Body(length, radius, radius),
        (Section(length, offset, offset, angles=(0.0,)),), friction=(mu,),
    )  # fmt: skip
    backbone = Solver(arm, 'exact', material='linear', compiled=True).solve([[pull]])
    slope = mu * offset / (young * math.pi * radius**4 / 4)
    expected = 1.0 / (1.0 / pull + slope * backbone.s)
    np.testing.assert_allclose(backbone.tendon_tensions[:, 0], expected, rtol=1e-7)


@pytest.mark.parametrize('model', MODELS)
def test_a_batch_is_its_arms_one_by_one(table4: Config, model: str) -> None:
    arm = dataclasses.replace(table4.arm, friction=12 * (0.2,))
    solver = Solver(arm, model, compiled=True)
    rng = np.random.default_rng(1)
    several = rng.uniform(0.0, 0.2, (5, 3, 4)) * rng.integers(0, 2, (5, 3, 4))
    last = solver.solve(1.2 * several[0])
    batch = solver.follow(several, last)
    for number, tensions in enumerate(several):
        one = solver.follow(tensions, last)
        for name in ('position', 'tendon_tensions'):
            found, expected = getattr(batch, name)[number], getattr(one, name)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('model', MODELS)
def test_derivatives_of_what_machine_code_has_found(model: str) -> None:
    arm = helical_arm(friction=6 * (0.2,))
    found = Solver(arm, model, 41, compiled=True)
    plain = Solver(arm, model, 41)
    got = found.sensitivity(found.solve(PULL)).by_tension.pose
    expected = plain.sensitivity(plain.solve(PULL)).by_tension.pose
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())


def test_where_machine_code_fails_numpy_says_why(table4: Config) -> None:
    arm = dataclasses.replace(table4.arm, friction=12 * (0.2,))
    solver = Solver(arm, 'closed_form', compiled=True)
    with pytest.raises(SolveError, match='compress the arm to nothing'):
        solver.solve(np.full((3, 4), 50.0))


# Under loads ------------------------------------------------------------------------------------


@pytest.mark.parametrize('material', ['linear', 'neo_hookean'])
def test_machine_code_pulls_and_releases_under_loads_as_numpy_does(material: str) -> None:
    arm = helical_arm(friction=(0.05, 0.4, 0.2, 0.0, 0.3, 0.1))
    loads = Loads(gravity=(0.0, 0.0, -9.81), points=(PointLoad(0.2, force=(0.01, 0.02, 0.0)),))
    machine, plain = (
        Solver(arm, 'exact', 41, material=material, loads=loads, compiled=compiled)
        for compiled in (True, False)
    )
    one = other = None
    for part in (1.0, 0.7, 0.75, 0.2, 0.0, 0.4):
        one, other = machine.follow(part * PULL, one), plain.follow(part * PULL, other)
        assert_same(one, other, arm.length)
        one, other = other, one
    wrench = [0.0, 0.01, 0.01, 0.0, 0.0, 0.0]
    one, other = (
        solver.follow(PULL, last, wrench) for solver, last in ((machine, one), (plain, one))
    )
    assert_same(one, other, arm.length)


def test_a_movement_under_loads_is_followed_without_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = helical_arm(friction=(0.2,))
    machine, plain = (Solver(arm, 'exact', 41, compiled=compiled) for compiled in (True, False))
    wrench = [0.0, 0.01, 0.01, 0.0, 0.0, 0.0]
    one = machine.solve(PULL, wrench)
    parts = 1.0 + 0.02 * np.sin(np.arange(8.0))
    expected, other = [], one
    for part in parts:
        other = plain.follow(part * PULL, other, wrench)
        expected.append(other)
    monkeypatch.setattr(loaded_exact, 'follow', None)
    for part, other in zip(parts, expected):
        one = machine.follow(part * PULL, one, wrench)
        assert_same(one, other, arm.length)
        assert one.residual <= Budget().residual
        assert one.iterations <= 5


@pytest.mark.parametrize('sheath', [(), (3e5,)])
def test_residuals_of_steps_that_are_not_evaluated_are_bounded(sheath: tuple[float, ...]) -> None:
    arm = helical_arm(friction=(0.2,), sheath_stiffness=sheath)
    solver, wrench = Solver(arm, 'exact', 41, compiled=True), np.zeros(6)
    wrench[1:3] = 0.01
    last, random = solver.solve(PULL, wrench), np.random.default_rng(3)
    assert isinstance(solver._statics, Exact) and last.shape is not None
    rod = solver._statics._rod(solver._statics.rods.level_of(last.shape.twist))
    assert isinstance(rod.settle, types.MethodType)
    tables, bounded = rod.settle.__self__.tables, 0
    for size in np.geomspace(1e-6, 0.05, 24):
        tensions = PULL * (1.0 + size * random.uniform(-1.0, 1.0, PULL.shape))
        last = solver.follow(tensions, last, wrench)
        assert last.shape is not None and last.point_tensions is not None
        tables.sections.transmission[:] = last.point_tensions
        state = state_of(last.shape, empty_state(rod.points)[1:])
        held = np.sign(tensions.ravel())
        work = rod_work(held, rod.points, tables.elements.step.size, 0)
        evaluated = find_state(tables, held, wrench, 1.0, state, work)
        # Rounding alone leaves a little.
        assert evaluated <= last.residual + 1e-12
        bounded += evaluated < 0.9 * last.residual
    assert bounded > 1


def test_small_movements_are_made_by_the_system_before_until_they_add_up() -> None:
    arm = dataclasses.replace(load_config('renda2012_prototype').arm, friction=(0.1,))
    pull, wrench = np.array([[2.0, 0.5, 0.0, 0.0]]), [0.005, 0.0, 0.0, 0.0, 0.0, 0.0]
    solver = Solver(arm, 'exact', 41, compiled=True)
    found = solver.solve(pull, wrench)
    assert isinstance(solver._statics, Exact) and found.shape is not None
    rod = solver._statics._rod(solver._statics.rods.level_of(found.shape.twist))
    assert isinstance(rod.settle, types.MethodType)
    systems = []
    for part in np.linspace(1.0, 1.1, 400):
        found = solver.follow(part * pull, found, wrench)
        assert found.shape is not None
        known = rod.settle.__self__.known_about(found.shape)
        assert known.turned <= 0.1 and known.changed <= 0.02
        systems.append(known.system)
    new = np.count_nonzero([a is not b for a, b in itertools.pairwise(systems)])
    assert 3 <= new < 200
    assert_same(found, Solver(arm, 'exact', 41).solve(1.1 * pull, wrench), arm.length)


@settings(max_examples=6, deadline=None)
@given(loaded_arms(2), fractions(0.01, 0.6), fractions(0.0, 1.0), fractions(-1.0, 1.0))
def test_machine_code_follows_any_arm_under_loads_as_numpy_does(
    case: tuple[Arm, np.ndarray], friction: float, part: float, pushed: float
) -> None:
    arm, tensions = case
    rough = dataclasses.replace(arm, friction=(friction,))
    force = 0.3 * pushed * float(np.max(tensions)) * np.array([0.1, 1.0, -0.5])
    plain = Solver(rough, 'exact', 41)
    try:
        pulled = plain.solve(tensions, [*force, 0.0, 0.0, 0.0])
        released = plain.follow(part * tensions, pulled, [*force, 0.0, 0.0, 0.0])
    except SolveError:
        assume(False)
    machine = Solver(rough, 'exact', 41, compiled=True)
    assert_same(machine.solve(tensions, pulled.tip_wrench), pulled, arm.length)
    assert_same(machine.follow(part * tensions, pulled, pulled.tip_wrench), released, arm.length)


def test_derivatives_under_loads_of_what_machine_code_has_found() -> None:
    arm = helical_arm(friction=6 * (0.2,))
    wrench = [0.01, 0.0, 0.02, 0.0, 0.0, 0.0]
    found, plain = (Solver(arm, 'exact', 41, compiled=compiled) for compiled in (True, False))
    got, expected = (
        solver.sensitivity(solver.solve(PULL, wrench)).by_friction for solver in (found, plain)
    )
    assert got is not None and expected is not None
    np.testing.assert_allclose(got.pose, expected.pose, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize('sheath', [(), (3e5,)])
def test_balances_are_read_out_as_by_numpy(sheath: tuple[float, ...]) -> None:
    """Also after machine code has balanced others."""
    solver = Solver(helical_arm(friction=(0.2,), sheath_stiffness=sheath), 'exact', compiled=True)
    wrench = [0.0, 0.01, 0.01, 0.0, 0.0, 0.0]
    backbone = solver.solve(PULL, wrench)
    assert isinstance(solver._statics, Exact)
    rod, condition, shape = solver._statics._balance_of(backbone)
    state = rod.newton(condition, shape, TOLERANCE).state
    solver.solve(0.5 * PULL, wrench)
    for found, expected in zip(rod.read_out(state), read_out(rod, state)):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
