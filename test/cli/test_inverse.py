"""`octo-arm inverse`: tensions for a wanted tip or bend."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from command_line import run
from scipy.spatial.transform import Rotation

from octo_arm_model import Config


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


def test_errors_of_an_angle_are_angles(capsys: pytest.CaptureFixture[str]) -> None:
    # The bend out of reach of so small a tension is nearly all error.
    arguments = ('inverse', 'renda2012_prototype', '--bend', '90', '40', '--highest', '0.01')
    status, out, _ = run(capsys, *arguments)
    found = re.search(r'error +([\d.]+) deg,', out)
    assert status == 1 and found and 35.0 < float(found[1]) < 40.0
    status, out, _ = run(capsys, *arguments, '--json')
    answer = json.loads(out)
    assert answer['distance_error'] is None
    assert np.degrees(answer['angle_error']) == pytest.approx(float(found[1]), rel=1e-3)


def test_errors_of_a_pose_are_a_distance_and_an_angle(
    capsys: pytest.CaptureFixture[str], table4: Config
) -> None:
    place, turn = [0.4, 0.0, 0.0], Rotation.from_euler('z', 90.0, degrees=True)
    pose = ('--tip', *map(str, place), '--quaternion', *map(str, turn.as_quat()))
    arguments = ('inverse', 'renda2012_table4', *pose, '--model', 'closed_form')
    arguments += ('--highest', '0.001')
    status, out, _ = run(capsys, *arguments)
    found = re.search(r'error +([\d.]+) mm and ([\d.]+) deg,', out)
    assert status == 1 and found
    _, out, _ = run(capsys, *arguments, '--json')
    backbone = table4.solver('closed_form').solve(json.loads(out)['tensions'])
    away = np.linalg.norm(backbone.tip - place)
    turned = (Rotation.from_quat(backbone.quaternion[-1]) * turn.inv()).magnitude()
    assert float(found[1]) == pytest.approx(1e3 * away, rel=1e-3)
    assert float(found[2]) == pytest.approx(np.degrees(turned), rel=1e-3)
