"""The paper's models: an independent solution, properties and derivatives."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
import reference
from differences import jacobian
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from strategies import MODEL_NAMES, PAPER_SIZE, arms, loaded_arms

from octo_arm_model import (
    Arm,
    Backbone,
    Config,
    ConfigError,
    ConvergenceError,
    SolveError,
    Solver,
    Uncertainty,
)
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.rod import arrays, papers

ONE = (1.0, 0.0, 0.0, 0.0)


def paper_sized(arm: Arm, seed: int) -> np.ndarray:
    """Return tensions of the paper's size; seed 0 has one tendon per section under tension."""
    random = np.random.default_rng(seed)
    largest = np.array(PAPER_SIZE[arm.length])[:, np.newaxis]
    if seed == 0:
        return largest * random.permuted([ONE] * len(largest), axis=1)
    fractions = random.uniform(size=(len(largest), 4)) * random.integers(0, 2, (len(largest), 4))
    return largest * fractions / np.maximum(1.0, fractions.sum(axis=1, keepdims=True))


@pytest.mark.parametrize(
    'seed', [1, *(pytest.param(seed, marks=pytest.mark.endurance) for seed in (0, 2, 3, 4, 5))]
)
def test_shape_and_strains_equal_those_of_an_ode_solver(preset, papers_model, seed):
    tensions = paper_sized(preset.arm, seed)
    backbone = preset.solver(papers_model).solve(tensions)
    expected = reference.solve(preset.arm, tensions, papers_model, backbone.s, preset.base)
    strains = np.stack([backbone.tau, backbone.xi, backbone.k, backbone.q], axis=1)
    largest = np.abs(expected.strains[:, :3]).max()
    assert_allclose(strains[:, :3], expected.strains[:, :3], atol=1e-8 * largest)
    assert_allclose(strains[:, 3], expected.strains[:, 3], atol=1e-9)
    assert np.linalg.norm(backbone.tip - expected.position[-1]) < 1e-7 * preset.arm.length
    assert_allclose(backbone.position, expected.position, atol=1e-7 * preset.arm.length)
    tangent = reference.Rotation.from_quat(backbone.quaternion).as_matrix()
    assert_allclose(tangent, expected.rotation, atol=1e-5)


def test_error_without_convergence_has_iterations_and_residual(table4, monkeypatch):
    monkeypatch.setattr(arrays, 'MOST_PAPER_SWEEPS', 2)
    with pytest.raises(ConvergenceError, match=r'equation \(10\) in section 3 did not conv') as e:
        table4.solver('renda2012', compiled=False).solve(10.0 * np.array(FETCHING_IN_SPACE))
    assert e.value.iterations == 2
    assert e.value.residual > papers.TOLERANCE


def test_elements_are_divided_where_sweeps_diverge(table4):
    # Tensions within Table 5, for which (10) has a solution with q > -0.47.
    tensions = np.array([[0, 0, 0.5, 0], [0, 4, 4, 0], [0, 0, 0, 0.0]])
    backbone = table4.solver('renda2012').solve(tensions)
    expected = reference.solve(table4.arm, tensions, 'renda2012', backbone.s, table4.base)
    assert_allclose(backbone.tip, expected.position[-1], atol=1e-7 * table4.arm.length)


# Properties for any arm and any tensions ---------------------------------------------------------

MODEL = st.sampled_from(MODEL_NAMES)
LOADED = loaded_arms()


def solve_or_reject(solver: Solver, tensions: np.ndarray) -> Backbone:
    """Solve, or reject the example if the model has no solution."""
    try:
        return solver.solve(tensions)
    except SolveError:
        reject()


@settings(max_examples=30)
@given(LOADED, MODEL)
def test_tip_does_not_depend_on_the_number_of_stations(case, model):
    arm, tensions = case
    few = solve_or_reject(Solver(arm, model, len(arm.sections) + 2), tensions)
    fine = Solver(arm, model, accuracy=1e-12).solve(tensions)
    assert np.linalg.norm(few.tip - fine.tip) < 1e-6 * arm.length


