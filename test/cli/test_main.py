"""The command line: wrong input and usage, and what solve, inverse, workspace and play make."""

import argparse
import dataclasses
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import HIGHEST, SOLVE, TENSIONS
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from octo_arm_model import Config, ConfigError, Loads, Solver
from octo_arm_model.analysis.workspace import sample_workspace
from octo_arm_model.cli import arguments, workspace
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml
from octo_arm_model.simulation.movements import find_profile, profile_names
from octo_arm_model.simulation.profiles import read_profile

TABLE4 = 'renda2012_table4'
PULLED = f"solve {TABLE4} --tensions '{TENSIONS}'"
EXACT = f'{PULLED} --model exact'
REEL = f'solve {TABLE4} --displacements'


# Commands and what is said of them, a line each: `=> ` is between both.
WRONG = f"""
{PULLED} --gravity 0 0 -9.81 => model is 'renda2012', which
{EXACT} --gravity 0 0 -9.81 => material.density is 0.0, expected a density > 0
{EXACT} --density 1080 => --density has no effect without --gravity
{EXACT} --fluid-density 1000 => --fluid-density has no effect without --gravity
{EXACT} --tip-force 0 1e6 0 => loads.tip_force is (0.0, 1000000.0, 0.0), expected at most 138.2 N
{EXACT} --tip-frame tip => no effect without --tip-force or --tip-mo
inverse {TABLE4} => expected either --tip X Y Z or --bend PLANE ANGLE
inverse {TABLE4} --bend 0 9 --model closed_form --stiffness 0 0 1 1 => the model has no loads, so \
no compliance: choose exact
inverse {TABLE4} --tip 0.2 0 0 --highest true => highest is True, expected one number \
or shape (3, 4)
solve {TABLE4} --tensions much => --tensions is not JSON at character 1, expected text
{REEL} '{{a: 1}}' => is not JSON at character 2, expected text such as tendon_1_1=0.02
solve {TABLE4} --tensions {'[' * 100_000} => --tensions is not JSON, expected text su
solve {TABLE4} --tensions '{{"a": 1}}' => unknown tendon a; this arm has tendon_1_1
solve {TABLE4} --tensions a=1 => unknown tendon a; this arm has tendon_1_1
solve {TABLE4} --tensions tendon_1_1=x => {{'tendon_1_1': 'x'}}, expected numbers by name
solve {TABLE4} --tensions tendon_1_1=1,tendon_1_1=0 => expected each name once
modes {TABLE4} --density 1 --tensions a=1 => unknown tendon a; this arm has tendon_1_1
solve {TABLE4} --tensions '[{TENSIONS}]' => --tensions holds several sets, expected one row for \
each
workspace {TABLE4} --json --highest [[1,1,1,true],[1],[1]] => highest: tensions are [[
workspace {TABLE4} --out . => --out is '.', a folder
reproduce {__file__} => outdir is {__file__!r}, a file, expected a folder
compare bag --out /proc => --out is '/proc', cannot be written:\x20
identify bag --out /tmp --csv /tmp => --out is '/tmp', a folder, exp
play => expected either PROFILE or --list
play rotating --csv x.csv --highest true => highest is True, expected
play rotating --csv /proc/x.csv => --csv is '/proc/x.csv', cannot be writt
play ramps --rate nan => --rate is nan, expected 1.0 to 1000.0 [Hz]
play ramps --csv a.csv --loop => --loop has no effect with --csv
play ramps --plot a.png --topic a => --topic has no effect with --csv
play ramps --csv a --plot a => --csv and --plot are 'a', expec
play --list --csv a.csv => --csv has no effect with --list
solve {TABLE4} => neither --tensions nor --displacements is given
{REEL} [0.01] => --displacements is [0.01], expected numbers by name
{REEL} '{{"tendon_1_1": "x"}}' => expected numbers by name
{REEL} '{{"tendon_1_1": 20}}' => less than there is to reel in: 0.45 m
{REEL} '{{"tendon_1_1": 0.01, "tendon_1_1": 0}}' => expected each name once
{REEL} '{{"tendon_1_1": {10**400}}}' => expected a finite number
"""


@pytest.mark.parametrize('line', WRONG.strip().split('\n'), ids=lambda line: line[:60])
def test_bad_input_is_one_line_on_stderr_and_status_2(cli, line):
    command, _, message = line.partition(' => ')
    assert message and message in cli.refused(command)


