"""Both forms of the node functions give the same results."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rods import CASES, TENSIONS, WRENCH, forms, rod_of, twists_at

from octo_arm_model import Discs, Loads, Solver
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.rod.equilibrium import Condition, Problem
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.tables import force_scale, work_arrays

CONDITION = Condition(TENSIONS, WRENCH)


def evaluate(problem: Problem, z: FloatArray, form: Form) -> dict[str, FloatArray]:
    """Return the results of all node functions of a ``form`` at ``z``."""
    at_nodes, work = problem.at_nodes(CONDITION), work_arrays(problem.tables, problem.strains)
    work.scale[:] = force_scale(problem.tables, CONDITION.tensions)
    arguments = problem.tables, z, at_nodes.tensions
    balanced = z.copy()
    form.balance(problem.tables, balanced, at_nodes.tensions, 0.01 * z, 1e300, work)
    form.orientations(problem.tables, z, work)
    form.wrenches(problem.tables, at_nodes.force, at_nodes.couple, work)
    form.add_gradients(*arguments, work)
    form.jacobian(*arguments, at_nodes.force, work)
    return work._asdict() | {'balanced': balanced}


@pytest.mark.parametrize('name', CASES)
@pytest.mark.parametrize('level', [0, 1])
def test_both_forms_compute_the_same(name, level):
    pytest.importorskip('numba')
    problem = rod_of(name).problem(level)
    z = twists_at(problem.elements.s, problem.strains)
    first, second = (evaluate(problem, z, form) for form in forms())
    for name, expected in first.items():
        scale = np.abs(expected).max(initial=1e-300)
        assert_allclose(second[name], expected, rtol=0.0, atol=1e-12 * scale, err_msg=name)


@pytest.mark.parametrize(
    ('model', 'changes'),
    [
        ('renda2012', {}),
        ('closed_form', {}),
        ('closed_form', {'friction': (0.3,)}),
        ('exact', {'friction': (0.3,)}),
        ('exact', {'friction': (0.3,), 'sheath_stiffness': (3e5,)}),
        ('exact', {'discs': Discs.evenly(9, 0.45)}),
    ],
    ids=lambda value: value if isinstance(value, str) else ' '.join(value) or 'plain',
)
def test_both_forms_find_the_same_shape(table4, model, changes):
    pytest.importorskip('numba')
    arm, shapes = dataclasses.replace(table4.arm.with_density(1080.0), **changes), []
    loads = Loads(gravity=(0.0, 0.0, -9.81)) if model == 'exact' else Loads()
    tensions = (0.02 if 'discs' in changes else 0.5) * np.array(FETCHING_IN_SPACE)
    for compiled in (False, True):
        solver = Solver(arm, model, 31, loads=loads, compiled=compiled)
        shapes.append(solver.solve(tensions))
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
