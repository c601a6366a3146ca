"""The command line: what it prints, and how it fails."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from octo_arm_model import Config, Loads, Solver
from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.presets import preset_path

TENSIONS = json.dumps(FETCHING_IN_SPACE)
SOLVE = ('solve', 'renda2012_table4', '--tensions')


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = main(arguments)
    return status, *capsys.readouterr()


def test_the_summary_says_where_the_tip_is_in_millimetres(
    capsys: pytest.CaptureFixture[str], table4: Config
) -> None:
    status, out, err = run(capsys, *SOLVE, TENSIONS)
    x, y, z = table4.solver().solve(FETCHING_IN_SPACE).tip * 1e3
    assert (status, err) == (0, '')
    assert f'({x:.2f}, {y:.2f}, {z:.2f}) mm, {np.linalg.norm([x, y, z]):.2f} mm from' in out
    assert 'renda2012, 101 stations' in out


def test_the_summary_lists_base_anchorages_and_tip(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, *SOLVE, TENSIONS)
    rows = re.findall(r'^ +(\d+) +([\d.]+) ', out, re.MULTILINE)
    assert rows == [('3', '0.00'), ('3', '135.00'), ('2', '315.00'), ('1', '450.00')]


def test_json_holds_the_whole_shape_in_si_units(
    capsys: pytest.CaptureFixture[str], table4: Config, model: str
) -> None:
    status, out, _ = run(capsys, *SOLVE, TENSIONS, '--json', '--model', model, '--stations', '41')
    assert (status, out.count('\n')) == (0, 1)
    shape = json.loads(out)
    solver = table4.solver(model, 41)
    expected = solver.solve(FETCHING_IN_SPACE)
    names = 'model s section position quaternion tau xi k q tendon_length residual iterations'
    assert list(shape) == names.split()
    assert shape.pop('model') == model
    np.testing.assert_array_equal(shape.pop('tendon_length'), solver.tendon_lengths(expected))
    for name, values in shape.items():
        np.testing.assert_array_equal(values, getattr(expected, name), err_msg=name)
    assert all(isinstance(number, int) for number in shape['section'])


def test_a_file_is_read_where_the_name_looks_like_a_path(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / 'my_arm.yaml'
    path.write_text(preset_path('renda2012_prototype').read_text())
    status, out, _ = run(capsys, 'solve', str(path), '--tensions', '[[3, 0, 0, 0]]')
    assert status == 0
    assert out == run(capsys, 'solve', 'renda2012_prototype', '--tensions', '[[3,0,0,0]]')[1]


def test_loads_and_material_may_be_said_on_the_command_line(
    capsys: pytest.CaptureFixture[str], table4: Config
) -> None:
    physics = (
        '--model exact --material linear --gravity 0 0 -9.81 --density 1080 --fluid-density 1000 '
        '--tip-force 0 0.001 0 --tip-moment 0 0 1e-6'
    )
    _, out, _ = run(capsys, *SOLVE, TENSIONS, '--json', *physics.split())
    loads = Loads((0, 0, -9.81), 1000, (0, 0.001, 0), (0, 0, 1e-6))
    arm = table4.arm.with_density(1080)
    solver = Solver(arm, 'exact', 101, table4.base, material='linear', loads=loads)
    expected = solver.solve(FETCHING_IN_SPACE)
    shape = json.loads(out)
    np.testing.assert_array_equal(shape['position'], expected.position)
    assert shape['residual'] == float(expected.residual) < 1e-10
    assert shape['iterations'] == int(expected.iterations) > 0


def test_inverse_finds_tensions_whose_tip_is_where_it_was_wanted(
    capsys: pytest.CaptureFixture[str], table4: Config
) -> None:
    status, out, _ = run(
        capsys, 'inverse', 'renda2012_table4', '--tip', '0.25', '0.1', '-0.1', '--json'
    )
    answer = json.loads(out)
    assert (status, answer['reached']) == (0, True)
    tip = table4.solver('exact').solve(answer['tensions']).tip
    np.testing.assert_allclose(tip, [0.25, 0.1, -0.1], atol=1e-6)


def test_inverse_of_what_is_out_of_reach_says_so_with_status_1(
    capsys: pytest.CaptureFixture[str],
) -> None:
    status, out, _ = run(capsys, 'inverse', 'renda2012_prototype', '--tip', '2', '0', '0')
    assert status == 1
    assert out.startswith('NOT REACHED')
    assert re.search(r'error +17[34]\d mm', out)


def test_inverse_bends_in_the_plane_that_was_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ('inverse', 'renda2012_prototype', '--bend', '90', '40', '--highest', '3')
    status, out, _ = run(capsys, *arguments)
    # Towards +b: tendon 2 alone.
    tensions = [float(value) for value in re.findall(r'tendon_1_\d +([\d.]+)', out)]
    assert status == 0
    assert tensions[1] > 0.1
    np.testing.assert_allclose(np.delete(tensions, 1), 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ((*SOLVE, TENSIONS, '--gravity', '0', '0', '-9.81'), "model is 'renda2012', which"),
        (
            (*SOLVE, TENSIONS, '--model', 'exact', '--gravity', '0', '0', '-9.81'),
            'material.density is 0.0, expected a density > 0',
        ),
        ((*SOLVE, TENSIONS, '--density', '-1'), 'material.density is -1.0, expected'),
        ((*SOLVE, TENSIONS, '--tip-force', '0', 'nan', '0'), 'loads.tip_force is (0.0, nan'),
        (('inverse', 'renda2012_table4'), 'expected either --tip X Y Z or --bend PLANE ANGLE'),
        (('inverse', 'renda2012_table4', '--tip', '0', 'inf', '0'), 'tip position is [0.0, inf'),
        (
            ('inverse', 'renda2012_table4', '--bend', '0', '9', '--model', 'closed_form',
             '--stiffness', '0', '0', '1', '1'),
            'the model has no loads, so no compliance: choose exact',
        ),
        (
            ('inverse', 'renda2012_table4', '--tip', '0', '0', '0', '--highest', '[1,2]'),
            '--highest is [1,2], expected one number or shape (3, 4)',
        ),
        (
            ('inverse', 'renda2012_table4', '--tip', '0', '0', '0', '--highest', '-1'),
            'highest tension of tendon_1_1 is -1.0 N, expected',
        ),
        (('inverse', 'renda2012_table4', '--bend', '0', '200'), 'bending angle is 3.49'),
        ((*SOLVE, 'much'), "--tensions is not JSON at character 1, expected rows of numbers"),
        ((*SOLVE, '[[0,0'), '--tensions is not JSON at character 6, expected rows of numbers'),
        ((*SOLVE, '[[1,2,3,4]]'), 'tensions have shape (1, 4), expected (..., 3, 4)'),
        ((*SOLVE, '[[1,2],[3]]'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, '[' * 100_000), '--tensions is not JSON, expected rows of numbers'),
        ((*SOLVE, '[1,2,3,4]'), 'tensions have shape (4,), expected (..., 3, 4)'),
        ((*SOLVE, '[]'), 'tensions have shape (0,), expected (..., 3, 4)'),
        ((*SOLVE, 'null'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, '[["1",2,3,4]]'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, f'[[{"9" * 400},2,3,4]]'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, '{"a": 1}'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, f'[{TENSIONS}]'), '--tensions holds several sets, expected one row for each'),
        ((*SOLVE, '[[0,0,-1,0],[0,0,0,0],[0,0,0,0]]'), 'tension of tendon_1_3 is -1.0 N, expect'),
        ((*SOLVE, '[[0,0,0,NaN],[0,0,0,0],[0,0,0,0]]'), 'tension of tendon_1_4 is nan N, expect'),
        ((*SOLVE, '[[0,0,0,0],[1e999,0,0,0],[0,0,0,0]]'), 'tension of tendon_2_1 is inf N, exp'),
        ((*SOLVE, TENSIONS, '--stations', '3'), 'stations is 3, expected at least 4'),
        (('solve', 'nothing', '--tensions', '[]'), "no preset arm 'nothing', expected one of "),
        (('solve', 'nowhere.yaml', '--tensions', '[]'), 'nowhere.yaml: No such file or directory'),
        (('solve', '.', '--tensions', '[]'), '.: Is a directory'),
        (('reproduce', __file__), '[Errno 17] File exists:'),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_on_stderr_and_status_2(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    status, out, err = run(capsys, *arguments)
    assert (status, out) == (2, '')
    assert err.startswith(f'octo-arm: error: {message}')
    assert err.count('\n') == 1


@pytest.mark.parametrize(
    'arguments',
    [
        (), ('draw',), ('solve',), ('solve', 'renda2012_table4'), ('reproduce',),
        (*SOLVE, TENSIONS, '--model', 'best'), (*SOLVE, TENSIONS, '--stations', 'many'),
    ],
)  # fmt: skip
def test_wrong_usage_is_status_2(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as leave:
        main(arguments)
    assert leave.value.code == 2
    assert 'error: ' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('tension', 'message'),
    [
        ('1e3', r'tensions compress the arm to nothing at s = 0.45 m \(q = -.*, must be > -1\)'),
        ('1e300', r'tension of 1e\+300 N is beyond .* N, a million times what would compress .*'),
    ],
)
def test_no_trustworthy_answer_is_one_line_on_stderr_and_status_1(
    capsys: pytest.CaptureFixture[str], tension: str, message: str
) -> None:
    everywhere = json.dumps([[float(tension)] * 4] * 3)
    status, out, err = run(capsys, *SOLVE, everywhere)
    assert (status, out) == (1, '')
    assert re.fullmatch(f'octo-arm: error: {message}\n', err)


def test_it_runs_as_a_module_of_its_own(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-m', 'octo_arm_model.cli.main', *SOLVE, '[[0]]'],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ''
    assert done.stderr.splitlines() == [
        'octo-arm: error: tensions have shape (1, 1), expected (..., 3, 4): '
        '3 section(s) from the tip, 4 tendons each'
    ]
