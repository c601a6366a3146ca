"""`octo-arm play`: what it lists, writes and refuses."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from octo_arm_model import Config
from octo_arm_model.simulation.profiles.commands import find_profile, profile_names
from octo_arm_model.simulation.profiles.profile_files import read_profile


def test_the_list_is_that_of_the_arm(capsys: pytest.CaptureFixture[str], table2: Config) -> None:
    status, out, err = run(capsys, 'play', '--list', '--config', 'renda2012_table2')
    assert (status, err) == (0, '')
    assert [line.split()[0] for line in out.splitlines()] == list(profile_names(table2.arm))
    assert '9.0 s  fetching in space' in out


def test_a_profile_is_written_at_the_speed_and_rate_asked_for(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, table4: Config
) -> None:
    out = tmp_path / 'fetching.csv'
    arguments = ('play', 'fetching', '--csv', str(out), '--speed', '2', '--rate', '10')
    assert run(capsys, *arguments) == (0, f'{out}\n', '')
    expected = find_profile('fetching', table4.arm)
    profile = read_profile(out, table4.arm)
    assert profile.duration == pytest.approx(0.5 * expected.duration)
    assert len(profile.times) == 1 + round(5.0 * expected.duration)
    np.testing.assert_allclose(profile.tensions, expected.at(2.0 * profile.times), atol=1e-6)


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs a device that is full')
def test_a_file_that_a_full_disk_cuts_short_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, 'play', 'fetching', '--csv', '/dev/full')
    assert (status, out) == (2, '')
    assert err.startswith('octo-arm: error: /dev/full: cannot be written: ')


def test_folders_of_a_profile_are_made_before_anything_is_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip('matplotlib')
    table = tmp_path / 'new' / 'ramps.csv'
    status, _, err = run(capsys, 'play', 'ramps', '--csv', str(table), '--plot', str(tmp_path))
    assert status == 2 and f'--plot is {str(tmp_path)!r}, a folder, expected a file' in err
    assert not table.parent.exists()
    assert run(capsys, 'play', 'ramps', '--csv', str(table))[:2] == (0, f'{table}\n')


def test_a_profile_is_drawn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    picture = tmp_path / 'ramps.png'
    status, out, _ = run(capsys, 'play', 'ramps', '--highest', '2', '--plot', str(picture))
    assert (status, out) == (0, f'{picture}\n')
    assert picture.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        ((), 'expected either PROFILE or --list'),
        (('ramps', '--list'), 'expected either PROFILE or --list'),
        (('bending',), 'these tensions are for renda2012_table2'),
        (('ramps', '--speed', '0'), '--speed is 0.0, expected a finite number > 0'),
        (('ramps', '--rate', 'nan'), '--rate is nan, expected 1.0 to 1000.0 [Hz]'),
        (('ramps', '--highest', '['), '--highest is not JSON'),
        (('ramps', '--config', 'nowhere'), "no preset arm 'nowhere'"),
        (('nowhere.csv',), 'nowhere.csv: No such file'),
        (('ramps', '--csv', 'a.csv', '--loop'), '--loop has no effect with --csv or --plot'),
        (('ramps', '--plot', 'a.png', '--topic', 'a'), '--topic has no effect with --csv'),
        (('ramps', '--csv', 'a', '--plot', 'a'), "--csv and --plot are 'a', expected two files"),
        (('--list', '--csv', 'a.csv'), '--csv has no effect with --list'),
    ],
)
def test_wrong_input_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], complaint: str
) -> None:
    status, out, err = run(capsys, 'play', *arguments)
    assert (status, out) == (2, '')
    assert complaint in err
    assert err.count('\n') == 1


def test_a_header_of_several_lines_is_named_on_one(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / 'profile.csv'
    path.write_text('"time\nand",more\n0,1\n')
    status, _, err = run(capsys, 'play', str(path), '--csv', str(tmp_path / 'out.csv'))
    assert status == 2
    assert 'header is time and, more; expected time, tendon_1_1' in err
    assert err.count('\n') == 1


def test_without_ros_playing_says_what_to_do(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ['rclpy', *(one for one in sys.modules if one.startswith('rclpy.'))]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, 'octo_arm_model.ros.client.commands', raising=False)
    status, _, err = run(capsys, 'play', 'ramps')
    assert status == 2
    assert 'playing needs ROS 2' in err
    assert re.search(r'\(rclpy(\.\w+)? is missing\)', err)
