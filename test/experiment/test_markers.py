"""Markers: points at known arc coordinates, seen on the arm that finite elements have."""

import numpy as np
import pytest
from labs import MARKER_S, TENSIONS, TIP_ERRORS, WAYS, marker_bag, pose_array

S = ['--marker-s', *map(str, MARKER_S)]
STILL = ['--clock-offset', '0', '--json']


@pytest.mark.parametrize('way', WAYS)
def test_four_points_have_the_errors_of_points(way, tmp_path, cli):
    see, options = WAYS[way]
    bag = str(marker_bag(tmp_path / 'bag', see))
    said = cli.json('compare', bag, *S, *options, *STILL)
    assert [step['tension'] for step in said['steps']] == pytest.approx(TENSIONS, abs=2e-3)
    for step, expected in zip(said['steps'], TIP_ERRORS):
        assert step['tip_error_percent'] == pytest.approx(expected, abs=0.03)
        assert step['mean_error_percent'] < step['tip_error_percent'] + 0.05
        assert step['hausdorff_percent'] is None
    if way != next(iter(WAYS)):
        return
    fitted = cli.json('identify', bag, *S, *options, *STILL, '--model', 'exact')
    # The error of the model at the highest tensions, of which a marker at the tip sees all.
    assert fitted['estimates']['youngs_modulus']['value'] == pytest.approx(1.1e5, rel=0.03)


def test_hidden_markers_are_left_out_and_their_frames_are_not(tmp_path, cli):
    def hide(points, number):
        points = points.copy()
        points[1 + number % 3] = np.nan
        if number < 12:
            points[3] = np.nan  # in all of the first step
        if number == 41:
            points[2] += 0.1  # which leaves the others of its frame
        return points

    bag = str(marker_bag(tmp_path / 'bag', pose_array, change=hide))
    said = cli.json('compare', bag, *S, *STILL)
    whole = cli.json('compare', marker_bag(tmp_path / 'whole'), *S, *STILL)
    assert said['steps'][0]['tip_error_percent'] is None
    assert said['steps'][0]['mean_error_percent'] < 0.1
    assert sum(step['outliers'] for step in said['steps']) == 1
    average = np.mean(TIP_ERRORS[1:])
    assert said['models']['exact']['average_tip_error_percent'] == pytest.approx(average, abs=0.03)
    for one, other in zip(said['steps'][1:], whole['steps'][1:]):
        assert one['frames'] == other['frames']
        assert one['tip_error_percent'] == pytest.approx(other['tip_error_percent'], rel=1e-6)
    assert any('the marker at 0.27 m is not seen in 36 of 84' in note for note in said['notes'])


def test_millimetres_are_asked_about_and_not_guessed(tmp_path, cli):
    bag = str(marker_bag(tmp_path / 'bag', change=lambda points, number: 1e3 * points))
    assert 'are they in mm? then say --length-unit mm' in cli.refused('compare', bag, *S, *STILL)
    said = cli.json('compare', bag, *S, *STILL, '--length-unit', 'mm')
    average = np.mean(TIP_ERRORS)
    assert said['models']['exact']['average_tip_error_percent'] == pytest.approx(average, abs=0.03)
    # The other way round, a bag in metres that is said to be in millimetres.
    assert 'are they in m? then say --length-unit m' in cli.refused(
        'compare', str(marker_bag(tmp_path / 'metres')), *S, '--length-unit', 'mm'
    )
    # Midlines likewise.
    assert 'are they in mm? then say --length-unit mm' in cli.refused('compare', bag, *STILL)


def test_a_camera_somewhere_else_is_aligned_by_markers(tmp_path, cli):
    turned = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])

    def elsewhere(points, number):
        return points @ turned.T + [0.3, -0.2, 0.9]

    bag = str(marker_bag(tmp_path / 'bag', change=elsewhere))
    said = cli.json('compare', bag, *S, *STILL, '--align', 'fit')
    assert said['models']['exact']['average_tip_error_percent'] < np.mean(TIP_ERRORS)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--marker-s', '0', '0.1', '0.1', '0.2'], '--marker-s has 0.1 after 0.1, expected incr'),
        (['--marker-s', '0', '90', '180', '270'], '--marker-s has 90, expected arc coordinates '
         'from 0 to 0.27 m: in metres?'),
        (['--marker-s', '0', '0.27'], 'it has 4 point(s), expected 2, one for each of --marker-s'),
        (['--marker-s', 'nan'], '--marker-s has nan'),
        (['--marker-s', *map(str, np.linspace(0.0, 0.27, 1001))], 'at most 1000'),
        ([*S, '--midlines', '/mocap/markers', '/tf'], '--midlines names 2, --marker-s has 4'),
        ([*S, '--marker-frames', 'm0'], '--marker-frames names 1, --marker-s has 4'),
    ],
)  # fmt: skip
def test_markers_that_cannot_be_are_refused_in_one_line(options, message, tmp_path, cli):
    bag = str(marker_bag(tmp_path / 'bag', held=TENSIONS[:2]))
    assert message in cli.refused('compare', bag, *options)