def test_a_header_of_several_lines_is_named_on_one(cli, tmp_path):
    path = tmp_path / 'profile.csv'
    path.write_text('"time\nand",more\n0,1\n')
    line = cli.refused('play', path, '--csv', tmp_path / 'out.csv')
    assert 'header is time and, more; expected time, tendon_1_1' in line


TWICE = 'is given twice, expected once'


@pytest.mark.parametrize(
    ('command', 'message'),
    [
        *((command, '') for command in ('', 'draw', 'solve', 'reproduce')),
        *(
            (f'{PULLED} {more}', '')
            for more in ('--model best', '--stations many', '--colour red')
        ),
        *((command, '') for command in ("compare ''", "compare bag --out ''", "replay bag ''")),
        # The last of both would replace the other.
        (f'{PULLED} --stations 9 --stations 11', TWICE),
        (f'{PULLED} --tensions []', TWICE),
        ('compare bag --midlines a --tolerance 1 --midlines b', TWICE),
        ('identify --fit friction --config a.yaml --fit friction', TWICE),
        (f'inverse {TABLE4} --tip 0 0 0 --tip 0 0 0', TWICE),
    ],
)
def test_wrong_usage_is_status_2(cli, command, message):
    status, _, err = cli.left(command)
    assert status == 2 and err.startswith('octo-arm') and err.count('\n') == 1
    assert 'error: ' in err and err.endswith(f'{err.partition(": ")[0]} --help\n')
    assert message in err


def test_a_text_of_options_with_a_typing_error_is_refused():
    for line in ('--a X flaot: a number', '--a X float a number', '--a b: a flag'):
        with pytest.raises(ValueError, match='is no option: expected'):
            arguments.add(argparse.ArgumentParser(), line)


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


def test_a_closed_standard_output_is_an_error(cli, monkeypatch):
    monkeypatch.setattr(sys, 'stdout', None)
    assert 'standard output is closed' in cli.refused(*SOLVE, 'tendon_1_1=1')


def test_without_ros_playing_says_what_to_do(cli, monkeypatch):
    for name in ['rclpy', *(one for one in sys.modules if one.startswith('rclpy.'))]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, 'octo_arm_model.ros.client.commands', raising=False)
    line = cli.refused('play', 'ramps')
    assert 'playing needs ROS 2' in line and re.search(r'\(rclpy(\.\w+)? is missing\)', line)


# Arms --------------------------------------------------------------------------------------------


def test_the_summary_of_a_shape_is_in_millimetres(cli, table4):
    status, out, err = cli(*SOLVE, TENSIONS)
    x, y, z = table4.solver().solve(FETCHING_IN_SPACE).tip * 1e3
    assert (status, err) == (0, '')
    assert f'({x:.2f}, {y:.2f}, {z:.2f}) mm, {np.linalg.norm([x, y, z]):.2f} mm from' in out
    assert 'renda2012, 101 stations' in out
    rows = re.findall(r'^ +(\d+) +([\d.]+) ', out, re.MULTILINE)
    assert rows == [('3', '0.00'), ('3', '135.00'), ('2', '315.00'), ('1', '450.00')]


def test_json_holds_the_whole_shape_in_si_units(cli, table4, model):
    shape = cli.json(*SOLVE, TENSIONS, '--json', '--model', model, '--stations', '41')
    solver = table4.solver(model, 41, compiled=False)
    expected = solver.solve(FETCHING_IN_SPACE)
    names = 'model s section position quaternion tau xi k q tension tendon_length displacement'
    assert list(shape) == [*names.split(), 'residual', 'iterations', 'slack']
    assert (shape.pop('slack'), shape.pop('model')) == ([], model)
    lengths = solver.tendon_lengths(expected)
    for name, values in shape.items():
        wanted = {
            'tension': np.array(FETCHING_IN_SPACE),
            'tendon_length': lengths,
            'displacement': solver.rest_lengths - lengths,
        }.get(name)
        wanted = getattr(expected, name) if wanted is None else wanted
        assert_allclose(values, wanted, atol=1e-12, err_msg=name)
    assert all(isinstance(number, int) for number in shape['section'])


