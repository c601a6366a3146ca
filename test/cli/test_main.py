"""The command line: wrong input and usage, exit statuses, and that it runs as a module."""

import json
import re
import sys

import pytest
from command_line import SOLVE, TENSIONS

from octo_arm_model.cli import workspace

REEL = (*SOLVE[:2], '--displacements')


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ((*SOLVE, TENSIONS, '--gravity', '0', '0', '-9.81'), "model is 'renda2012', which"),
        (
            (*SOLVE, TENSIONS, '--model', 'exact', '--gravity', '0', '0', '-9.81'),
            'material.density is 0.0, expected a density > 0',
        ),
        ((*SOLVE, TENSIONS, '--model', 'exact', '--density', '1080'),
         '--density has no effect without --gravity'),
        ((*SOLVE, TENSIONS, '--model', 'exact', '--fluid-density', '1000'),
         '--fluid-density has no effect without --gravity'),
        (
            (*SOLVE, TENSIONS, '--model', 'exact', '--tip-force', '0', '1e6', '0'),
            'loads.tip_force is (0.0, 1000000.0, 0.0), expected at most 138.2 N',
        ),
        (('inverse', 'renda2012_table4'), 'expected either --tip X Y Z or --bend PLANE ANGLE'),
        (
            ('inverse', 'renda2012_table4', '--bend', '0', '9', '--model', 'closed_form',
             '--stiffness', '0', '0', '1', '1'),
            'the model has no loads, so no compliance: choose exact',
        ),
        ((*SOLVE, 'much'), '--tensions is not JSON at character 1, expected text such as'),
        ((*SOLVE[:-1], '--displacements', '{a: 1}'),
         """is not JSON at character 2, expected text such as '{"tendon_1_1": 0.02}'"""),
        ((*SOLVE, '[' * 100_000), '--tensions is not JSON, expected text such as'),
        (('inverse', 'renda2012_table4', '--tip', '0.2', '0', '0', '--highest', 'true'),
         'highest is True, expected one number or shape (3, 4)'),
        (('workspace', 'renda2012_table4', '--json', '--highest', '[[1,1,1,true],[1],[1]]'),
         'highest: tensions must be numbers'),
        (('play', 'rotating', '--csv', 'x.csv', '--highest', 'true'), 'highest is True, expected'),
        ((*SOLVE, '{"a": 1}'), 'tensions must be numbers in rows of equal length'),
        ((*SOLVE, f'[{TENSIONS}]'), '--tensions holds several sets, expected one row for each'),
        (('reproduce', __file__), f'outdir is {__file__!r}, a file, expected a folder'),
        (('play', 'rotating', '--csv', '/proc/x.csv'), "--csv is '/proc/x.csv', cannot be writt"),
        (('compare', 'bag', '--out', '/proc'), "--out is '/proc', cannot be written: "),
        (('identify', 'bag', '--out', '/tmp', '--csv', '/tmp'), "--out is '/tmp', a folder, exp"),
        (('workspace', 'renda2012_table4', '--out', '.'), "--out is '.', a folder"),
        (('play',), 'expected either PROFILE or --list'),
        (('play', 'ramps', '--rate', 'nan'), '--rate is nan, expected 1.0 to 1000.0 [Hz]'),
        (('play', 'ramps', '--csv', 'a.csv', '--loop'), '--loop has no effect with --csv'),
        (('play', 'ramps', '--plot', 'a.png', '--topic', 'a'), '--topic has no effect with --csv'),
        (('play', 'ramps', '--csv', 'a', '--plot', 'a'), "--csv and --plot are 'a', expec"),
        (('play', '--list', '--csv', 'a.csv'), '--csv has no effect with --list'),
        (SOLVE[:2], 'neither --tensions nor --displacements is given'),
        ((*REEL, '[0.01]'), '--displacements is [0.01], expected numbers by name'),
        ((*REEL, '{"tendon_1_1": "x"}'), 'expected numbers by name'),
        ((*REEL, '{"tendon_1_1": 20}'), 'less than there is to reel in: 0.45 m'),
        ((*REEL, '{"tendon_1_1": 0.01, "tendon_1_1": 0}'), 'expected each name once'),
        ((*REEL, f'{{"tendon_1_1": {10**400}}}'), 'expected a finite number'),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_on_stderr_and_status_2(cli, arguments, message):
    assert message in cli.refused(*arguments)


def test_a_header_of_several_lines_is_named_on_one(cli, tmp_path):
    path = tmp_path / 'profile.csv'
    path.write_text('"time\nand",more\n0,1\n')
    line = cli.refused('play', path, '--csv', tmp_path / 'out.csv')
    assert 'header is time and, more; expected time, tendon_1_1' in line


@pytest.mark.parametrize(
    'arguments',
    [
        (), ('draw',), ('solve',), ('reproduce',),
        (*SOLVE, TENSIONS, '--model', 'best'), (*SOLVE, TENSIONS, '--stations', 'many'),
        ('compare', ''), ('compare', 'bag', '--out', ''), ('replay', 'bag', ''),
    ],
)  # fmt: skip
def test_wrong_usage_is_status_2(cli, arguments):
    status, _, err = cli.left(*arguments)
    assert status == 2 and err.startswith('octo-arm') and err.count('\n') == 1
    assert 'error: ' in err and '--help\n' in err


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
def test_an_option_is_given_once_as_the_last_would_replace_the_others(cli, words):
    status, _, err = cli.left(*words)
    assert status == 2 and 'is given twice, expected once' in err


@pytest.mark.parametrize(
    ('tension', 'message'),
    [
        ('1e3', r'tensions compress the arm to nothing at s = 0.45 m \(q = -.*, must be > -1\)'),
        ('1e300', r'tension of 1e\+300 N is beyond .* N, a million times what would compress .*'),
    ],
)
def test_no_trustworthy_answer_is_one_line_on_stderr_and_status_1(cli, tension, message):
    everywhere = json.dumps([[float(tension)] * 4] * 3)
    assert re.fullmatch(f'{message}\n', cli.refused(*SOLVE, everywhere, status=1))


def test_an_interrupted_command_says_so(cli, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(workspace, 'sample_workspace', interrupted)
    assert cli('workspace', 'renda2012_table4', '--json') == (130, '', 'octo-arm: interrupted\n')


def test_without_ros_playing_says_what_to_do(cli, monkeypatch):
    for name in ['rclpy', *(one for one in sys.modules if one.startswith('rclpy.'))]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, 'octo_arm_model.ros.client.commands', raising=False)
    line = cli.refused('play', 'ramps')
    assert 'playing needs ROS 2' in line and re.search(r'\(rclpy(\.\w+)? is missing\)', line)