@given(arms(), MODEL, st.integers(-12, 307), st.integers(0, 2**32 - 1))
def test_any_tensions_give_a_finite_shape_or_an_error(arm, model, exponent, seed):
    shape = arm.tension_shape
    random = np.random.default_rng(seed)
    tensions = random.uniform(size=shape) * 10.0**exponent * random.integers(0, 2, shape)
    try:
        backbone = Solver(arm, model, 31).solve(tensions)
    except SolveError:
        return
    for name, value in vars(backbone).items():
        assert value is None or name in ('model', 'equilibrium') or np.isfinite(value).all(), name
    norm = np.linalg.norm(backbone.quaternion, axis=-1)
    assert_allclose(norm, 1.0, rtol=0.0, atol=1e-12)
    assert (backbone.q > -1.0).all()


# Derivatives, by small imaginary tensions --------------------------------------------------------


TENSIONS = np.array(FETCHING_IN_SPACE) + [[0.05], [0.3], [1.0]]


def test_derivatives_by_tensions_equal_finite_differences(table4, papers_model):
    solver = Solver(table4.arm, papers_model)
    change = solver.sensitivity(solver.solve(TENSIONS)).by_tension
    analytic = np.concatenate(
        [change.tip[:3], *change.strain[::10].transpose(1, 0, 2), change.tendon_length]
    )
    # The strains depend only on tensions over E.
    by_young = solver.sensitivity(solver.solve(TENSIONS)).by_youngs_modulus.tip
    assert_allclose(by_young[:, 0], -change.tip @ TENSIONS.ravel(), rtol=1e-9, atol=1e-12)

    def outcome(tensions):
        shape = solver.solve(tensions.reshape(3, 4))
        strains = [getattr(shape, name)[::10] for name in ('tau', 'xi', 'k', 'q')]
        return np.concatenate([shape.tip, *strains, solver.tendon_lengths(shape).ravel()])

    expected = jacobian(outcome, TENSIONS.ravel(), step=2e-3)
    assert_allclose(analytic, expected, rtol=2e-5, atol=2e-6 * np.abs(expected).max())


def test_derivatives_beyond_the_papers_models_are_refused(table4, papers_model):
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


def test_model_error_is_added_to_the_covariance(table4, papers_model):
    solver = Solver(table4.arm, papers_model, 31)
    backbone = solver.solve(TENSIONS)
    without = solver.tip_covariance(backbone, Uncertainty(0.01))
    uncertainty = Config.from_parameters(
        {
            **load_parameters('renda2012_table4'),
            'tension_stddev': 0.01,
            'model_error_stddev': 0.014,
        }
    ).uncertainty
    added = solver.tip_covariance(backbone, uncertainty) - without
    position, rotation = (0.014 * table4.arm.length) ** 2, (2.0 * 0.014) ** 2
    assert_allclose(added, np.diag(3 * [position] + 3 * [rotation]), atol=1e-12)


# Both forms of the node functions ----------------------------------------------------------------


@pytest.mark.parametrize(
    ('model', 'friction'), [('renda2012', ()), ('closed_form', ()), ('closed_form', (0.3,))]
)
def test_arrays_give_the_shape_of_compiled_loops(table4, model, friction):
    pytest.importorskip('numba')
    arm = dataclasses.replace(table4.arm, friction=friction)
    shapes = [
        Solver(arm, model, 31, compiled=compiled).solve(0.5 * np.array(FETCHING_IN_SPACE))
        for compiled in (True, False)
    ]
    for name in ('position', 'quaternion', 'k', 'q', 'tendon_tensions'):
        first, second = (getattr(shape, name) for shape in shapes)
        scale = max(1.0, np.abs(first).max())
        assert_allclose(second, first, rtol=0.0, atol=1e-12 * scale, err_msg=name)


@pytest.mark.parametrize(
    ('variable', 'inside'), [('NUMBA_CACHE_DIR', ''), ('XDG_CACHE_HOME', 'numba')]
)
def test_machine_code_older_than_its_sources_is_deleted(tmp_path, variable, inside):
    pytest.importorskip('numba')
    folder = tmp_path / inside / 'rod_of_this_place'
    folder.mkdir(parents=True)
    for name, when in (('stale', 1e9), ('fresh', 4e9)):
        file = folder / f'{name}.nbi'
        file.touch()
        os.utime(file, (when, when))
    environment = os.environ | {variable: str(tmp_path)}
    command = [sys.executable, '-c', 'import octo_arm_model.rod.compiled']
    subprocess.run(command, env=environment, check=True)
    assert [file.stem for file in folder.glob('*.nbi')] == ['fresh']
