"""Quasi-static recordings without steps, of the arm that finite elements have."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import bag_of, description, nanoseconds, path_sample, tension_samples
from labs import MARKER_S, STATIONS, TENSIONS, TIP_ERRORS, at_any, pose_array

STILL = ['--clock-offset', '0', '--json']


@pytest.fixture(scope='module')
def ramp(tmp_path_factory):
    """A bag: pulled for 30 s and let go for 30 s, at a steady rate; midlines at 5 Hz."""
    time = np.arange(0.0, 60.0, 0.02)
    pulled = np.interp(time, [0.0, 30.0, 60.0], [TENSIONS[0], TENSIONS[-1], TENSIONS[0]])
    samples = [description(model='exact'), *tension_samples(time, pulled)]
    for at in np.arange(0.1, 59.9, 0.2):
        line = at_any(float(np.interp(at, time, pulled)), STATIONS)
        samples.append(path_sample(line, nanoseconds(at)))
    return str(bag_of(tmp_path_factory.mktemp('ramp') / 'bag', samples))


def test_what_has_no_steps_is_refused_with_the_way_to_read_it(ramp, cli):
    # At the defaults the turn at the top counts as a step, of a fraction of the time.
    said = cli.json('compare', ramp, *STILL)
    assert len(said['steps']) == 1
    assert any('tensions are steady in' in note and 'say --ramp' in note for note in said['notes'])
    line = cli.refused('compare', ramp, '--steady', '0.02', *STILL, status=1)
    assert 'no tension stays within' in line
    assert 'where it changes slowly instead of in steps, say --ramp' in line


@pytest.mark.parametrize('width', [[], ['0.3']])
def test_a_ramp_has_the_errors_of_its_tensions(width, ramp, cli):
    said = cli.json('compare', ramp, '--ramp', *width, *STILL)
    assert len(said['steps']) > 20
    for step in said['steps']:
        expected = np.interp(step['tension'], TENSIONS, TIP_ERRORS)
        assert step['tip_error_percent'] == pytest.approx(expected, abs=0.12)
    assert any('windows of a ramp' in note for note in said['notes'])


def test_markers_of_a_ramp_are_no_outliers_for_moving_more_towards_the_tip(tmp_path, cli):
    time = np.arange(0.0, 30.0, 0.02)
    pulled = np.interp(time, [0.0, 30.0], [TENSIONS[0], TENSIONS[-1]])
    samples = [description(model='exact'), *tension_samples(time, pulled)]
    for at in np.arange(0.1, 29.9, 0.1):
        points = at_any(float(np.interp(at, time, pulled)), MARKER_S)
        samples += pose_array(points, nanoseconds(at))
    bag = str(bag_of(tmp_path / 'bag', samples))
    given = ['--marker-s', *map(str, MARKER_S), '--ramp']
    said = cli.json('compare', bag, *given, *STILL)
    assert [step['outliers'] for step in said['steps']] == [0] * len(said['steps'])
    assert any('298 of 298 used' in note for note in said['notes'])
    for step in said['steps']:
        expected = np.interp(step['tension'], TENSIONS, TIP_ERRORS)
        assert step['tip_error_percent'] == pytest.approx(expected, abs=0.12)


def test_an_arm_is_fitted_to_a_ramp(ramp, cli):
    fitted = cli.json('identify', ramp, '--ramp', '1.2', *STILL, '--model', 'exact')
    assert fitted['estimates']['youngs_modulus']['value'] == pytest.approx(1.1e5, rel=0.03)


@pytest.mark.parametrize(
    ('width', 'message'),
    [
        ('1e-4', 'more than 1000 windows of 0.0001 N, expected a wider'),
        ('nan', '--ramp is '),
        ('0', '--ramp is '),
    ],
)
def test_widths_that_make_too_many_windows_or_none_are_refused(width, message, ramp, cli):
    assert message in cli.refused('compare', ramp, '--ramp', width, *STILL)
