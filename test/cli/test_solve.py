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
from octo_arm_model.config.presets import preset_path


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
    solver = Solver(arm, 'exact', 101, table4.base, material='linear', loads=loads)
    expected = solver.solve(FETCHING_IN_SPACE)
    shape = json.loads(out)
    np.testing.assert_allclose(shape['position'], expected.position, atol=1e-12)
    # What is left is of the size of rounding, and that is the processor's.
    assert max(shape['residual'], float(expected.residual)) < 1e-10
    assert shape['iterations'] == int(expected.iterations) > 0
