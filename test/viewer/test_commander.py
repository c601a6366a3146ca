"""Commanded tensions over time, as text, and those that a target is searched for."""

import shlex
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from octo_arm_model import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.simulation.movements import find_profile, highest_tensions
from octo_arm_model.simulation.profiles import CommandProfile
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.commander import Commander, TargetSearch, as_shell_line, as_yaml
from octo_arm_model.wire.tensions import TENDON_TENSIONS

CONFIG = load_config('renda2012_table4')
SOLVER = CONFIG.solver()
RAMP = CommandProfile([0.0, 2.0, 3.0], [[1.0, 0.0], [3.0, 1.0], [1.0, 0.0]], 'linear')


def test_a_posture_is_reached_smoothly_and_exactly():
    commander = Commander([2.0, 0.0])
    assert commander.advance(0.0) is None and not commander.is_moving
    commander.move([0.0, 1.0], 10.0)
    way = [commander.advance(10.0 + t) for t in np.linspace(0.0, 1.0, 21)]
    seen = np.array([tensions for tensions in way if tensions is not None])
    assert (np.diff(seen[:, 0]) < 0.0).all() and (np.diff(seen[:, 1]) > 0.0).all()
    assert np.abs(np.diff(seen, axis=0)).max() < 0.2  # no jump
    assert_array_equal(seen[-1], [0.0, 1.0])
    assert not commander.is_moving and commander.advance(12.0) is None


def test_a_profile_is_played_after_a_smooth_way_to_its_beginning_and_at_any_speed():
    commander = Commander([0.0, 0.0])
    commander.play(RAMP, 5.0, speed=2.0)
    assert_array_equal(commander.advance(6.0), RAMP.at(0.0))
    for time in (6.4, 7.1, 7.5, 8.9):
        assert_allclose(commander.advance(time), RAMP.at(2.0 * (time - 6.0), loop=True))
    commander.change_speed(0.5, 8.9)  # from the same place on
    assert_allclose(commander.advance(9.1), RAMP.at(2.0 * 2.9 + 0.1, loop=True))
    commander.stop()
    assert commander.advance(10.0) is None
    commander = Commander([1.0, 0.0])
    commander.play(RAMP, 0.0, loop=False)
    commander.advance(1.0)
    assert commander.advance(2.5) is not None
    assert_array_equal(commander.advance(9.0), RAMP.at(3.0))
    assert commander.profile is None and commander.advance(10.0) is None


@pytest.mark.parametrize('what', ['move', 'play'])
def test_a_hand_on_a_slider_stops_what_is_under_way(what):
    commander = Commander([0.0, 0.0])
    if what == 'move':
        commander.move([4.0, 4.0], 0.0)
    else:
        commander.play(RAMP, 0.0)
        commander.advance(1.0)
    others = commander.advance(1.5)
    commander.pull(0, 0.25)
    assert not commander.is_moving
    assert_array_equal(commander.advance(9.0), [0.25, others[1]])


@given(
    st.lists(st.integers(0, 50_000).map(lambda n: 1e-3 * n), min_size=12, max_size=12),
    st.floats(0.0, 5.0), st.floats(0.1, 3.0),
)  # fmt: skip
def test_whatever_is_commanded_is_a_tension(tensions, time, speed):
    commander = Commander(tensions)
    commander.play(find_profile('fetching', CONFIG.arm), 0.0, speed=speed)
    seen = commander.advance(time)
    assert seen is None or ((seen >= 0.0).all() and np.isfinite(seen).all())


@pytest.mark.parametrize('names', [(), ("it's", 'b: c', '#d', '"e"')])
def test_copied_tensions_are_the_message_they_stand_for(names, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    arm = load_config('renda2012_prototype').arm
    arm = type(arm)(arm.material, arm.body, arm.sections, names) if names else arm
    tensions = np.array([0.0, 1.0, 2.5, 1e-5])
    expected = {'name': list(arm.tendon_names), 'tension': tensions.tolist()}
    assert yaml.safe_load(as_yaml(arm, tensions)) == expected
    *words, message = shlex.split(as_shell_line(arm, tensions, '/arm/tendon_commands'))
    kind = 'octo_arm_msgs/msg/TendonTensions'
    assert words == ['ros2', 'topic', 'pub', '-1', '/arm/tendon_commands', kind]
    fields = yaml.safe_load(message)
    assert all(isinstance(tension, float) for tension in fields['tension'])
    read = TENDON_TENSIONS.read(SimpleNamespace(**fields), arm)
    assert_array_equal(read.ravel(), tensions)
    # The page of a second arm, which is in a domain of its own, copies a line for that one.
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    line = as_shell_line(arm, tensions, '/arm/tendon_commands')
    assert shlex.split(line) == ['ROS_DOMAIN_ID=7', *words, message]


def answers_to(*targets):
    """Those of a search that is asked for all of the ``targets`` at once."""
    answers = []
    search = TargetSearch(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    for target in targets:
        search.request(target, np.zeros(12))
    search.close()
    search.thread.join(30.0)
    assert not search.thread.is_alive()
    return answers


def test_of_many_targets_the_newest_is_found():
    last = SOLVER.solve(0.5 * np.array(FETCHING_IN_SPACE)).tip
    (answer,) = answers_to(*([x, 0.1, -0.1] for x in (0.44, 0.3, 0.2)), last)
    assert answer.reached
    assert_allclose(answer.backbone.tip, last, atol=1e-6)
    assert 'reached: the tip is within' in numbers.found(answer)


def test_what_cannot_be_reached_or_is_nonsense_is_told():
    (answer,) = answers_to([0.5, 0.0, 0.0])
    assert not answer.reached and answer.error == pytest.approx(0.05, rel=1e-3)
    assert 'out of reach: the nearest found leaves 50.0 mm' in numbers.found(answer)
    (answer,) = answers_to([np.nan, 0.0, 0.0])
    assert 'finite' in numbers.failed(answer)
