"""The command line: wrong usage, exit statuses, and that it runs as a module."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import SOLVE, TENSIONS, run

from octo_arm_model.cli.main import main


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ((*SOLVE, TENSIONS, '--gravity', '0', '0', '-9.81'), "model is 'renda2012', which"),
        (
            (*SOLVE, TENSIONS, '--model', 'exact', '--gravity', '0', '0', '-9.81'),
            'material.density is 0.0, expected a density > 0',
        ),
        ((*SOLVE, TENSIONS, '--model', 'exact', '--density', '-1'), 'material.density is -1.0'),
        ((*SOLVE, TENSIONS, '--model', 'exact', '--density', '1080'),
         '--density has no effect without --gravity'),
        ((*SOLVE, TENSIONS, '--model', 'exact', '--fluid-density', '1000'),
         '--fluid-density has no effect without --gravity'),
        ((*SOLVE, TENSIONS, '--tip-force', '0', 'nan', '0'), 'loads.tip_force is (0.0, nan'),
        (
            (*SOLVE, TENSIONS, '--model', 'exact', '--tip-force', '0', '1e6', '0'),
            'loads.tip_force is (0.0, 1000000.0, 0.0), expected at most 138.2 N',
        ),
        (('inverse', 'renda2012_table4'), 'expected either --tip X Y Z or --bend PLANE ANGLE'),
        (('inverse', 'renda2012_table4', '--tip', '0', 'inf', '0'), 'tip position is [0.0, inf'),
        (
            ('inverse', 'renda2012_table4', '--bend', '0', '9', '--model', 'closed_form',
             '--stiffness', '0', '0', '1', '1'),
            'the model has no loads, so no compliance: choose exact',
        ),
        (
            ('inverse', 'renda2012_table4', '--tip', '0', '0', '0', '--highest', '[1,2]'),
            'highest is [1, 2], expected one number or shape (3, 4)',
        ),
        (
            ('inverse', 'renda2012_table4', '--tip', '0', '0', '0', '--highest', '-1'),
            'highest tension of tendon_1_1 is -1.0 N, expected',
        ),
        (
            ('inverse', 'renda2012_table4', '--bend', '0', '200'),
            '--bend: ANGLE is 200, expected 0 to 180 [deg]',
        ),
        ((*SOLVE, 'much'), '--tensions is not JSON at character 1, expected rows of numbers'),
        ((*SOLVE, '[[0,0'), '--tensions is not JSON at character 6, expected rows of numbers'),
        ((*SOLVE, '[[1,2,3,4]]'), 'tensions have shape (1, 4), expected (..., 3, 4)'),
        ((*SOLVE, '[[1,2],[3]]'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, '[' * 100_000), '--tensions is not JSON, expected rows of numbers'),
        ((*SOLVE, '[1,2,3,4]'), 'tensions have shape (4,), expected (..., 3, 4)'),
        ((*SOLVE, '[]'), 'tensions have shape (0,), expected (..., 3, 4)'),
        ((*SOLVE, 'null'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, '[["1",2,3,4]]'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, f'[[{"9" * 400},2,3,4]]'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, '[[true,0,0,0],[0,0,0,0],[0,0,0,0]]'), 'tensions must be numbers in rows of eq'),
        (('inverse', 'renda2012_table4', '--tip', '0.2', '0', '0', '--highest', 'true'),
         'highest is True, expected one number or shape (3, 4)'),
        (('workspace', 'renda2012_table4', '--json', '--highest', '[[1,1,1,true],[1],[1]]'),
         'highest: tensions must be numbers'),
        (('play', 'rotating', '--csv', 'x.csv', '--highest', 'true'), 'highest is True, expected'),
        (('play', 'rotating', '--csv', 'x.csv', '--speed', '1e-9'), 'rotating is '),
        (('play', 'rotating', '--csv', 'x.csv', '--speed', '1e-320'), '--speed is 1e-320, expec'),
        ((*SOLVE, TENSIONS, '--stations', '1000000000000'), 'stations is 1000000000000, expect'),
        (('workspace', 'renda2012_table4', '--samples', '1048577'), 'samples is 1048577, expect'),
        (('workspace', 'renda2012_table4', '--processes', '1001'), 'processes is 1001, expected'),
        ((*SOLVE, '{"a": 1}'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, f'[{TENSIONS}]'), '--tensions holds several sets, expected one row for each'),
        ((*SOLVE, '[[0,0,-1,0],[0,0,0,0],[0,0,0,0]]'), 'tension of tendon_1_3 is -1.0 N, expect'),
        ((*SOLVE, '[[0,0,0,NaN],[0,0,0,0],[0,0,0,0]]'), 'tension of tendon_1_4 is nan N, expect'),
        ((*SOLVE, '[[0,0,0,0],[1e999,0,0,0],[0,0,0,0]]'), 'tension of tendon_2_1 is inf N, exp'),
        ((*SOLVE, TENSIONS, '--stations', '3'), 'stations is 3, expected at least 4'),
        (('solve', 'nothing', '--tensions', '[]'), "no preset arm 'nothing', expected one of "),
        (('solve', 'nowhere.yaml', '--tensions', '[]'), 'nowhere.yaml: No such file or directory'),
        (('solve', '.', '--tensions', '[]'), '.: Is a directory'),
        (('reproduce', __file__), f'outdir is {__file__!r}, a file, expected a folder'),
        (('play', 'rotating', '--csv', '/proc/x.csv'), "--csv is '/proc/x.csv', cannot be writt"),
        (('compare', 'bag', '--out', '/proc'), "--out is '/proc', cannot be written: "),
        (('identify', 'bag', '--out', '/tmp', '--csv', '/tmp'), "--out is '/tmp', a folder, exp"),
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
        (), ('draw',), ('solve',), ('reproduce',),
        (*SOLVE, TENSIONS, '--model', 'best'), (*SOLVE, TENSIONS, '--stations', 'many'),
        ('compare', ''), ('compare', 'bag', '--out', ''), ('replay', 'bag', ''),
    ],
)  # fmt: skip
def test_wrong_usage_is_status_2(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as leave:
        main(arguments)
    assert leave.value.code == 2
    err = capsys.readouterr().err
    assert err.startswith('octo-arm')
    assert 'error: ' in err
    assert '--help\n' in err
    assert err.count('\n') == 1


@pytest.mark.parametrize(
    'words',
    [
        (*SOLVE, TENSIONS, '--stations', '9', '--stations', '11'),
        (*SOLVE, TENSIONS, '--tensions', TENSIONS),
        ('compare', 'bag', '--midlines', 'a', '--tolerance', '1', '--midlines', 'b'),
        ('identify', '--fit', 'friction', '--config', 'a.yaml', '--fit', 'friction'),
        ('inverse', 'renda2012_table4', '--tip', '0', '0', '0', '--tip', '0', '0', '0'),
    ],
)
def test_an_option_is_given_once_as_the_last_would_replace_the_others(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as leave:
        main(words)
    assert leave.value.code == 2
    assert 'is given twice, expected once' in capsys.readouterr().err


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
