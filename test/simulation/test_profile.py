"""Command profiles: interpolation, and rows that are refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.simulation.profiles import INTERPOLATIONS, CommandProfile, transition


@st.composite
def profiles(draw: st.DrawFn) -> CommandProfile:
    """Profiles of two tendons, slack ones and equal rows among them."""
    count = draw(st.integers(2, 8))
    gaps = draw(st.lists(st.floats(1e-3, 10.0), min_size=count, max_size=count))
    pull = st.just(0.0) | st.floats(1e-3, 20.0)
    rows = draw(st.lists(st.tuples(pull, pull), min_size=count, max_size=count))
    return CommandProfile(np.cumsum(gaps), np.array(rows), draw(st.sampled_from(INTERPOLATIONS)))


@given(profiles())
def test_a_profile_goes_through_its_rows(profile):
    assert_allclose(profile.at(profile.times), profile.tensions, atol=1e-12)
    assert profile.times[0] == 0.0
    assert profile.duration == profile.times[-1]


@given(profiles(), st.floats(-5.0, 100.0))
def test_between_two_rows_tensions_never_leave_their_range(profile, time):
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


@pytest.mark.parametrize(
    ('times', 'rows', 'complaint'),
    [
        ([0.0, 1.0, 1.0], [[0.0]] * 3, 'row 3: time is 1.0, expected more than 1.0 [s]'),
        ([0.0, np.nan, 1.0], [[0.0]] * 3, 'row 2: time is nan, expected a finite number [s]'),
        ([0.0, 1.0], [[0.0, 1.0], [0.0, -1.0]], 'row 2: tension 2 is -1.0, expected a finite'),
        ([0.0, 1.0], [[0.0, np.inf], [0.0, 1.0]], 'row 1: tension 2 is inf'),
        ([0.0], [[0.0]], '1 row(s), expected at least two'),
        ([0.0, 1.0], [[0.0]] * 3, 'times are (2,) and tensions (3, 1)'),
    ],
)
def test_what_is_no_profile_is_refused_by_its_row(times, rows, complaint):
    with pytest.raises(ProfileError) as caught:
        CommandProfile(times, rows)
    assert complaint in str(caught.value)


def test_an_unknown_interpolation_is_refused():
    with pytest.raises(ProfileError, match="is 'cubic', expected smooth, linear, steps"):
        CommandProfile([0.0, 1.0], [[0.0], [1.0]], 'cubic')
