"""Loaded arms whose tendons have friction, led from balances that are known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helical_arm import PULL, helical_arm
from sliding_arms import assert_same

from octo_arm_model import Arm, Backbone, Loads, Solver
from octo_arm_model.config.config import load_config
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.known_balance import KnownBalance, margin_under
from octo_arm_model.core.loaded.linearised import Linearised
from octo_arm_model.core.loaded.settle import Settling
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.rod.solution import Shape

AIR = Loads(gravity=(0.0, 0.0, -9.81))
MU = (0.1, 0.2, 0.3, 0.1, 0.0, 0.2)
ROUGH = helical_arm(friction=MU)
IN_SHEATHS = helical_arm(friction=MU, sheath_stiffness=(3e5, 5e5, 0.0, 4e5, 2e5, 6e5))


def known_of(solver: Solver) -> Settling:
    assert isinstance(solver._statics, Exact)
    settle = solver._statics._rod(0).settle
    assert isinstance(settle, Settling)
    return settle


def movement(steps: int) -> list[tuple[FloatArray, FloatArray]]:
    """Tensions and wrenches on the tip: drawn in, let out, slack, taken up, pushed."""
    random, moved = np.random.default_rng(4), []
    tensions, wrench = 0.5 * PULL, np.zeros(6)
    for step in range(steps):
        size = (1e-4, 3e-3, 0.03)[step % 3]
        tensions = tensions * (1.0 + size * random.normal(size=PULL.shape))
        if step == steps // 3:
            tensions = tensions * np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
        if step == steps // 2:
            tensions = np.maximum(tensions, 0.1)
        if step % 5 == 4:
            wrench = wrench + 1e-3 * random.normal(size=6) * np.array([1, 1, 1, 0.01, 0.01, 0.01])
        moved.append((tensions, wrench))
    return [*moved, (0.0 * PULL, wrench)]


@pytest.mark.parametrize(
    ('arm', 'options'),
    [
        pytest.param(ROUGH, {}, id='rubber'),
        pytest.param(IN_SHEATHS, {}, id='sheaths'),
        pytest.param(ROUGH, {'material': 'linear', 'shear': True}, id='shear'),
    ],
)
def test_an_arm_is_the_same_whether_balances_before_are_known_or_not(
    arm: Arm, options: dict[str, object]
) -> None:
    """Where nothing is known shape and tensions are found at once, by the exact Jacobian."""
    near = Solver(arm, 'exact', 31, loads=AIR, compiled=False, **options)
    anew = Solver(arm, 'exact', 31, loads=AIR, compiled=False, **options)
    one: Backbone | None = None
    other: Backbone | None = None
    fewer = 0
    for tensions, wrench in movement(18):
        one = near.follow(tensions, one, wrench)
        known_of(anew)._kept.__init__()  # type: ignore[misc]
        other = anew.follow(tensions, other, wrench)
        assert_same(one, other, arm.length)
        assert one.residual <= 1e-11
        fewer += one.iterations <= other.iterations
    assert fewer > 12


def test_small_steps_take_no_more_iterations_than_without_friction() -> None:
    arm = load_config('renda2012_table4').arm
    rough = dataclasses.replace(arm, friction=(0.1,))
    tensions = np.full(arm.tension_shape, 0.4)
    wrench = (0.005, 0.0, 0.0, 0.0, 0.0, 0.0)
    solvers = [Solver(one, 'exact', 31, compiled=False) for one in (rough, arm)]
    last = [solver.solve(tensions, wrench) for solver in solvers]
    for part in (1.002, 1.004, 1.001, 0.999):
        last = [solver.follow(part * tensions, one, wrench) for solver, one in zip(solvers, last)]
        assert last[0].iterations <= last[1].iterations + 1


@pytest.mark.parametrize('arm', [ROUGH, IN_SHEATHS], ids=['held', 'in sheaths'])
@pytest.mark.parametrize('is_let_go', [False, True])
def test_a_balance_under_more_tension_is_as_if_evaluated(arm: Arm, is_let_go: bool) -> None:
    solver = Solver(arm, 'exact', 31, loads=AIR, compiled=False)
    assert isinstance(solver._statics, Exact)
    found = solver.solve(PULL)
    rod, balanced, shape = solver._statics._balance_of(found)
    problem, wrench = rod.equilibrium, balanced.tip_wrench
    before = problem.state(balanced, shape)
    others = 1.01 * PULL.reshape(1, -1)
    others[0, 1] *= not is_let_go
    condition = Condition(others, wrench[np.newaxis], 1.0, found.point_tensions)
    system = problem.linearised(before)
    assert isinstance(system, Linearised)
    known = KnownBalance(problem, before, system, margin_under(wrench, is_firm=False))
    tendons = known.tendons_under(condition)
    assert tendons is not None and tendons.friction.pull.sum() == 6 - is_let_go
    a, b = (part[np.newaxis] for part in shape.orientation)
    one = Shape(shape.twist[:, np.newaxis], type(shape.orientation)(a, b))
    state = known.under(condition, one, tendons)
    assert state is not None and state.sliding is not None
    expected = problem.state(condition, one, sliding=state.sliding)
    np.testing.assert_allclose(state.residual, expected.residual, atol=2e-11)
    scale = np.abs(expected.imbalance).max()
    np.testing.assert_allclose(state.imbalance, expected.imbalance, atol=1e-9 * scale)
