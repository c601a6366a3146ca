"""Finite elements on coarse meshes, and the tables of the manual; see `validation/run.py`."""

import dataclasses
import json
import sys

import numpy as np
import pytest
from checkout import ROOT
from numpy.testing import assert_allclose

pytest.importorskip('skfem', reason='needs scikit-fem')
VALIDATION = ROOT / 'validation'
sys.path.insert(0, str(VALIDATION))

import friction
import run
import sheaths
import verify
from arm_mesh import ArmMesh, Mesh
from cases import PROTOTYPE, Case
from compare import run_case, solve_models
from elasticity import Contact, ElasticArm

from octo_arm_model import load_config

COARSE = Mesh(1, 0.4)


@pytest.mark.parametrize('half', [True, False])
def test_mesh_has_the_volume_of_the_cone_and_interpolates_positions(half):
    arm = load_config('renda2012_prototype').arm
    base, tip = arm.body.radius_base, arm.body.radius_tip
    volume = np.pi * arm.length / 3.0 * (base**2 + base * tip + tip**2) * (0.5 if half else 1.0)
    errors = []
    for across in (1, 2):
        mesh = ArmMesh(arm, Mesh(across, 0.3), half)
        errors.append(abs(mesh.displacement.dx.sum() / volume - 1.0))
        points = np.array([[0.1, 0.2, 0.27], [0.004, -0.005, 0.0], [0.006, 0.001, 0.0]])
        assert_allclose(mesh.at(points) @ mesh.nodes.T, points.T, atol=2e-5)
    # The error is of fourth order.
    assert errors[0] < 1e-3 and errors[1] < errors[0] / 12.0


@pytest.mark.parametrize(
    ('checks', 'along'),
    [
        (verify.derivatives, 0.5),
        (verify.compression, 0.3),
        (verify.cantilever, 0.5),
        (verify.energy, 0.5),
    ],
    ids=lambda checks: getattr(checks, '__name__', ''),
)
def test_elements_agree_with_independent_results(checks, along):
    for check in checks(Mesh(1, along)):
        assert check.passed, f'{check.what}: {check.found}, expected {check.expected}'


def tip_errors(case: Case, tension: float, contact: Contact) -> dict[str, float]:
    """Return the distance of each model's tip from that of coarse elements, over the length."""
    solid = ElasticArm(case.arm, COARSE, case.pulled, contact)
    (shape,) = solid.follow([[tension]])
    assert shape.residual < 1e-8
    assert shape.potential < tension * case.arm.length
    return {
        name: float(np.linalg.norm(backbone.tip - shape.tip)) / case.arm.length
        for name, (backbone,) in solve_models(case, [[tension]]).items()
    }


def test_exact_agrees_best_with_elements_on_the_prototype():
    errors = tip_errors(PROTOTYPE, 1.5, Contact(disc=1e-3))
    assert errors['exact'] < 0.004
    assert 0.01 < errors['renda2012'] < 0.025
    # Without widening of the section the exact path of the tendon increases the error.
    assert errors['exact, linear'] > 2.0 * errors['renda2012']


def test_a_case_is_solved_printed_and_drawn(tmp_path):
    pytest.importorskip('matplotlib')
    from plots import draw

    small = Mesh(1, 0.3)
    case = dataclasses.replace(
        PROTOTYPE,
        tensions=((0.5,),),
        meshes=(small, COARSE),
        result=COARSE,
        pairs=((small, COARSE),),
        varied=(0,),
        variants={'tendon kept in its section': {'sheath': None}},
        basis=small,
    )
    lines = []
    comparison = run_case(case, lines.append)
    assert any('residual' in line for line in lines)
    results = {'made_by': 'a test', 'minutes': 0.0, 'checks': {}, 'cases': {case.name: comparison}}
    json.dumps(results)
    assert comparison['mesh_error_percent'][0] < 0.2
    assert comparison['tip_error_percent']['exact'][0] < 0.3
    assert f'{comparison["tip_error_percent"]["exact"][0]:.2f}' in run.tables(results)
    for path in draw(results, tmp_path):
        assert path.stat().st_size > 10_000


def test_table_of_the_manual_has_the_numbers_of_results_json():
    cases = json.loads((VALIDATION / 'results.json').read_text())['cases']
    text = (VALIDATION.parent / 'docs' / 'accuracy.md').read_text()
    table = text[text.index('| arm | tension [N] |') :].split('\n\n')[0]
    name, checked = '', set()
    for line in table.splitlines()[2:]:
        arm, _, *numbers = (cell.strip() for cell in line.strip('|').split('|'))
        name = arm or name
        errors, variants = cases[name]['tip_error_percent'], cases[name]['variants']
        assert errors['renda2012'] == pytest.approx(errors['closed_form'], abs=0.01)
        models = [errors[model] for model in ('renda2012', 'exact', 'exact, linear')]
        rows = list(zip(*models, cases[name]['mesh_error_percent'], strict=True))
        load = [[f'{value:.2f}' for value in row] for row in rows].index(numbers[:4])
        checked.add((name, load))
        if numbers[4]:
            variant = variants['tendon kept in its section']
            place = variant['loads'].index(cases[name]['tensions_N'][load])
            assert numbers[4] == f'{variant["tip_error_percent"]["exact"][place]:.2f}'
    assert len(checked) == len(table.splitlines()) - 2 and dict(checked).keys() == cases.keys()


def test_table_of_sheaths_is_reproduced_and_errors_stay_below_half_a_per_cent():
    results = json.loads((VALIDATION / 'sheaths.json').read_text())
    text = (VALIDATION.parent / 'docs' / 'effects.md').read_text()
    assert '\n'.join(sheaths.rows(results)) in text
    for result in results:
        best = result['stiffness_over_shear_modulus']['best'] * sheaths._MODULUS
        errors = sheaths.errors(best, 1e-3 * np.array(result['tips_mm']))
        assert_allclose(errors, result['tip_error_percent']['best'], atol=0.006)
        assert (errors < 0.5 + np.array(result['mesh_error_percent'])).all()
        rigid = sheaths.errors(0.0, 1e-3 * np.array(result['tips_mm']))
        assert rigid[-1] > 10.0 * errors[-1]


def test_table_of_friction_is_reproduced():
    text = (VALIDATION.parent / 'docs' / 'effects.md').read_text()
    assert '\n'.join(friction.rows()) in text