def test_loads_and_material_may_be_said_on_the_command_line(cli, table4):
    physics = (
        '--model exact --material linear --gravity 0 0 -9.81 --density 1080 --fluid-density 1000 '
        '--tip-force 0 0.001 0 --tip-moment 0 0 1e-6'
    )
    shape = cli.json(*SOLVE, TENSIONS, '--json', *physics.split())
    loads = Loads((0, 0, -9.81), 1000, (0, 0.001, 0), (0, 0, 1e-6))
    arm = table4.arm.with_density(1080)
    solver = Solver(arm, 'exact', 101, table4.base, material='linear', loads=loads, compiled=False)
    expected = solver.solve(FETCHING_IN_SPACE)
    assert_allclose(shape['position'], expected.position, atol=1e-12)
    # What is left is of the size of rounding, and that is the processor's.
    assert max(shape['residual'], float(expected.residual)) < 1e-10
    assert shape['iterations'] == int(expected.iterations) > 0


def test_an_arm_of_the_water_may_be_in_air(cli, tmp_path):
    file, water = tmp_path / 'arm.yaml', {'loads.fluid_density': 1e3, 'motion.water': 'cylinder'}
    file.write_text(parameters_as_yaml(load_parameters('renda2012_table4') | water))
    options = ['--json', *'--model exact --gravity 0 0 -9.81 --density 1080'.split()]
    in_air = cli.json(*SOLVE, TENSIONS, *options)
    again = cli.json('solve', file, *SOLVE[2:], TENSIONS, *options, '--fluid-density', '0')
    assert again['position'] == in_air['position']


def test_tensions_by_name_are_those_of_rows_without_the_slack_tendons(cli):
    (rows,) = np.nonzero(np.ravel(FETCHING_IN_SPACE))
    tendons = [f'tendon_{1 + row // 4}_{1 + row % 4}' for row in rows]
    named = ','.join(f'{name}={np.ravel(FETCHING_IN_SPACE)[n]}' for name, n in zip(tendons, rows))
    shape = cli.json(*SOLVE, TENSIONS, '--json')
    assert cli.json(*SOLVE, named, '--json') == shape


def test_a_wrench_in_the_axes_of_the_tip_turns_with_it(cli, table4):
    given = '--tip-force 0.001 0.004 0 --tip-moment 0 -1e-5 0 --model exact'.split()
    shape = cli.json(*SOLVE, TENSIONS, '--json', *given, '--tip-frame', 'tip')
    turn = Rotation.from_quat(shape['quaternion'][-1])
    wrench = np.concatenate([turn.apply([0.001, 0.004, 0.0]), turn.apply([0.0, -1e-5, 0.0])])
    dead = Solver(table4.arm, 'exact', 101, table4.base).solve(FETCHING_IN_SPACE, wrench)
    assert_allclose(shape['position'], dead.position, atol=1e-9)
    assert np.abs(turn.as_matrix() - np.eye(3)).max() > 0.1
    values = load_parameters('renda2012_table4')
    own = {'tip_frame': 'tip', 'tip_force': [0.001, 0.004, 0.0], 'tip_moment': [0.0, -1e-5, 0.0]}
    values |= {'model': 'exact', **{f'loads.{name}': value for name, value in own.items()}}
    again = Config.from_parameters(values).solver().solve(FETCHING_IN_SPACE)
    assert_allclose(again.position, dead.position, atol=1e-9)
    with pytest.raises(ConfigError, match=r"tip_frame is 'arm', expected base or tip"):
        Config.from_parameters({**values, 'loads.tip_frame': 'arm'})


def test_the_command_line_replaces_the_wrench_of_a_file(cli, tmp_path):
    arm = load_parameters('renda2012_table4') | {'model': 'exact'}
    force, file = ('0', '0.004', '0'), tmp_path / 'arm.yaml'

    def tip(*options, **loads):
        own = {f'loads.tip_{name}': value for name, value in loads.items()}
        file.write_text(parameters_as_yaml(arm | own))
        answer = cli.json('solve', file, '--tensions', TENSIONS, '--json', *options)
        return list(answer['position'][-1])

    turning = tip(force=[0.0, 0.004, 0.0], frame='tip')
    assert tip('--tip-force', *force, force=[0.1, 0.0, 0.0], frame='tip') == turning
    dead = tip('--tip-frame', 'base', force=[0.0, 0.004, 0.0], frame='tip')
    assert dead == tip('--tip-force', *force)
    assert np.abs(np.subtract(dead, turning)).max() > 1e-3


