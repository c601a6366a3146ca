"""Command profiles and their files, movements that are built in, and limits of commands."""

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from checkout import PRESETS
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from octo_arm_model import TensionError, load_config
from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.simulation.movements import (
    check_profile,
    find_profile,
    highest_tensions,
    profile_names,
    tendon_limits,
)
from octo_arm_model.simulation.profiles import (
    INTERPOLATIONS,
    CommandProfile,
    read_profile,
    transition,
    write_csv,
)


@st.composite
def profiles(draw: st.DrawFn) -> CommandProfile:
    """Profiles of two tendons, slack ones and equal rows among them."""
    count = draw(st.integers(2, 8))
    gaps = draw(st.lists(st.floats(1e-3, 10.0), min_size=count, max_size=count))
    pull = st.just(0.0) | st.floats(1e-3, 20.0)
    rows = draw(st.lists(st.tuples(pull, pull), min_size=count, max_size=count))
    return CommandProfile(np.cumsum(gaps), np.array(rows), draw(st.sampled_from(INTERPOLATIONS)))


@given(profiles(), st.floats(-5.0, 100.0))
def test_a_profile_goes_through_its_rows_and_never_leaves_the_range_of_two(profile, time):
    assert_allclose(profile.at(profile.times), profile.tensions, atol=1e-12)
    assert (profile.times[0], profile.duration) == (0.0, profile.times[-1])
    row = np.clip(np.searchsorted(profile.times, time) - 1, 0, len(profile.times) - 2)
    low, high = np.sort(profile.tensions[row : row + 2], axis=0)
    if time > profile.duration:
        low = high = profile.tensions[-1]
    tensions = profile.at(time)
    assert (tensions >= low - 1e-9).all()
    assert (tensions <= high + 1e-9).all()
    assert (tensions >= 0.0).all()


@given(profiles(), st.floats(1e-3, 0.999), st.integers(0, 5))
def test_a_loop_begins_anew(profile, part, rounds):
    # Away from the seam, where the profile may jump from its end to its start.
    time = part * profile.duration
    again = profile.at(time + rounds * profile.duration, loop=True)
    if profile.interpolation != 'steps':
        assert_allclose(again, profile.at(time), atol=1e-6)


def test_smooth_begins_and_ends_at_rest_and_rests_in_postures():
    profile = CommandProfile([0.0, 1.0, 2.0, 5.0], [[0.0], [4.0], [4.0], [1.0]])
    moments = np.array([0.0, 1.0, 1.5, 2.0, 5.0])
    speed = (profile.at(moments + 1e-6) - profile.at(moments - 1e-6)) / 2e-6
    assert_allclose(speed, 0.0, atol=1e-4)
    assert profile.at(0.5)[0] == pytest.approx(2.0)


def test_steps_hold_and_linear_is_straight():
    rows = [0.0, 1.0, 3.0], [[0.0], [2.0], [6.0]]
    times = np.array([0.0, 0.5, 0.999, 1.0, 2.0, 2.999, 3.0, 9.0])
    held = CommandProfile(*rows, 'steps').at(times).ravel()
    assert held.tolist() == [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 6.0, 6.0]
    straight = CommandProfile(*rows, 'linear').at(times).ravel()
    assert_allclose(straight, [0.0, 1.0, 1.998, 2.0, 4.0, 5.998, 6.0, 6.0])


