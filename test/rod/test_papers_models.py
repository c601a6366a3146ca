"""Derivatives of the paper's models, by small imaginary tensions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from differences import jacobian

from octo_arm_model import (
    Config,
    ConfigError,
    Material,
    Solver,
    TipPosition,
    Uncertainty,
    find_tensions,
)
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters, preset_path

TENSIONS = np.array(FETCHING_IN_SPACE) + [[0.05], [0.3], [1.0]]


def outcome(solver: Solver, tensions: np.ndarray) -> np.ndarray:
    """Tip, strains of some stations and lengths in one vector."""
    backbone = solver.solve(tensions.reshape(3, 4))
    strains = [getattr(backbone, name)[::10] for name in ('tau', 'xi', 'k', 'q')]
    return np.concatenate([backbone.tip, *strains, solver.tendon_lengths(backbone).ravel()])


def test_derivatives_by_tensions_are_those_of_differences(
    table4: Config, papers_model: str
) -> None:
    solver = Solver(table4.arm, papers_model)
    change = solver.sensitivity(solver.solve(TENSIONS)).by_tension
    got = np.concatenate([
        change.tip[:3], *change.strain[::10].transpose(1, 0, 2), change.tendon_length
    ])  # fmt: skip
    expected = jacobian(lambda x: outcome(solver, x), TENSIONS.ravel(), step=2e-3)
    np.testing.assert_allclose(got, expected, rtol=2e-5, atol=2e-6 * np.abs(expected).max())


def test_derivatives_by_young_are_those_of_another_material(
    table4: Config, papers_model: str
) -> None:
    def tip(change: np.ndarray) -> np.ndarray:
        material = Material(1.1e5 * (1.0 + change.item()), 0.5)
        arm = dataclasses.replace(table4.arm, material=material)
        return Solver(arm, papers_model).solve(TENSIONS).tip

    solver = Solver(table4.arm, papers_model)
    got = solver.sensitivity(solver.solve(TENSIONS)).by_youngs_modulus.tip[:3]
    np.testing.assert_allclose(got, jacobian(tip, [0.0], step=1e-3), rtol=1e-5, atol=1e-6)


def test_covariance_is_that_of_drawn_tensions(table4: Config, papers_model: str) -> None:
    solver = Solver(table4.arm, papers_model, 31)
    deviation = 0.002
    drawn = TENSIONS + deviation * np.random.default_rng(1).normal(size=(4000, 3, 4))
    tips = solver.solve(drawn).tip
    ours = solver.tip_covariance(solver.solve(TENSIONS), Uncertainty(deviation))[:3, :3]
    np.testing.assert_allclose(ours, np.cov(tips.T), atol=0.1 * np.abs(ours).max())


def test_what_the_paper_has_no_derivative_by_is_refused(table4: Config, papers_model: str) -> None:
    solver = Solver(table4.arm, papers_model, 31)
    backbone = solver.solve(TENSIONS)
    with pytest.raises(ConfigError, match="no derivative by the tendons' offsets: choose exact"):
        solver.tip_covariance(backbone, Uncertainty(offset=1e-4))
    with pytest.raises(ConfigError, match='no compliance: choose exact'):
        _ = solver.sensitivity(backbone).compliance
    with pytest.raises(ConfigError, match='that of a batch'):
        solver.sensitivity(solver.solve(np.stack([TENSIONS, TENSIONS])))
    with pytest.raises(ConfigError, match='by another solver'):
        solver.sensitivity(Solver(table4.arm, papers_model, 61).solve(TENSIONS))


def test_the_inverse_problem_is_solved_by_the_papers_models_too(
    table4: Config, papers_model: str
) -> None:
    solver = Solver(table4.arm, papers_model, 31)
    wanted = solver.solve(0.5 * TENSIONS).tip
    found = find_tensions(solver, TipPosition(wanted), [[0.5], [4.0], [13.0]])
    assert found.reached
    np.testing.assert_allclose(solver.solve(found.backbone.tensions).tip, wanted, atol=1e-6)


def test_the_error_of_the_model_is_added_to_the_covariance(
    table4: Config, papers_model: str
) -> None:
    solver = Solver(table4.arm, papers_model, 31)
    backbone = solver.solve(TENSIONS)
    without = solver.tip_covariance(backbone, Uncertainty(0.01))
    known = Config.from_parameters({
        **load_parameters(preset_path('renda2012_table4')),
        'tension_stddev': 0.01,
        'model_error_stddev': 0.014,
    }).uncertainty  # fmt: skip
    added = solver.tip_covariance(backbone, known) - without
    position, rotation = (0.014 * table4.arm.length) ** 2, (2.0 * 0.014) ** 2
    np.testing.assert_allclose(added, np.diag(3 * [position] + 3 * [rotation]), atol=1e-12)
