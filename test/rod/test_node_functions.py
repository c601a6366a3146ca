"""The node functions: both forms against each other, and derivatives against differences."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rods import CASES, TENSIONS, WRENCH, forms, jacobian_error, rod_of, twists_at

from octo_arm_model import Config
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.elements import build_elements
from octo_arm_model.rod.equilibrium import Condition, Problem
from octo_arm_model.rod.paper_equations import ClosedForm, Renda2012
from octo_arm_model.rod.several import Several
from octo_arm_model.rod.tables import places_at, work_arrays

CONDITION = Condition(TENSIONS, WRENCH)


def evaluated(problem: Problem, z: FloatArray, form: object) -> dict[str, FloatArray]:
    """What all node functions of a ``form`` make of ``z``."""
    acting = problem.acting(CONDITION)
    work = work_arrays(problem.tables, problem.strains)
    work.scale[:] = acting.scale
    given = problem.tables, z, acting.tensions
    balanced = z.copy()
    form.balance(  # type: ignore[attr-defined]
        problem.tables, balanced, acting.tensions, 0.01 * z, 1e300, work
    )
    form.residual(*given, acting.force, acting.couple, work)  # type: ignore[attr-defined]
    form.jacobian(*given, acting.force, work)  # type: ignore[attr-defined]
    return work._asdict() | {'balanced': balanced}


@pytest.mark.parametrize('name', CASES)
@pytest.mark.parametrize('level', [0, 1])
def test_both_forms_compute_the_same(name: str, level: int) -> None:
    pytest.importorskip('numba')
    problem = rod_of(name).problem(level)
    z = twists_at(problem.elements.s, problem.strains)
    first, second = (evaluated(problem, z, form) for form in forms())
    for name, one in first.items():
        scale = np.abs(one).max(initial=1e-300)
        np.testing.assert_allclose(second[name], one, rtol=0.0, atol=1e-12 * scale, err_msg=name)


@pytest.mark.parametrize('form', ['loops', 'arrays'])
def test_a_strain_that_is_impossible_anywhere_leaves_no_residual(form: str) -> None:
    # A fibre of no length, at a node in the middle.
    if form == 'loops':
        pytest.importorskip('numba')
    problem = rod_of('neo_hookean', compiled=form == 'loops').problem(0)
    z = twists_at(problem.elements.s, problem.strains)
    z[len(z) // 2, 1] = 1e3
    with np.errstate(invalid='ignore'):
        assert np.isnan(problem.evaluate(problem.acting(CONDITION), z).residual)


@pytest.mark.parametrize('name', CASES)
def test_gradient_and_hessian_are_derivatives_of_each_other(name: str) -> None:
    # The gradient is that of an energy: its Hessian is symmetric and its derivative.
    problem = rod_of(name).problem(0)
    acting, z = problem.acting(CONDITION), twists_at(problem.elements.s, problem.strains)
    form, work = problem.form, problem.work
    form.sections(problem.tables, z, acting.tensions, work)
    hessian = work.hessian.copy()
    symmetric = 1e-12 * np.abs(hessian).max()
    np.testing.assert_allclose(hessian, hessian.swapaxes(1, 2), rtol=0.0, atol=symmetric)
    for column in range(problem.strains):
        step = 1e-4 if column < 3 else 1e-6
        at = []
        for side in (1.0, -1.0):
            moved = z.copy()
            moved[:, column] += side * step
            form.sections(problem.tables, moved, acting.tensions, work)
            at.append(work.gradient.copy())
        expected = (at[0] - at[1]) / (2.0 * step)
        scale = np.abs(hessian[:, :, column]).max(axis=0)
        assert (np.abs(hessian[:, :, column] - expected) <= 1e-7 * scale).all()


@pytest.mark.parametrize('name', CASES)
def test_the_jacobian_is_the_derivative_of_the_residual_along_smooth_changes(name: str) -> None:
    # As exactly as nodes resolve the product of two strains: exponentially with their number.
    rod = rod_of(name)
    errors = [jacobian_error(rod.problem(level), CONDITION) for level in (0, 2)]
    assert errors[0] < 2e-4
    assert errors[1] < 2e-7


@pytest.mark.parametrize('name', CASES)
def test_a_wrench_in_sections_is_balanced_by_each(name: str) -> None:
    problem = rod_of(name).problem(0)
    acting, z = problem.acting(CONDITION), twists_at(problem.elements.s, problem.strains)
    work = problem.work
    problem.form.sections(problem.tables, z, acting.tensions, work)
    wrench, start = work.gradient.copy(), z + 1e-3 * np.cos(z)
    problem.form.balance(problem.tables, start, acting.tensions, wrench, 1e-11, work)
    np.testing.assert_allclose(start, z, rtol=0.0, atol=1e-9)


def test_orientations_are_those_of_a_screw_of_constant_bend() -> None:
    problem = rod_of('linear').problem(1)
    z = np.zeros((problem.elements.s.size, 4))
    z[:, :3], z[:, 3] = (1.0, -2.0, 2.0), 1.1
    angle = 3.0 * problem.elements.s
    axis = np.array([1.0, -2.0, 2.0]) / 3.0
    for form in forms():
        form.orientations(problem.tables, z, problem.work)
        expected = np.column_stack([np.cos(0.5 * angle), np.outer(np.sin(0.5 * angle), axis)])
        np.testing.assert_allclose(problem.work.quaternion, expected, rtol=0.0, atol=1e-11)
        slope = 1.1 * problem.work.rotation[:, :, 0]
        np.testing.assert_allclose(problem.work.slope, slope, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('model', [ClosedForm, Renda2012])
def test_both_forms_solve_the_papers_models_alike(table4: Config, model: type[ClosedForm]) -> None:
    pytest.importorskip('numba')
    tensions = np.random.default_rng(1).random((5, 12)) * np.repeat([0.2, 1.0, 3.0], 4)
    nodes, stations = build_elements(table4.arm, added=3), np.linspace(0.0, 0.45, 17)
    first, second = (model(table4.arm, nodes, stations, form).solve(tensions) for form in forms())
    for one, other in zip(first, second, strict=True):
        scale = np.abs(one).max(initial=1.0)
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize('arms', [1, 3])
@pytest.mark.parametrize('name', CASES)
def test_both_forms_put_places_where_they_are(name: str, arms: int) -> None:
    pytest.importorskip('numba')
    problem = rod_of(name).problem(0)
    several = Several(problem, arms)
    nodes = problem.elements.s
    z = np.concatenate([(1 + i) * twists_at(nodes, problem.strains) for i in range(arms)])
    places = places_at(problem.elements, np.linspace(0.0, problem.elements.edges[-1], 17))
    found = []
    for form in forms():
        form.orientations(several.tables, z, several.work)
        found.append(form.poses(several.tables, z, places, several.work))
    first, second = found
    for one, other in zip(first, second, strict=True):
        scale = np.abs(one).max(initial=1.0)
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize(
    ('variable', 'inside'), [('NUMBA_CACHE_DIR', ''), ('XDG_CACHE_HOME', 'numba')]
)
def test_machine_code_that_is_older_than_what_it_was_made_of_is_forgotten(
    tmp_path: Path, variable: str, inside: str
) -> None:
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
