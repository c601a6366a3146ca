"""Properties of the paper's models for any arm and any tensions."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from strategies import MODEL_NAMES, arms, loaded_arms

from octo_arm_model import Arm, Backbone, SolveError, Solver
from octo_arm_model.rod import paper_equations

MODEL = st.sampled_from(MODEL_NAMES)
LOADED = loaded_arms()


def solve_finely(arm: Arm, tensions: np.ndarray, model: str) -> Backbone:
    """Solve on far more nodes, with sweeps almost to rounding."""
    with patch.object(paper_equations, 'TOLERANCE', 1e-12):
        return Solver(arm, model, accuracy=1e-12).solve(tensions)


def solve_or_reject(solver: Solver, tensions: np.ndarray) -> Backbone:
    """Solve, or reject the example where the model has no solution."""
    try:
        return solver.solve(tensions)
    except SolveError:
        reject()


def assert_trustworthy(backbone: Backbone) -> None:
    for name, value in vars(backbone).items():
        assert value is None or name in ('model', 'equilibrium') or np.isfinite(value).all(), name
    norm = np.linalg.norm(backbone.quaternion, axis=-1)
    np.testing.assert_allclose(norm, 1.0, rtol=0.0, atol=1e-12)
    assert (backbone.q > -1.0).all()


@settings(max_examples=30)
@given(LOADED, MODEL)
def test_default_stations_put_the_tip_within_a_millionth_of_the_length(
    case: tuple[Arm, np.ndarray], model: str
) -> None:
    arm, tensions = case
    backbone = solve_or_reject(Solver(arm, model), tensions)
    assert_trustworthy(backbone)
    fine = solve_finely(arm, tensions, model)
    assert np.linalg.norm(backbone.tip - fine.tip) < 1e-6 * arm.length


@settings(max_examples=30)
@given(LOADED, MODEL)
def test_few_stations_put_the_tip_where_many_do(case: tuple[Arm, np.ndarray], model: str) -> None:
    arm, tensions = case
    few = solve_or_reject(Solver(arm, model, len(arm.sections) + 2), tensions)
    fine = solve_finely(arm, tensions, model)
    assert np.linalg.norm(few.tip - fine.tip) < 1e-6 * arm.length


@given(arms(), MODEL, st.integers(-12, 307), st.integers(0, 2**32 - 1))
def test_any_tensions_give_a_finite_shape_or_an_error(
    arm: Arm, model: str, exponent: int, seed: int
) -> None:
    shape = arm.tension_shape
    random = np.random.default_rng(seed)
    tensions = random.uniform(size=shape) * 10.0**exponent * random.integers(0, 2, shape)
    try:
        backbone = Solver(arm, model, 31).solve(tensions)
    except SolveError:
        return
    assert_trustworthy(backbone)


@given(LOADED, MODEL)
def test_mirrored_tensions_mirror_the_shape(case: tuple[Arm, np.ndarray], model: str) -> None:
    arm, tensions = case
    backbone = solve_or_reject(Solver(arm, model), tensions)
    # Tendons 2 and 4 swapped: b turns round, and torsion with it.
    mirror = Solver(arm, model).solve(tensions[:, [0, 3, 2, 1]])
    np.testing.assert_allclose(
        mirror.position, backbone.position * [1.0, 1.0, -1.0], atol=1e-7 * arm.length
    )
    np.testing.assert_allclose(mirror.tau, -backbone.tau, atol=1e-6 / arm.length)
