"""`octo-arm inverse`: tensions for a wanted tip or bend."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from command_line import run

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
