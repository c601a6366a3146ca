"""Steady windows of recorded tensions, and the noise and rate that these show."""

import itertools

import numpy as np
import pytest
from experiments import HELD, staircase

from octo_arm_model.arm.errors import ArmDefinitionError, MeasurementError
from octo_arm_model.experiment.sensor_recording import tension_statistics
from octo_arm_model.experiment.steady_windows import (
    SteadyRule,
    Window,
    pose_windows,
    ramp_windows,
    reading_noise,
    steady_windows,
)

RNG = np.random.default_rng(5)
TIME = 0.01 * np.arange(4000)
NOISE = np.random.default_rng(3).standard_normal(TIME.size)


def windows_of(time: np.ndarray, pulled: np.ndarray, **rule: float) -> list[Window]:
    return steady_windows(time, pulled[:, np.newaxis], SteadyRule(**rule))


def test_every_held_tension_is_a_window_and_no_way_between_is():
    time, pulled = staircase(HELD, hold=3.0, ramp=1.0)
    found = windows_of(time, pulled + 0.01 * NOISE[: pulled.size])
    assert len(found) == len(HELD)
    for number, (window, tension) in enumerate(zip(found, HELD)):
        assert window.tensions == pytest.approx([tension], abs=0.005)
        assert window.noise == pytest.approx([0.01], rel=0.3)
        # From half a second after it is reached, within what the tolerance lets in of the ramp.
        assert window.start == pytest.approx(4.0 * number + 0.5, abs=0.2)
        assert window.stop == pytest.approx(4.0 * number + 3.0, abs=0.2)


def test_what_is_read_in_messages_of_their_own_holds_until_it_is_read_again():
    """Rows hold one of two tensions each by turns, and never the third."""
    time = np.arange(0.0, 12.0, 0.01)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((time.size, 2))
    steps = np.stack([np.where(time < 4.0, 0.02, 0.05), np.where(time < 8.0, 0.01, 0.04)], axis=1)
    is_read = np.arange(time.size)[:, np.newaxis] % 2 == [0, 1]
    rows = np.hstack([np.where(is_read, steps + noise, np.nan), np.full((time.size, 1), np.nan)])
    for read in (rows, rows[1:]):  # the second begins with the other tendon
        found = steady_windows(time[-len(read) :], read, SteadyRule())
        held = np.array([[0.02, 0.01], [0.05, 0.01], [0.05, 0.04]])
        assert np.array([window.tensions[:2] for window in found]) == pytest.approx(held, abs=2e-4)
        assert [window.stop for window in found] == pytest.approx([4.0, 8.0, 12.0], abs=0.1)
    assert SteadyRule().tolerance_for(rows) == pytest.approx(4e-3, rel=0.1)
    ramps = ramp_windows(time, np.where(is_read, steps, np.nan), 0.01)
    assert [window.start for window in ramps] == pytest.approx([0.0, 4.0, 8.0], abs=0.03)


def test_a_glitch_does_not_end_a_window_and_does_not_count_and_a_hole_does():
    time = np.arange(0.0, 6.0, 0.01)
    (window,) = windows_of(time, np.where((time > 3.0) & (time < 3.05), 4.0, 2.0))
    assert window.tensions.item() == pytest.approx(2.0)
    assert (window.start, window.stop) == pytest.approx((0.5, 5.99), abs=0.02)
    time = np.concatenate([np.arange(0.0, 3.0, 0.01), np.arange(8.0, 11.0, 0.01)])
    assert len(windows_of(time, np.full(time.size, 2.0))) == 2


@pytest.mark.parametrize('rule', [{'tolerance': 0.0}, {'duration': -1.0}, {'settle': np.nan}])
def test_rules_that_make_no_sense_are_refused(rule):
    with pytest.raises(ArmDefinitionError):
        SteadyRule(**rule)


@pytest.mark.parametrize('slack', [0.3, 0.5, 0.8])
def test_readings_of_a_slack_tendon_do_not_hide_the_noise_of_the_taut_one(slack):
    pulled = np.where(TIME < slack * TIME[-1], 0.0, 0.5 + 0.005 * NOISE)
    idle = np.zeros(TIME.size)
    assert reading_noise(np.stack([pulled, idle], axis=1)) == pytest.approx(0.005, rel=0.1)
    # A tendon that is slack reads noise above zero, and zero below it.
    clipped = np.maximum(pulled + np.where(pulled, 0.0, 0.005 * NOISE - 0.003), 0.0)
    assert 0.003 < reading_noise(clipped[:, np.newaxis]) < 0.006


