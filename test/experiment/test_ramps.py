"""Quasi-static recordings without steps, of the arm that finite elements have."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import experiments
import numpy as np
import pytest
from labs import MARKER_S, STATIONS, TENSIONS, TIP_ERRORS, at_any, pose_array, seen, staircase_of
from recordings import TENDON_TENSIONS, Sample, tensions_data

STILL = ['--clock-offset', '0', '--json']


@pytest.fixture(scope='module')
def ramp(tmp_path_factory):
    """A bag: pulled for 30 s and let go for 30 s, at a steady rate; midlines at 5 Hz."""
    time = np.arange(0.0, 60.0, 0.02)
    pulled = np.interp(time, [0.0, 30.0, 60.0], [TENSIONS[0], TENSIONS[-1], TENSIONS[0]])
    samples = [experiments.description(model='exact'), *experiments.tension_samples(time, pulled)]
    for at in np.arange(0.1, 59.9, 0.2):
        line = at_any(float(np.interp(at, time, pulled)), STATIONS)
        samples.append(experiments.path_sample(line, experiments.nanoseconds(at)))
    return str(experiments.bag_of(tmp_path_factory.mktemp('ramp') / 'bag', samples))


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
    samples = [experiments.description(model='exact'), *experiments.tension_samples(time, pulled)]
    for at in np.arange(0.1, 29.9, 0.1):
        points = at_any(float(np.interp(at, time, pulled)), MARKER_S)
        samples += pose_array(points, experiments.nanoseconds(at))
    bag = str(experiments.bag_of(tmp_path / 'bag', samples))
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


# Raw load cells: noise around zero, a wrong scale and an offset, told and fitted -----------------


GIVEN = ['--marker-s', *map(str, MARKER_S), '--clock-offset', '0', '--json']
COUNT = len(staircase_of()[0])
FEW = TENSIONS[::2]


def cell_bag(
    path: Path,
    scale: float = 1.0,
    offset: float = 0.0,
    held: Sequence[float] = TENSIONS,
    **changes: Any,
) -> str:
    """Cells of which the true tension is ``scale`` times the reading plus ``offset`` [N]."""
    rng = np.random.default_rng(0)
    time, pulled, times = staircase_of(held)
    samples: list[Sample] = [experiments.description(model='exact', **changes)]
    for at, pull in zip(time, pulled):
        true = experiments.one_tendon((pull - offset) / scale)
        read = true + 2e-3 * rng.standard_normal(4)
        stamp = experiments.nanoseconds(at)
        data = tensions_data(TENDON_TENSIONS, experiments.ARM.tendon_names, read, stamp)
        samples.append(Sample('/tendon_tensions', TENDON_TENSIONS, stamp, data))
    for at, pull in zip(times, np.interp(times, time, pulled)):
        samples += pose_array(seen(float(pull), MARKER_S), experiments.nanoseconds(at))
    return str(experiments.bag_of(path, samples))


def test_readings_below_zero_are_counted_by_reason_and_zero_within_a_deadband(tmp_path, cli):
    bag = cell_bag(tmp_path / 'raw')
    notes = cli.json('compare', bag, *GIVEN)['notes']
    counts = [int(note.split()[1]) for note in notes if 'left out, as tension of tendon_1' in note]
    # Seven of eight messages have one of three slack tendons below zero, by its name.
    assert len(counts) == 3
    assert sum(counts) == pytest.approx(7 / 8 * COUNT, rel=0.05)
    (report,) = cli.json('replay', bag, tmp_path / 'out', '--json')['topics'].values()
    assert sorted(report['reasons'].values()) == sorted(counts)
    quiet = cell_bag(tmp_path / 'quiet', tension_deadband=0.012)
    said = cli.json('compare', quiet, *GIVEN)
    assert not any('left out' in note for note in said['notes'])
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.05)
    replayed = cli.json('replay', quiet, tmp_path / 'all', '--json')
    (report,) = replayed['topics'].values()
    assert (report['answered'], report['refused']) == (COUNT, 0)


def test_the_fitted_file_reproduces_the_fit(tmp_path, cli):
    bag = cell_bag(tmp_path / 'bag', 1.2, 0.15, FEW, tension_deadband=0.012)
    fitted = str(tmp_path / 'fitted.yaml')
    fits = ['--model', 'exact', '--fit', 'tension_scale', 'tension_offset']
    said = cli.json('identify', bag, *GIVEN, *fits, '--out', fitted)
    scale, offset = (said['estimates'][name] for name in ('tension_scale', 'tension_offset'))
    assert scale['interval95'][0] < 1.2 < scale['interval95'][1]
    assert offset['interval95'][0] < 0.15 < offset['interval95'][1]
    before, after = (said['residuals'][name]['tip_error_percent'] for name in ('before', 'after'))
    assert after < 0.1 * before
    again = cli.json('compare', bag, *GIVEN, '--config', fitted)
    average = again['models']['exact']['average_tip_error_percent']
    assert average == pytest.approx(after, rel=5e-3)
    out = str(tmp_path / 'out')
    report = cli.json('replay', bag, out, '--config', fitted, '--json')['topics']
    assert report['/tendon_tensions']['answered'] == len(staircase_of(FEW)[0])
