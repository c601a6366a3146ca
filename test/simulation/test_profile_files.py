"""Command profiles in CSV and YAML files, and what is refused of them."""

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.simulation.movements import find_profile
from octo_arm_model.simulation.profiles import read_profile, write_csv

CSV = """\
tendon_1_2, time, tendon_1_1, tendon_1_3, tendon_1_4

1, 10, 0, 0, 0
2, 11.5, 1e-1, 0, 0
"""


YAML = """\
# by hand
interpolation: linear
times: [0, 1, 2.5]
tensions:
  - [0, 0, 0, 0]
  - [1, 0, 0, 1e-1]
  - [0, 0, 2, 0]
"""


def written(tmp_path: Path, text: str | bytes, suffix: str) -> Path:
    path = tmp_path / f'profile{suffix}'
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_csv_columns_are_taken_by_name_and_time_from_the_first_row(tmp_path, prototype):
    profile = find_profile(str(written(tmp_path, CSV, '.csv')), prototype.arm)
    assert profile.times.tolist() == [0.0, 1.5]
    assert profile.tensions.tolist() == [[0.0, 1.0, 0.0, 0.0], [0.1, 2.0, 0.0, 0.0]]
    assert profile.interpolation == 'smooth'


def test_yaml_rows_are_in_the_order_of_the_tendons(tmp_path, prototype):
    profile = find_profile(str(written(tmp_path, YAML, '.yaml')), prototype.arm)
    assert profile.times.tolist() == [0.0, 1.0, 2.5]
    assert profile.tensions[1].tolist() == [1.0, 0.0, 0.0, 0.1]
    assert profile.interpolation == 'linear'


@pytest.mark.parametrize('name', ['time_left', 'timer [N]', 's [s]'])
def test_names_like_that_of_the_time_are_those_of_tendons(tmp_path, prototype, name):
    arm = dataclasses.replace(prototype.arm, tendon_names=(name, 'b', 'c', 'd'))
    times, tensions = np.arange(2.0), np.arange(8.0).reshape(2, 4)
    file = io.StringIO()
    write_csv(file, times, tensions, arm)
    assert read_profile(written(tmp_path, file.getvalue(), '.csv'), arm).tensions.tolist() == (
        tensions.tolist()
    )


def test_a_tendon_called_time_is_not_mistaken_for_the_time(tmp_path, prototype):
    arm = dataclasses.replace(prototype.arm, tendon_names=('time', 'b', 'c', 'd'))
    profile = read_profile(written(tmp_path, YAML, '.yaml'), arm)
    assert profile.times.tolist() == [0.0, 1.0, 2.5]
    assert profile.tensions[1].tolist() == [1.0, 0.0, 0.0, 0.1]
    for header in ('time,time,b,c,d', 'time,b,c,d'):
        rows = ''.join(f'{i}' + ',1' * header.count(',') + '\n' for i in range(2))
        with pytest.raises(ProfileError, match=r'header is .*; expected time, time, b, c, d'):
            read_profile(written(tmp_path, f'{header}\n{rows}', '.csv'), arm)


def test_a_written_profile_is_read_again(tmp_path, table4):
    profile = find_profile('fetching', table4.arm)
    file = io.StringIO()
    write_csv(file, profile.times, profile.tensions, table4.arm)
    again = read_profile(written(tmp_path, file.getvalue(), '.csv'), table4.arm)
    assert_array_equal(again.times, profile.times)
    assert_array_equal(again.tensions, profile.tensions)


HEADER = 'time,tendon_1_1,tendon_1_2,tendon_1_3,tendon_1_4\n'


@pytest.mark.parametrize(
    ('suffix', 'text', 'complaint'),
    [
        ('.csv', HEADER + '0,0,0,0,0\n1,0,nan,0,0\n', ", line 3: tendon_1_2 is 'nan', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,-2,0,0\n', ", line 3: tendon_1_2 is '-2', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n\n0,0,0,0,0\n', ', line 4: row 2: time is 0.0, expected m'),
        (
            '.csv',
            HEADER + 'inf,0,0,0,0\n1,0,0,0,0\n',
            ", line 2: time is 'inf', expected a finite",
        ),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,0,0\n', ', line 3: 4 values, expected 5 as in the'),
        ('.csv', HEADER + '0,0,0,0,0\n1,,0,0,0\n', ", line 3: tendon_1_1 is '', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n', ': 1 row(s), expected at least two'),
        ('.csv', HEADER, ': no rows, expected at least two'),
        ('.csv', '', ': no rows, expected at least two'),
        ('.csv', '0,0,0,0,0\n1,0,0,0,0\n', ', line 1: header is 0, 0, 0, 0, 0; expected time, '),
        ('.csv', HEADER.replace('1_4', '9_9'), 'tendon_9_9; expected time, tendon_1_1'),
        ('.csv', HEADER.replace('1_4', '1_1'), 'line 1: header is'),
        ('.csv', b'\xff\xfe\x00', ': not a text file'),
        ('.csv', '"' + 'x' * 200000, ': not what its suffix says'),
        ('.yaml', YAML.replace('2.5', '1'), ', line 3: row 3: time is 1.0, expected more'),
        ('.yaml', YAML.replace('1e-1', '.nan'), ", line 6: tendon_1_4 is '.nan', expected a"),
        ('.yaml', YAML.replace('0, 0, 2, 0', '0, 0, 2'), ', line 7: 3 values, expected 4: tendon'),
        ('.yaml', YAML.replace('2.5]', '2, 3]'), ', line 5: 3 rows of tensions, expected 4'),
        ('.yaml', YAML.replace('1e-1', '[1]'), ', line 6: a list where one value was expected'),
        ('.yaml', YAML.replace('linear', 'cubic'), ": interpolation is 'cubic', expected smooth"),
        ('.yaml', YAML.replace('times', 'time'), ", line 3: 'time' is unknown or given twice"),
        ('.yaml', YAML + 'times: [1]\n', ", line 8: 'times' is unknown or given twice"),
        ('.yaml', 'times: 3\ntensions: []\n', ', line 1: times is no list'),
        ('.yaml', 'times: [1, 2]\n', ', line 1: tensions is no list'),
        ('.yaml', '- 1\n', ', line 1: expected times: and tensions:'),
        ('.yaml', '', ', line 1: expected times: and tensions:'),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,1_0,0,0\n', ", line 3: tendon_1_2 is '1_0', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,\u0661,0,0\n', ', line 3: tendon_1_2 is '),
        ('.csv', HEADER + '0,0,0,0,0\n' * 100_001, ', line 100002: more than 100000 rows'),
        ('.yaml', YAML.replace('2.5', '1:30'), ", line 3: time is '1:30', expected a finite num"),
        ('.yaml', YAML.replace('2.5', 'true'), ", line 3: time is 'true', expected a finite num"),
        ('.yaml', YAML + '#' * 2**20, ': larger than 1048576 bytes'),
        ('.yaml', 'times: [1,\n', ', line 2: not valid YAML'),
        ('.yaml', '[' * 3000, 'line 1: not valid YAML, nested more than 20 deep'),
    ],
)
def test_bad_files_are_refused_in_one_line_that_names_theirs(
    tmp_path, prototype, suffix, text, complaint
):
    path = written(tmp_path, text, suffix)
    with pytest.raises(ProfileError) as caught:
        read_profile(path, prototype.arm)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert complaint in message
    assert '\n' not in message
