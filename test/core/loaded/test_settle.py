"""Loaded arms are balanced together as they are alone, and near known balances as from afar."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helical_arm import HELICAL, helical_arm

from octo_arm_model import Arm, Backbone, Config, Loads, PointLoad, SolveError, Solver
from octo_arm_model.core.hints import Number
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.known_balance import KnownBalance, margin_under
from octo_arm_model.core.loaded.linearised import Linearised, Response
from octo_arm_model.core.loaded.settle import Settling
from octo_arm_model.core.loaded.sliding.friction import Sliding
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape, Solution

AIR = Loads(gravity=(0.0, 0.0, -9.81))
WATER = dataclasses.replace(AIR, fluid_density=1000.0)
# A moment that keeps its direction has no energy.
MOMENT = dataclasses.replace(WATER, tip_moment=(1e-5, 2e-5, -1e-5))
HIGHEST = np.array([0.5, 4.0, 13.0])[:, np.newaxis]


def assert_one_by_one(solver: Solver, together: Backbone, start: Backbone | None) -> None:
    """Every arm of a batch is the same to rounding when it is solved alone."""
    for number, tensions in enumerate(together.tensions):
        alone = solver.solve(tensions, together.tip_wrench[number] - solver._wrench, start)
        np.testing.assert_allclose(together.position[number], alone.position, atol=1e-12)
        np.testing.assert_allclose(together.quaternion[number], alone.quaternion, atol=1e-12)
        for name in ('tau', 'xi', 'k', 'q'):
            a, b = getattr(together, name)[number], getattr(alone, name)
            np.testing.assert_allclose(a, b, atol=1e-11 * max(1.0, np.abs(b).max()))


@pytest.mark.parametrize('is_warm', [False, True])
@pytest.mark.parametrize('loads', [AIR, WATER, MOMENT], ids=['air', 'water', 'moment'])
def test_an_arm_is_the_same_alone_and_in_a_batch(
    table4: Config, loads: Loads, is_warm: bool
) -> None:
    solver = Solver(
        table4.arm.with_density(1080.0), 'exact', 31, table4.base, loads=loads, compiled=False
    )
    random = np.random.default_rng(7)
    tensions = 0.6 * HIGHEST * random.uniform(size=(3, 4)) * np.array([1.0, 0.0, 0.0, 1.0])
    start = solver.solve(tensions) if is_warm else None
    # More than are iterated together, and changes of all sizes: they do not go the same way.
    change = 0.2 * np.linspace(0.0, 1.0, 20)[:, np.newaxis, np.newaxis]
    batch = tensions + change * HIGHEST * random.uniform(size=(20, 3, 4))
    together = solver.solve(batch, start=start)
    assert (together.residual <= 1e-11).all()
    assert_one_by_one(solver, together, start)
    assert isinstance(solver._statics, Exact)
    wrenches = np.broadcast_to(solver._wrench, (20, 6))
    with np.errstate(invalid='ignore'):  # as for every solve
        settled = solver._statics._loaded.settle_all(batch.reshape(20, 12), wrenches, start)
    if is_warm:
        assert sum(isinstance(one, Solution) for one in settled) > 10


@pytest.mark.parametrize(
    ('loads', 'friction'),
    [(AIR, ()), (WATER, (0.1,)), (MOMENT, ())],
    ids=['air', 'water, rough', 'moment'],
)
def test_an_estimated_residual_is_no_less_than_the_evaluated_one(
    table4: Config, loads: Loads, friction: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    last_state, found = Equilibrium.last_state, []

    def evaluated(
        self: Equilibrium, state: State, change: Response, residual: Number,
        sliding: Sliding | None = None,
    ) -> State:  # fmt: skip
        estimated = last_state(self, state, change, residual, sliding)
        # With orientations that follow from the twist alone.
        moved = self.moved(state.shape, change)
        found.append((estimated, self.state(state.condition, moved, sliding=sliding)))
        return estimated

    monkeypatch.setattr(Equilibrium, 'last_state', evaluated)
    arm = dataclasses.replace(table4.arm.with_density(1080.0), friction=friction)
    solver = Solver(arm, 'exact', 31, table4.base, loads=loads, compiled=False)
    random = np.random.default_rng(9)
    for size in np.geomspace(1e-6, 0.1, 24):
        tensions = 0.5 * HIGHEST * random.uniform(size=(3, 4)) * np.array([1.0, 0.0, 0.0, 1.0])
        start = solver.solve(tensions)
        solver.solve(tensions + size * HIGHEST * random.uniform(size=(3, 4)), start=start)
    assert len(found) > 5
    for estimated, expected in found:
        # Rounding alone leaves a little.
        assert (expected.residual <= estimated.residual + 1e-12).all()
        for name in ('rotation', 'tangent', 'force'):
            a, b = getattr(estimated, name), getattr(expected, name)
            np.testing.assert_allclose(a, b, atol=1e-11 * max(1.0, np.abs(b).max()))
        scale = np.abs(expected.moment).max()
        np.testing.assert_allclose(estimated.moment, expected.moment, atol=1e-11 * scale)


def test_a_balance_under_more_tension_is_as_if_evaluated(table4: Config) -> None:
    hanging = table4.arm.with_density(1080.0)
    for solver, tensions in (
        (
            Solver(HELICAL, 'exact', 31, material='linear', shear=True, loads=AIR, compiled=False),
            np.full(6, 0.3),
        ),
        (
            Solver(hanging, 'exact', 31, table4.base, loads=WATER, compiled=False),
            np.repeat([0.1, 1.0, 3.0], 4),
        ),
        (
            Solver(helical_arm(sheath_stiffness=(3e5,)), 'exact', 31, loads=AIR, compiled=False),
            np.full(6, 0.3),
        ),
    ):
        tensions[1] = 0.0
        assert isinstance(solver._statics, Exact)
        found = solver.solve(tensions.reshape(solver.arm.tension_shape))
        rod, balanced, shape = solver._statics._balance_of(found)
        problem, wrench = rod.equilibrium, balanced.tip_wrench
        before = problem.state(balanced, shape)
        # Taken up, let go, and pulled more.
        others = np.array([np.full_like(tensions, 0.2), 0.0 * tensions, 1.1 * tensions])
        condition = Condition(others, np.broadcast_to(wrench, (3, 6)), 1.0)
        a, b = (part[np.newaxis].repeat(3, axis=0) for part in shape.orientation)
        three = Shape(shape.twist[:, np.newaxis].repeat(3, axis=1), Quaternions(a, b))
        system = problem.linearised(before)
        assert isinstance(system, Linearised)
        known = KnownBalance(problem, before, system, margin_under(wrench, is_firm=False))
        state = known.under(condition, three)
        expected = problem.state(condition, three)
        assert state is not None
        assert (np.abs(state.residual - expected.residual) < 2e-11).all()
        for name in ('rotation', 'tangent', 'moment', 'force', 'imbalance'):
            a, b = getattr(state, name), getattr(expected, name)
            np.testing.assert_allclose(a, b, atol=1e-10 * np.abs(b).max())


def test_wrenches_of_each_arm_are_its_own() -> None:
    solver = Solver(HELICAL, 'exact', 31, material='linear', shear=True, compiled=False)
    random = np.random.default_rng(8)
    tensions = random.uniform(0.0, 1.0, (6, 2, 3))
    wrenches = random.normal(size=(6, 6)) * (3 * [0.02] + 3 * [2e-4])
    wrenches[2:, 3:] = 0.0  # some with an energy, some without
    assert_one_by_one(solver, solver.solve(tensions, wrenches), None)


def test_an_arm_without_balance_is_named_and_spoils_no_other(table4: Config) -> None:
    solver = Solver(
        table4.arm.with_density(1080.0), 'exact', 31, table4.base, loads=WATER, compiled=False
    )
    tensions = np.tile(0.1 * HIGHEST * np.array([1.0, 0.0, 0.0, 1.0]), (5, 1, 1))
    expected = solver.solve(tensions[0])
    tensions[3] = 1000.0 * HIGHEST
    with pytest.raises(SolveError, match='in set 3'):
        solver.solve(tensions)
    with pytest.raises(SolveError, match='in set 3'):
        solver.solve(tensions, start=expected)
    tensions[3] = 0.0
    found = solver.solve(tensions, start=expected)
    np.testing.assert_allclose(found.position[4], expected.position, atol=1e-11)


def test_an_impossible_start_spreads_to_no_other_arm(table4: Config) -> None:
    solver = Solver(
        table4.arm.with_density(1080.0), 'exact', 31, table4.base, loads=WATER, compiled=False
    )
    assert isinstance(solver._statics, Exact)
    rod = solver._statics._rod(0)
    tensions = np.tile(0.1 * HIGHEST * np.array([1.0, 0.0, 0.0, 1.0]), (5, 1, 1)).reshape(5, 12)
    shape = rod.near_unloaded(tensions)
    shape.twist[3, 1] = -1.0
    assert isinstance(rod.settle, Settling)
    with np.errstate(invalid='ignore'):
        found = rod.settle.settle_all(Condition(tensions, np.zeros((5, 6)), 1.0), shape)
    assert [one is not None for one in found] == [True, False, True, True, True]


@pytest.mark.parametrize('part', [1.0, 1.001, 1.03, 1.3, 0.3])
@pytest.mark.parametrize(
    'arm', [HELICAL, dataclasses.replace(HELICAL, sheath_stiffness=(4e5,) * 6)]
)
def test_a_step_from_the_last_balance_ends_where_one_from_its_copy_does(
    arm: Arm, part: float
) -> None:
    # What was factorised for the last balance makes the first step from it alone.
    loads = Loads(gravity=(0.0, 2.0, -5.0), points=(PointLoad(0.2, (0.0, 0.01, 0.0)),))
    solver = Solver(arm, 'exact', 31, loads=loads, compiled=False)
    tensions = np.linspace(0.1, 0.6, 6).reshape(2, 3)
    last = solver.solve(tensions)
    assert last.shape is not None
    copy = dataclasses.replace(last, shape=last.shape._replace(twist=last.shape.twist.copy()))
    one, other = (solver.solve(part * tensions, start=start) for start in (last, copy))
    np.testing.assert_allclose(one.position, other.position, atol=1e-11)
    np.testing.assert_allclose(one.k, other.k, atol=1e-9)