# What is pulled, and not held: (seconds from row to row, rows of one or two tendons) [N].
NOT_HELD = {
    'poses': (2.3, RNG.uniform(0.0, 2.0, (40, 2))),
    'poses of one tendon': (2.3, RNG.uniform(0.0, 2.0, (40, 1))),
    'poses around one': (1.0, np.abs(RNG.normal(1.0, 0.3, (300, 2)))),
    'poses that rise': (3.0, np.sort(RNG.uniform(0.0, 2.0, (12, 1)), axis=0)),
    'poses on a grid': (2.0, RNG.integers(0, 5, (60, 4)) * 0.5),
    'held for 0.1 s': (0.01, np.repeat(RNG.uniform(0.0, 2.0, (200, 2)), 10, axis=0)),
    'held for one row': (0.1, RNG.uniform(0.0, 2.0, (400, 2))),
    'a fast sine': (0.1, 1.0 + np.sin(4.0 * np.pi * 0.1 * np.arange(300))[:, np.newaxis]),
    'faster': (0.1, 1.0 + np.sin(6.4 * np.pi * 0.1 * np.arange(300))[:, np.newaxis]),
    'a chirp': (0.05, 1.0 + np.sin(0.02 * np.arange(50, 400) ** 2)[:, np.newaxis]),
    'to and fro': (1.0, np.tile([[0.0], [2.0]], (30, 1))),
}


@pytest.mark.parametrize('name', NOT_HELD)
def test_what_is_not_held_is_neither_noise_nor_steady(name):
    step, tensions = NOT_HELD[name]
    assert reading_noise(tensions) == 0.0
    assert SteadyRule().tolerance_for(tensions) <= 0.02 * tensions.max()
    assert steady_windows(step * np.arange(len(tensions)), tensions, SteadyRule()) == []


@pytest.mark.parametrize('noise', [0.003, 0.03, 0.1, 0.3, 3.0])
def test_the_tolerance_is_bounded_by_the_highest_reading(noise):
    time, pulled = staircase(HELD, hold=3.0, ramp=1.0)
    read = (pulled + noise * NOISE[: pulled.size])[:, np.newaxis]
    assert SteadyRule().tolerance_for(read) <= 0.2 * np.abs(read).max()
    found = steady_windows(time, read, SteadyRule())
    # Above some five percent it is not told from the tension, and nothing is steady.
    if noise <= 0.03:
        assert len(found) == len(HELD)
    elif noise >= 0.3:
        assert not found


def test_each_row_of_a_table_is_a_pose():
    step, tensions = NOT_HELD['poses']
    time = step * np.arange(len(tensions))
    found = pose_windows(time, tensions, 0.1)
    assert np.array([window.tensions for window in found]).tolist() == tensions.tolist()
    for window, at in zip(found, time):
        assert (window.start, window.stop) == pytest.approx((at - 0.1, at + 0.1))
    # What is nearer together than that is not shared.
    near = pose_windows(0.01 * time, tensions, 0.1)
    assert all(one.stop < other.start for one, other in itertools.pairwise(near))
    assert len(pose_windows(time[:1], tensions[:1], 0.1)) == 1
    with pytest.raises(MeasurementError, match=r'two rows of tensions at 2\.3 s, expected anothe'):
        pose_windows(time[[0, 1, 1]], tensions[:3], 0.1)
    with pytest.raises(MeasurementError, match='1001 poses, expected at most 1000'):
        pose_windows(np.arange(1001.0), np.ones((1001, 1)), 0.1)


def test_noise_and_rate_of_recorded_tensions_are_found():
    noise = np.random.default_rng(0).standard_normal((4000, 2)) * [0.02, 0.005]
    assert tension_statistics(TIME, 1.0 + noise).noise == pytest.approx(0.02, rel=0.05)
    # A step is three standard deviations of the rate.
    tensions = np.where(TIME < 20.0, 0.0, 1.5)[:, np.newaxis]
    found = tension_statistics(TIME, tensions)
    assert found.rate == pytest.approx(1.5 / 3.0 / np.sqrt(0.01))
    shuffled = np.random.default_rng(1).permutation(4000)
    assert tension_statistics(TIME[shuffled], tensions[shuffled]) == found


@pytest.mark.parametrize('jitter', [1e-9, 1e-6, 9e-3])
def test_readings_of_nearly_one_stamp_make_no_tension_fast(jitter):
    """A tension that changes by 0.01 N from reading to reading, pairs of which came together."""
    time = 2.0 * TIME - np.where(np.arange(4000) % 2, 0.01 - jitter, 0.0)
    tensions = 0.01 * np.arange(4000)[:, np.newaxis]
    assert tension_statistics(time, tensions).rate <= 0.01 / 3.0 / np.sqrt(0.01) + 1e-9