def test_lengths_that_winches_reel_in_give_the_tensions(cli):
    """One tendon by length, one by tension, and one that is paid out too far to be taut."""
    asked = '{"tendon_1_1": 0.02, "tendon_2_1": -0.01}'
    arm = 'solve', 'renda2012_table4', '--model', 'exact'
    given = *arm, '--displacements', asked, '--tensions', '{"tendon_3_1": 1}'
    shape = cli.json(*given, '--json')
    assert shape['slack'] == ['tendon_2_1']
    assert shape['displacement'][0][0] == pytest.approx(0.02, abs=1e-9)
    assert shape['tension'][1:] == [[0, 0, 0, 0], [1, 0, 0, 0]]
    again = cli.json(*arm, '--tensions', json.dumps(shape['tension']), '--json')
    assert_allclose(again['position'], shape['position'], atol=1e-12)
    assert cli(*given)[1].endswith('slack: tendon_2_1\n')


def test_inverse_finds_tensions_whose_tip_is_where_it_was_wanted(cli, table4):
    answer = cli.json('inverse', 'renda2012_table4', '--tip', '0.25', '0.1', '-0.1', '--json')
    assert answer['reached']
    tip = table4.solver('exact').solve(answer['tensions']).tip
    assert_allclose(tip, [0.25, 0.1, -0.1], atol=1e-6)


def test_inverse_of_what_is_out_of_reach_says_so_with_status_1(cli, monkeypatch):
    monkeypatch.setattr('sys.stderr.isatty', lambda: True)
    status, out, shown = cli('inverse', 'renda2012_prototype', '--tip', '2', '0', '0')
    assert status == 1 and out.startswith('NOT REACHED') and 'search: 0 s' in shown
    assert re.search(r'error +17[34]\d mm', out)


def test_inverse_bends_in_the_plane_that_was_asked_for(cli):
    bend = 'inverse', 'renda2012_prototype', '--bend', '90', '40', '--highest'
    status, out, _ = cli(*bend, '3')
    # Towards +b: tendon 2 alone.
    tensions = [float(value) for value in re.findall(r'tendon_1_\d +([\d.]+)', out)]
    assert status == 0 and tensions[1] > 0.1
    assert_allclose(np.delete(tensions, 1), 0.0, atol=1e-3)
    # Out of reach of so small a tension it is nearly all error, and that an angle.
    status, out, _ = cli(*bend, '0.01')
    found = re.search(r'error +([\d.]+) deg,', out)
    assert status == 1 and found and 35.0 < float(found[1]) < 40.0
    answer = json.loads(cli(*bend, '0.01', '--json')[1])
    assert answer['distance_error'] is None
    assert np.degrees(answer['angle_error']) == pytest.approx(float(found[1]), rel=1e-3)


def test_errors_of_a_pose_are_a_distance_and_an_angle(cli, table4):
    place, turn = [0.4, 0.0, 0.0], Rotation.from_euler('z', 90.0, degrees=True)
    pose = '--tip', *place, '--quaternion', *turn.as_quat()
    given = 'inverse', 'renda2012_table4', *pose, '--model', 'closed_form', '--highest', '0.001'
    status, out, _ = cli(*given)
    found = re.search(r'error +([\d.]+) mm and ([\d.]+) deg,', out)
    assert status == 1 and found
    answer = json.loads(cli(*given, '--json')[1])
    backbone = table4.solver('closed_form').solve(answer['tensions'])
    turned = (Rotation.from_quat(backbone.quaternion[-1]) * turn.inv()).magnitude()
    away = 1e3 * np.linalg.norm(backbone.tip - place)
    assert [float(found[1]), float(found[2])] == pytest.approx([away, np.degrees(turned)], 1e-3)


def coloured(path: Path) -> int:
    """Pixels of the cloud of tips in a picture that is of a size and filled."""
    picture = pytest.importorskip('matplotlib.image').imread(path)[..., :3]
    height, width, _ = picture.shape
    rows, columns = np.nonzero(picture.min(axis=-1) < 0.9)
    assert min(height, width) > 800
    assert np.ptp(rows) > 0.9 * height and np.ptp(columns) > 0.9 * width
    left_of_the_bar = picture[:, :1180]
    return int((np.ptp(left_of_the_bar, axis=-1) > 0.2).sum())


