"""`octo-arm solve`: the summary and the JSON object."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import SOLVE, TENSIONS, run

from octo_arm_model import Config, Loads, Solver
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path


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
    solver = table4.solver(model, 41, compiled=False)
    expected = solver.solve(FETCHING_IN_SPACE)
    names = (
        'model s section position quaternion tau xi k q tension tendon_length displacement '
        'residual iterations slack'
    )
    assert list(shape) == names.split()
    assert shape.pop('slack') == []
    np.testing.assert_allclose(shape.pop('tension'), FETCHING_IN_SPACE)
    reeled_in = solver.rest_lengths - solver.tendon_lengths(expected)
    np.testing.assert_allclose(shape.pop('displacement'), reeled_in, atol=1e-12)
    assert shape.pop('model') == model
    lengths = solver.tendon_lengths(expected)
    np.testing.assert_allclose(shape.pop('tendon_length'), lengths, atol=1e-12)
    for name, values in shape.items():
        np.testing.assert_allclose(values, getattr(expected, name), atol=1e-12, err_msg=name)
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
    solver = Solver(arm, 'exact', 101, table4.base, material='linear', loads=loads, compiled=False)
    expected = solver.solve(FETCHING_IN_SPACE)
    shape = json.loads(out)
    np.testing.assert_allclose(shape['position'], expected.position, atol=1e-12)
    # What is left is of the size of rounding, and that is the processor's.
    assert max(shape['residual'], float(expected.residual)) < 1e-10
    assert shape['iterations'] == int(expected.iterations) > 0


def test_lengths_that_winches_reel_in_give_the_tensions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One tendon by length, one by tension, and one that is paid out too far to be taut."""
    asked = '{"tendon_1_1": 0.02, "tendon_2_1": -0.01}'
    arguments = 'solve', 'renda2012_table4', '--model', 'exact', '--displacements', asked
    arguments += '--tensions', '{"tendon_3_1": 1}'
    status, out, _ = run(capsys, *arguments, '--json')
    shape = json.loads(out)
    assert status == 0 and shape['slack'] == ['tendon_2_1']
    assert shape['displacement'][0][0] == pytest.approx(0.02, abs=1e-9)
    assert shape['tension'][1:] == [[0, 0, 0, 0], [1, 0, 0, 0]]
    again = json.dumps(shape['tension'])
    _, out, _ = run(capsys, *arguments[:4], '--tensions', again, '--json')
    np.testing.assert_allclose(json.loads(out)['position'], shape['position'], atol=1e-12)
    _, out, _ = run(capsys, *arguments)
    assert out.endswith('slack: tendon_2_1\n')


@pytest.mark.parametrize(
    ('given', 'problem'),
    [
        ([], 'neither --tensions nor --displacements is given'),
        (['--displacements', '[0.01]'], '--displacements is [0.01], expected numbers by name'),
        (['--displacements', '{"tendon_1_1": "x"}'], 'expected numbers by name'),
        (['--displacements', '{"elbow": 0.01}'], 'unknown tendon elbow'),
        (['--displacements', '{"tendon_1_1": 20}'], 'less than there is to reel in: 0.45 m'),
        (['--displacements', '{"tendon_1_1": 0.01, "tendon_1_1": 0}'], 'expected each name once'),
        (['--displacements', f'{{"tendon_1_1": {10**400}}}'], 'expected a finite number'),
        (['--displacements', '{}', '--tensions', '[[1]]'], '--tensions is [[1]], expected'),
    ],
)
def test_displacements_that_are_none_are_refused(
    capsys: pytest.CaptureFixture[str], given: list[str], problem: str
) -> None:
    status, _, err = run(capsys, *SOLVE[:2], *given)
    assert status == 2 and problem in err and err.count('\n') == 1


def test_what_winches_reel_in_of_tendons_that_stretch_and_rub_gives_tensions_back(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    text = preset_path('renda2012_prototype').read_text()
    text = text.replace('model: renda2012', 'model: exact')
    path = tmp_path / 'rough.yaml'
    path.write_text(f'{text}    tendons: {{friction: [0.1], axial_stiffness: [500.0]}}\n')
    status, out, err = run(capsys, 'solve', str(path), '--tensions', '[[2, 0, 0, 0]]', '--json')
    assert (status, err) == (0, '')
    length = json.loads(out)['displacement'][0][0]
    given = json.dumps({'tendon_1_1': length})
    status, out, err = run(capsys, 'solve', str(path), '--displacements', given, '--json')
    assert (status, err) == (0, '')
    assert json.loads(out)['tension'][0][0] == pytest.approx(2.0, abs=1e-8)