def test_a_transition_is_smooth_and_takes_tensions_as_an_arm_shapes_them():
    way = transition(np.full((3, 4), 1.0), np.zeros((3, 4)), 2.0)
    assert way.duration == 2.0
    assert_allclose(way.at(1.0), np.full(12, 0.5))
    with pytest.raises(ProfileError, match=r'row 2: time is 0.0, expected more than 0.0'):
        transition(np.zeros(4), np.ones(4), 0.0)


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
    assert profile.interpolation == 'linear'
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
        ('.csv', HEADER + '0,0,0,0,0\n1,0,nan,0,0\n', ": line 3: tendon_1_2 is 'nan', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,-2,0,0\n', ": line 3: tendon_1_2 is '-2', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n\n0,0,0,0,0\n', ': line 4: time is 0.0, expected more'),
        (
            '.csv',
            HEADER + 'inf,0,0,0,0\n1,0,0,0,0\n',
            ": line 2: time is 'inf', expected a finite",
        ),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,0,0\n', ': line 3: 4 values, expected 5 as in the'),
        ('.csv', HEADER + '0,0,0,0,0\n1,,0,0,0\n', ": line 3: tendon_1_1 is '', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n', ': 1 row(s), expected at least two'),
        ('.csv', HEADER, ': 0 row(s), expected at least two'),
        ('.csv', '0,0,0,0,0\n1,0,0,0,0\n', ': line 1: header is 0, 0, 0, 0, 0; expected time, '),
        ('.csv', HEADER.replace('1_4', '9_9'), 'tendon_9_9; expected time, tendon_1_1'),
        ('.csv', HEADER.replace('1_4', '1_1'), 'line 1: header is'),
        ('.csv', b'\xff\xfe\x00', ': not a text file'),
        ('.csv', '"' + 'x' * 200000, ': not what its suffix says'),
        ('.yaml', YAML.replace('2.5', '1'), ': row 3: time is 1.0, expected more'),
        ('.yaml', YAML.replace('1e-1', '.nan'), ': row 2: tension 4 is nan, expected a'),
        ('.yaml', YAML.replace('0, 0, 2, 0', '0, 0, 2'), ': row 3: tensions are [0, 0, 2], exp'),
        ('.yaml', YAML.replace('2.5]', '2, 3]'), ': times are (4,) and tensions (3, 4)'),
        ('.yaml', YAML.replace('1e-1', '[1]'), ': row 2: tensions are [1, 0, 0, [1]], exp'),
        ('.yaml', YAML.replace('linear', 'cubic'), ": interpolation is 'cubic', expected smooth"),
        ('.yaml', YAML.replace('times', 'time'), ': interpolation, time, tensions found, exp'),
        ('.yaml', YAML + 'times: [1]\n', ", line 8: not valid YAML, 'times' is given"),
        ('.yaml', 'times: 3\ntensions: []\n', ': times is 3, expected a list'),
        ('.yaml', 'times: [1, 2]\n', ': times found, expected times:, tensions:'),
        ('.yaml', '- 1\n', ': [1] found, expected times:, tensions:'),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,1_0,0,0\n', ": line 3: tendon_1_2 is '1_0', expected a"),
        ('.csv', HEADER + '0,0,0,0,0\n1,0,\u0661,0,0\n', ': line 3: tendon_1_2 is '),
        ('.csv', HEADER + '0,0,0,0,0\n' * 100_001, ': line 100002: more than 100000 rows'),
        ('.yaml', YAML.replace('2.5', '1:30'), ": times are [0, 1, '1:30'], expected numbers"),
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


# Movements ---------------------------------------------------------------------------------------


ANY_ARM = ('ramps', 'steps', 'sweeps')


@pytest.mark.parametrize('name', PRESETS)
def test_every_movement_of_an_arm_is_within_its_limits_and_answered_by_its_model(name):
    config = load_config(name)
    arm, solver = config.arm, config.solver()
    assert set(ANY_ARM) <= set(profile_names(arm))
    for movement in profile_names(arm):
        profile = find_profile(movement, arm)
        check_profile(profile, arm, tendon_limits(config))
        times = np.linspace(0.0, profile.duration, 60)
        shape = solver.solve(profile.at(times).reshape(-1, *arm.tension_shape))
        moved = np.linalg.norm(shape.tip - shape.tip[0], axis=-1).max()
        assert moved > 0.1 * arm.length, movement
        assert not profile.at(np.array([0.0, profile.duration])).any(), movement


def test_movements_of_any_arm_are_for_rods_of_three_tendons_too(rod):
    assert tuple(profile_names(rod.arm)) == ANY_ARM
    with pytest.raises(ProfileError, match='four tendons in section 1, this arm has 3'):
        find_profile('rotating', rod.arm)


def test_the_papers_tensions_are_held(table2, table4):
    for arm, name, postures in (
        (table4.arm, 'fetching_in_plane', [FETCHING_IN_PLANE]),
        (table4.arm, 'fetching_in_space', [FETCHING_IN_SPACE]),
        (table4.arm, 'fetching', [FETCHING_IN_PLANE, FETCHING_IN_SPACE]),
        (table2.arm, 'bending_b', [BENDING['B']]),
        (table2.arm, 'bending', list(BENDING.values())),
    ):
        profile = find_profile(name, arm)
        tensions = profile.at(np.arange(0.0, profile.duration, 0.01)).reshape(-1, 3, 4)
        moments = [(tensions == np.array(posture)).all(axis=(1, 2)) for posture in postures]
        assert all(is_there.sum() > 90 for is_there in moments), name
        assert (np.diff([np.argmax(is_there) for is_there in moments]) > 0).all(), name


def test_the_papers_tensions_are_refused_where_they_are_of_no_use(table4, prototype):
    assert 'bending' not in profile_names(table4.arm)
    with pytest.raises(ProfileError, match=r'are for renda2012_table2, and would compress'):
        find_profile('bending', table4.arm)
    with pytest.raises(ProfileError, match=r'are for 3 sections of 4 tendons, such as renda'):
        find_profile('fetching_in_space', prototype.arm)
    with pytest.raises(ProfileError, match='highest does not go with tensions of the paper'):
        find_profile('fetching', table4.arm, 1.0)


def test_the_bending_plane_goes_round_steadily(table2):
    profile = find_profile('rotating', table2.arm)
    times = np.linspace(0.3, 0.7, 200) * profile.duration
    t1, t2, t3, t4 = profile.at(times)[:, :4].T
    turned = np.diff(np.unwrap(np.arctan2(t3 - t1, t2 - t4)))
    assert_allclose(turned, turned.mean(), rtol=0.01)
    assert abs(turned.sum()) > 2.0 * np.pi
    assert not profile.tensions[:, 4:].any()


@pytest.mark.parametrize('name', ANY_ARM)
def test_tendons_are_pulled_one_by_one_up_to_their_highest(table4, name):
    highest = np.arange(1.0, 13.0).reshape(3, 4)
    profile = find_profile(name, table4.arm, highest)
    assert ((profile.tensions > 0.0).sum(axis=1) <= 1).all()
    assert_allclose(profile.tensions.max(axis=0), highest.ravel(), rtol=0.01)
    first = np.argmax(profile.tensions > 0.0, axis=0)
    assert (np.diff(first) > 0).all()


def test_sweeps_sweep_up_in_frequency(prototype):
    profile = find_profile('sweeps', prototype.arm)
    tensions = profile.tensions[:, 0]
    inside = tensions[1:-1]
    peaks = 1 + np.flatnonzero((inside > tensions[:-2]) & (inside >= tensions[2:]) & (inside > 0))
    periods = np.diff(profile.times[peaks])
    assert (np.diff(periods) < 0.0).all()
    assert periods[-1] < 0.5 * periods[0]


@pytest.mark.parametrize(
    'highest', [-1.0, np.nan, np.inf, 'much', [1.0, 2.0], [[1.0], [2.0, 3.0]]]
)
def test_highest_tensions_that_are_none_are_refused(table4, highest):
    with pytest.raises(TensionError, match='highest'):
        find_profile('ramps', table4.arm, highest)


def test_an_unknown_name_is_answered_with_those_there_are(prototype):
    with pytest.raises(ProfileError) as caught:
        find_profile('dance', prototype.arm)
    assert str(caught.value) == (
        "no profile 'dance', expected a .csv or .yaml file or one of rotating, ramps, steps, "
        'sweeps'
    )


CONFIG = load_config('renda2012_table4')


def test_limits_given_take_the_place_of_what_the_arm_bears():
    assert_array_equal(tendon_limits(CONFIG), highest_tensions(CONFIG.arm))
    given = [0.1 * (j + 1) for j in range(12)]
    assert_array_equal(tendon_limits(dataclasses.replace(CONFIG, tendon_limits=given)), given)


def test_a_profile_beyond_a_limit_is_refused_with_its_row():
    limits = tendon_limits(CONFIG)
    rows = np.zeros((3, 12))
    rows[1, 4] = 2.0 * limits[4]
    with pytest.raises(ProfileError, match=r'row 2: tension of tendon_2_1 is 8\.0 N.* limit 4\.0'):
        check_profile(CommandProfile(np.arange(3.0), rows), CONFIG.arm, limits)