def test_workspace_writes_a_picture_and_says_how_far_the_tips_reach(cli, tmp_path, cloud):
    path = tmp_path / 'new' / 'cloud'  # a PNG, whatever its name
    given = '--highest', json.dumps(HIGHEST.tolist()), '--samples', '256', '--out', path
    status, out, err = cli('workspace', 'renda2012_table4', *given)
    assert status == 0 and 'tensions  up to 0.1 ... 4 N' in out
    assert 'tips      256 of 256 sets of tensions, 0 refused' in out
    for i, name in enumerate('xyz'):
        low, high = cloud.tip[:, i].min() * 1e3, cloud.tip[:, i].max() * 1e3
        assert f'{name}         {low:.2f} to {high:.2f} mm, {high - low:.2f} mm in all' in out
    assert f'picture   {path}' in out
    assert err.startswith('256 sets of tensions in ')
    assert (err.count('\n'), err.count('\r')) == (1, 0)
    assert coloured(path) > 2000


def test_json_of_a_workspace_is_in_si_units_and_draws_nothing(cli, tmp_path, monkeypatch, table4):
    monkeypatch.chdir(tmp_path)
    given = '--samples', '96', '--seed', '7', '--model', 'closed_form', '--json'
    found = cli.json('workspace', 'renda2012_table4', '--highest', '0.6', *given)
    config = dataclasses.replace(table4, model='closed_form')
    expected = sample_workspace(config, 0.6, 96, 7, processes=1)
    assert expected.refused == found['refused'] > 0
    assert (found['samples'], found['model'], found['seed']) == (96, 'closed_form', 7)
    for name in ('highest', 'tensions', 'tip', 'direction'):
        assert_allclose(found[name], getattr(expected, name), atol=1e-12, err_msg=name)
    assert cli('workspace', 'renda2012_table4', '--highest', '1e9', *given)[0] == 1
    assert not list(tmp_path.iterdir())


def test_by_default_a_tendon_compresses_its_thin_end_by_a_tenth(cli, table4):
    found = cli.json('workspace', 'renda2012_table4', '--samples', '4', '--json')
    highest = np.array(found['highest'])
    ends = [section.anchorage for section in table4.arm.sections]
    area = np.pi * table4.arm.body.radius(ends) ** 2
    assert_allclose(highest, np.repeat(0.1 * 1.1e5 * area, 4).reshape(3, 4))
    # Alone, in the middle, it would shorten the end by a tenth: the four together by 0.4.
    ends_only = np.zeros((3, 4))
    ends_only[0] = highest[0] / 4.0
    assert table4.solver('closed_form').solve(ends_only).q[-1] == pytest.approx(-0.1)


def test_the_list_of_profiles_is_that_of_the_arm(cli, table2):
    status, out, err = cli('play', '--list', '--config', 'renda2012_table2')
    assert (status, err) == (0, '')
    assert [line.split()[0] for line in out.splitlines()] == list(profile_names(table2.arm))
    assert '9.0 s  fetching in space' in out


def test_a_profile_is_written_at_the_speed_and_rate_asked_for(cli, tmp_path, table4):
    out = tmp_path / 'fetching.csv'
    given = 'play', 'fetching', '--csv', out, '--speed', '2', '--rate', '10'
    assert cli(*given) == (0, f'{out}\n', '')
    expected = find_profile('fetching', table4.arm)
    profile = read_profile(out, table4.arm)
    assert profile.duration == pytest.approx(0.5 * expected.duration)
    assert len(profile.times) == 1 + round(5.0 * expected.duration)
    assert_allclose(profile.tensions, expected.at(2.0 * profile.times), atol=1e-6)


def test_a_profile_is_drawn_and_its_folder_made_before_anything_is_written(cli, tmp_path):
    pytest.importorskip('matplotlib')
    table, picture = tmp_path / 'new' / 'ramps.csv', tmp_path / 'ramps.png'
    line = cli.refused('play', 'ramps', '--csv', table, '--plot', tmp_path)
    assert f'--plot is {str(tmp_path)!r}, a folder, expected a file' in line
    assert not table.parent.exists()
    assert cli('play', 'ramps', '--csv', table)[:2] == (0, f'{table}\n')
    given = 'play', 'ramps', '--highest', '2', '--plot', picture
    assert cli(*given)[:2] == (0, f'{picture}\n')
    assert picture.read_bytes().startswith(b'\x89PNG')
