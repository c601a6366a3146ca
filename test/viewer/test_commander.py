"""Commanded tensions over time, and as text."""

import shlex
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')


from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.simulation.profiles.commands import find_profile
from octo_arm_model.simulation.profiles.profile import CommandProfile
from octo_arm_model.viewer.commander import Commander, as_shell_line, as_yaml
from octo_arm_model.wire.tensions import TENDON_TENSIONS

CONFIG = load_config(preset_path('renda2012_table4'))
RAMP = CommandProfile([0.0, 2.0, 3.0], [[1.0, 0.0], [3.0, 1.0], [1.0, 0.0]], 'linear')


def test_nothing_is_commanded_before_a_hand_moves():
    commander = Commander([0.3, 0.0])
    assert commander.advance(0.0) is None
    assert not commander.is_moving
    commander.pull(1, 2.0)
    np.testing.assert_array_equal(commander.advance(1.0), [0.3, 2.0])
    assert commander.advance(2.0) is None


def test_a_posture_is_reached_smoothly_and_exactly():
    commander = Commander([2.0, 0.0])
    commander.move([0.0, 1.0], 10.0)
    way = [commander.advance(10.0 + t) for t in np.linspace(0.0, 1.0, 21)]
    seen = np.array([tensions for tensions in way if tensions is not None])
    assert (np.diff(seen[:, 0]) < 0.0).all()
    assert (np.diff(seen[:, 1]) > 0.0).all()
    assert np.abs(np.diff(seen, axis=0)).max() < 0.2  # no jump
    np.testing.assert_array_equal(seen[-1], [0.0, 1.0])
    assert not commander.is_moving
    assert commander.advance(12.0) is None


def test_a_profile_is_played_after_a_smooth_way_to_its_beginning():
    commander = Commander([0.0, 0.0])
    commander.play(RAMP, 5.0, speed=2.0)
    np.testing.assert_array_equal(commander.advance(6.0), RAMP.at(0.0))
    for time in (6.4, 7.1, 7.5, 8.9):
        np.testing.assert_allclose(commander.advance(time), RAMP.at(2.0 * (time - 6.0), loop=True))
    assert commander.is_moving
    commander.stop()
    assert commander.advance(10.0) is None


def test_a_profile_played_once_ends_where_it_ends():
    commander = Commander([1.0, 0.0])
    commander.play(RAMP, 0.0, loop=False)
    commander.advance(1.0)
    commander.advance(2.5)
    np.testing.assert_array_equal(commander.advance(9.0), RAMP.at(3.0))
    assert commander.profile is None
    assert commander.advance(10.0) is None


def test_another_speed_goes_on_from_the_same_place():
    commander = Commander([1.0, 0.0])
    commander.play(RAMP, 0.0)
    commander.advance(1.0)
    before = commander.advance(1.8)
    commander.change_speed(0.5, 1.8)
    np.testing.assert_allclose(commander.tensions, before)
    np.testing.assert_allclose(commander.advance(2.0), RAMP.at(0.9))


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
    np.testing.assert_array_equal(commander.advance(9.0), [0.25, others[1]])


@given(
    st.lists(st.integers(0, 50_000).map(lambda n: 1e-3 * n), min_size=12, max_size=12),
    st.floats(0.0, 5.0),
    st.floats(0.1, 3.0),
)
def test_whatever_is_commanded_is_a_tension(tensions, time, speed):
    commander = Commander(tensions)
    commander.play(find_profile('fetching', CONFIG.arm), 0.0, speed=speed)
    seen = commander.advance(time)
    assert seen is None or ((seen >= 0.0).all() and np.isfinite(seen).all())


@pytest.mark.parametrize('names', [(), ("it's", 'b: c', '#d', '"e"')])
def test_copied_tensions_are_the_message_they_stand_for(names, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    config = load_config(preset_path('renda2012_prototype'))
    arm = config.arm if not names else type(config.arm)(
        config.arm.material, config.arm.body, config.arm.sections, names
    )  # fmt: skip
    tensions = np.array([0.0, 1.0, 2.5, 1e-5])
    assert yaml.safe_load(as_yaml(arm, tensions)) == {
        'name': list(arm.tendon_names),
        'tension': tensions.tolist(),
    }
    *words, message = shlex.split(as_shell_line(arm, tensions, '/arm/tendon_commands'))
    assert words == [
        'ros2', 'topic', 'pub', '-1', '/arm/tendon_commands',
        'octo_arm_msgs/msg/TendonTensions',
    ]  # fmt: skip
    fields = yaml.safe_load(message)
    assert all(isinstance(tension, float) for tension in fields['tension'])
    read = TENDON_TENSIONS.read(SimpleNamespace(**fields), arm)
    np.testing.assert_array_equal(read.ravel(), tensions)
    # The page of a second arm, which is in a domain of its own, copies a line for that one.
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    line = as_shell_line(arm, tensions, '/arm/tendon_commands')
    assert shlex.split(line) == ['ROS_DOMAIN_ID=7', *words, message]
