"""Machine code sees whether a balance of a loaded rod is one of least energy."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Loads, Material, PointLoad, Section, Solver
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import TipAnswer
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.stability import stability_of
from octo_arm_model.core.loaded.state import Condition, Stability, State
from octo_arm_model.core.models.exact import Exact

pytest.importorskip('numba')

COLUMN = Arm(Material(1e5), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
EULER = 1e5 * np.pi**3 * 0.01**4 / (16.0 * 0.4**2)  # [N], of a column that is held at its base


@pytest.mark.parametrize('part', [0.5, 0.98, 1.02, 5.0, 26.0, 38.0, 42.0])
def test_a_straight_column_is_one_of_least_energy_below_eulers_load(part: float) -> None:
    # Beyond it bends in two planes are unstable at once, which leaves the sign of the determinant.
    rod = _loaded_rod('linear')
    shape = rod.unloaded(np.zeros(4))
    tangent = rod.equilibrium.state(_under(np.zeros(4), np.zeros(3)), shape).tangent[:, 0]
    condition = _under(np.zeros(4), -part * EULER * tangent)
    found = rod.newton(condition, shape, 1e-11)
    assert found.state.residual <= 1e-11
    assert isinstance(found.system, Stability if part < 1.0 else TipAnswer)
    stability = stability_of(rod.equilibrium, found.state, found.system)
    assert (
        stability.is_stable == stability_of(rod.equilibrium, found.state).is_stable == (part < 1.0)
    )


@pytest.mark.parametrize('seed', range(4))
def test_least_energy_is_seen_where_the_whole_second_variation_is_positive(seed: int) -> None:
    random = np.random.default_rng(seed)
    rod = _loaded_rod('neo_hookean')
    problem, seen, missed = rod.equilibrium, [0, 0], 0
    for _ in range(40):
        tensions = random.uniform(0.0, 1.0) * random.uniform(0.0, 1.5, 4)
        shape = rod.unloaded(tensions)
        tangent = problem.state(_under(tensions, np.zeros(3)), shape).tangent[:, -1]
        # From 3 to 300 % of Euler's load, against the tip of arms that tendons bend.
        force = -EULER * 10.0 ** random.uniform(-1.5, 0.5) * tangent
        condition = _under(tensions, force + 0.3 * EULER * random.normal(size=3))
        is_least = isinstance(rod.newton(condition, shape, np.inf).system, Stability)
        is_positive = _is_positive(problem, problem.state(condition, shape))
        assert is_positive or not is_least
        missed += is_positive and not is_least
        seen[is_positive] += 1
    assert missed <= 1 and min(seen) >= 5, seen


def test_instability_is_seen_where_it_is_come_upon_in_small_steps() -> None:
    # Each step would be so small that a system known from the one before could make it.
    solver = Solver(COLUMN, 'exact', material='linear', compiled=True)
    found = None
    for part in np.arange(0.75, 1.05, 0.0005):
        found = solver.solve(np.zeros((1, 4)), (-part * EULER, 0, 0, 0, 0, 0), start=found)
        aside = float(np.hypot(*found.tip[1:]))
        assert aside < 1e-9 if part < 0.9999 else part < 1.0001 or aside > 1e-3
    assert found is not None and np.hypot(*found.tip[1:]) > 0.05


def _loaded_rod(law: str) -> LoadedRod:
    loads = Loads(points=(PointLoad(0.4, (0.0, 0.0, 1e-9)),))
    statics = Solver(COLUMN, 'exact', material=law, loads=loads, compiled=True)._statics
    assert isinstance(statics, Exact)
    return statics._rod(0)


def _is_positive(problem: Equilibrium, state: State) -> bool:
    """Whether all changes of the twist at all points take energy, by what each imbalance does."""
    weights = np.tile(problem.collocation.weights, 4)
    one_by_one = np.eye(weights.size).reshape(weights.size, 4, -1).transpose(1, 0, 2)
    change = problem.linearised(state).solve(one_by_one).twist
    flexibility = change.transpose(1, 0, 2).reshape(weights.size, -1) / weights[:, np.newaxis]
    return bool(np.linalg.eigvalsh(0.5 * (flexibility + flexibility.T))[0] > 0.0)


def _under(tensions: np.ndarray, force: np.ndarray) -> Condition:
    return Condition(tensions, np.append(force, np.zeros(3)), 1.0)
