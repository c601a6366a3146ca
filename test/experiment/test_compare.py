"""From a recording and its frames to steps, midlines, and their comparison with models."""

import dataclasses
from pathlib import Path

import experiments
import numpy as np
import pytest
from experiments import (
    FAR,
    HELD,
    MARKER_S,
    PARAMETERS,
    TIP_ERRORS,
    bag_of,
    circle,
    description,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    pose_array,
    recording,
    seen,
    staircase,
    staircase_of,
    tension_samples,
    tf_message,
    transform,
)
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from recordings import Sample
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError, SolveError
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.experiment import bag_recording
from octo_arm_model.experiment import recording as recordings
from octo_arm_model.experiment.camera import clock_offset, undetermined
from octo_arm_model.experiment.compare import compare
from octo_arm_model.experiment.fit import fit_alignment, followed
from octo_arm_model.experiment.midlines import Curve, is_tip_first, midline_errors
from octo_arm_model.experiment.observations import POINTS, Pairing, observe
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import MarkerSources, Recording
from octo_arm_model.experiment.sensor_recording import tension_statistics
from octo_arm_model.experiment.steady_windows import (
    SteadyRule,
    Window,
    pose_windows,
    reading_noise,
    steady_windows,
)
from octo_arm_model.experiment.transform_tree import TransformTree

STEPS = (0.0, 1.09, 3.06)
PERCENT = 100.0 / experiments.ARM.length


def answer(tension: float, model: str = 'closed_form') -> np.ndarray:
    return midline(model, one_tendon(tension))


def compared(lines: list[np.ndarray], alignment: Pose | None = Pose()):
    seen = experiments.shapes(lines, [one_tendon(tension) for tension in STEPS])
    return compare(seen, PARAMETERS, 'closed_form', alignment)


@pytest.mark.parametrize('angle', [0.02, 0.1])
def test_an_arm_turned_about_its_base_is_off_by_the_chord(angle):
    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    lines = [turn.apply(answer(tension)) for tension in STEPS]
    chord = 2.0 * np.sin(0.5 * angle) * PERCENT
    expected = [chord * np.linalg.norm(answer(tension)[-1]) for tension in STEPS]
    comparison = compared(lines)
    assert comparison.percent('tip') == pytest.approx(expected, rel=1e-3)
    # Of the straight arm every point is off in proportion to its distance from the base, and the
    # nearest point of the model is the foot of the perpendicular.
    straight = np.sin(angle) * PERCENT * experiments.ARM.length
    assert comparison.percent('max')[0] == pytest.approx(straight, rel=1e-3)
    assert comparison.percent('mean')[0] == pytest.approx(0.5 * straight, rel=2e-3)
    assert (comparison.percent('max') <= comparison.percent('hausdorff') + 1e-9).all()
    assert (comparison.percent('hausdorff') <= np.array(expected) + 0.05).all()


def test_a_fitted_alignment_takes_away_what_a_camera_could_explain():
    lines = [FAR.from_base(answer(tension)) for tension in STEPS]
    comparison = compared(lines, None)
    assert comparison.percent('hausdorff') == pytest.approx([0.0] * 3, abs=0.02)
    assert 'it removes the error that a motion of the camera explains' in comparison.notes[0]
    assert 'mirror image' in comparison.notes[1]
    # The true alignment gives the same errors, a wrong one larger ones.
    assert compared(lines, FAR).percent('max') == pytest.approx([0.0] * 3, abs=0.01)
    with pytest.raises(MeasurementError, match='is the alignment right'):
        compared(lines, Pose())


def test_steps_without_an_answer_are_named_and_the_others_compared():
    pulls = [one_tendon(1.0), one_tendon(500.0)]
    seen = experiments.shapes([answer(1.0), answer(1.0)], pulls)
    comparison = compare(seen, PARAMETERS, 'closed_form', Pose())
    assert [step.number for step in comparison.steps] == [1]
    assert comparison.refused[0].startswith('step 2: tensions compress the arm to nothing')
    with pytest.raises(SolveError, match='closed_form has no answer for any step; step 1'):
        compare(seen[1:], PARAMETERS, 'closed_form', None)


def test_where_friction_leaves_no_derivative_a_straight_step_has_errors_but_no_bend():
    rough = {**PARAMETERS, 'tendons.friction': [0.2]}
    seen = experiments.shapes([answer(0.0)], [one_tendon(0.0)])
    (step,) = compare(seen, rough, 'exact', Pose()).steps
    assert step.errors.tip == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(step.bend)


# Where a camera is and how its clock is off, from what it saw ------------------------------------


def test_what_an_alignment_leaves_open_is_said():
    line = np.linspace(0.0, 1.0, 10)[:, np.newaxis] * [1.0, 2.0, 0.5]
    assert 'rotation about it is open' in undetermined(line, 0.0)[0]
    assert 'mirror image' in undetermined(circle(), 0.0)[0]
    assert 'no rotation' in undetermined(np.zeros((4, 3)), 0.0)[0]
    # An arm of 200 mm that goes 5.5 mm out of its plane is told from one in it by the noise.
    points = circle()
    points[:, 2] = 5.5e-3 * np.sin(np.linspace(0.0, 2.0 * np.pi, len(points)))
    noisy = points + 1e-4 * np.random.default_rng(0).standard_normal(points.shape)
    assert undetermined(noisy, 1e-4 * np.sqrt(3.0)) == ()
    assert 'mirror image' in undetermined(noisy, 5e-3)[0]


def test_the_camera_is_found_despite_outliers_and_midlines_that_begin_late():
    rng = np.random.default_rng(5)
    pulls = [one_tendon(tension) for tension in HELD]
    lines = [FAR.from_base(midline('closed_form', pull)[3:]) for pull in pulls]
    seen = experiments.shapes(lines, pulls, rng, noise=2e-4)
    # A third of one midline is far from the arm.
    lost = seen[4].points.copy()
    lost[-15:] += [0.04, -0.03, 0.02]
    seen[4] = dataclasses.replace(seen[4], points=lost)
    found = fit_alignment(seen, PARAMETERS, 'closed_form')
    assert (
        Rotation.from_matrix((found.rotation * FAR.rotation.inv()).as_matrix()).magnitude() < 2e-3
    )
    points = midline('closed_form', one_tendon(2.0))
    assert np.abs(found.to_base(FAR.from_base(points)) - points).max() < 5e-4
    (tip,) = experiments.shapes([np.zeros((1, 3))], [one_tendon(1.0)])
    with pytest.raises(MeasurementError, match=r'1 measured point\(s\), expected at least 3'):
        fit_alignment([tip], PARAMETERS, 'closed_form')


def offset_of(seen: Recording, kept: object = slice(None), **changes: object) -> float | None:
    """The offset of the clock of a camera that saw what is ``kept``, for an arm with changes."""
    tips = np.array([points[-1] for points in seen.frames])[kept]
    arm = dataclasses.replace(experiments.ARM, **changes)
    return clock_offset(arm, seen.tension_time, seen.tensions, seen.frame_time[kept], tips)


@pytest.mark.parametrize('ahead', [-0.7, 0.35, 4.0, -7.3])
def test_the_clock_of_the_camera_is_set_by_the_motion(ahead):
    seen = experiments.recording('exact', ahead, material__youngs_modulus=1.3e5)
    assert offset_of(seen) == pytest.approx(-ahead, abs=0.03)
    # The search is by the paper's model, which knows no sheaths, and no friction.
    changes = {'sheath_stiffness': (1e5,), 'friction': (0.1,), 'axial_stiffness': (9.0,)}
    assert offset_of(seen, **changes) == pytest.approx(-ahead, abs=0.03)
    outliers = [points + 0.08 * (number % 37 == 5) for number, points in enumerate(seen.frames)]
    seen = dataclasses.replace(seen, frames=tuple(outliers))
    assert offset_of(seen) == pytest.approx(-ahead, abs=0.03)


@pytest.mark.parametrize(('ahead', 'friction'), [(0.0, 0.1), (0.3, 0.02)])
def test_friction_is_not_taken_for_an_offset(ahead, friction):
    """A tip that is behind at each reversal is so at rest as well, which no clock explains."""
    rough = {'tendons.friction': [friction], 'material.youngs_modulus': 1.3e5}
    solver = Config.from_parameters(PARAMETERS | rough).solver('closed_form', 31)
    time, pulled = staircase((0.0, 1.5, 3.0, 1.5), hold=2.0, rate=25.0)
    tensions = np.outer(pulled, [1.0, 0.0, 0.0, 0.0])
    tips = np.array([backbone.tip for backbone in followed(solver, tensions)])
    tips += 5e-4 * np.random.default_rng(0).standard_normal(tips.shape)
    found = clock_offset(experiments.ARM, time, tensions, time[::3] + ahead, tips[::3])
    assert found == pytest.approx(-ahead, abs=0.021)


def test_an_arm_that_is_only_seen_at_rest_does_not_move_the_clock():
    seen = experiments.recording(held=HELD[:4], rate=50.0)
    # Of 3 s at rest and 1 s on the way, from 0.5 to 2.5 s.
    at_rest = (seen.frame_time % 4.0 > 0.5) & (seen.frame_time % 4.0 < 2.5)
    assert offset_of(seen, at_rest) == 0.0
    still = experiments.recording(held=(2.0, 2.0))
    noise = 1e-3 * np.random.default_rng(0).standard_normal((len(still.frames), 1, 3))
    assert offset_of(dataclasses.replace(still, frames=tuple(noise))) is None


# From a recording to shapes ----------------------------------------------------------------------


def test_only_frames_well_inside_steady_steps_count():
    seen = observe(recording(), Pairing(tolerance=0.2, offset=0.0))
    assert [shape.tension for shape in seen.shapes] == pytest.approx(HELD, abs=5e-3)
    # 3 s at 10 Hz, but for 0.5 s to settle and the tolerance at both ends.
    assert all(18 <= shape.frames <= 23 for shape in seen.shapes)
    for shape in seen.shapes:
        expected = midline('closed_form', shape.window.tensions, POINTS)
        assert np.abs(FAR.to_base(shape.points) - expected).max() < 1e-3
    assert 'run from base to tip: the first points spread by 0.0 mm' in ' '.join(seen.notes)


def test_reversed_midlines_and_a_wrong_clock_change_nothing():
    straight = recording()
    turned = dataclasses.replace(
        straight,
        frame_time=straight.frame_time + 0.5,
        frames=tuple(points[::-1] for points in straight.frames),
    )
    one, other = observe(straight, Pairing(offset=0.0)), observe(turned, Pairing(offset=-0.5))
    for shape, same in zip(one.shapes, other.shapes, strict=True):
        assert_allclose(shape.points, same.points, atol=1e-5)
    assert 'run from tip to base' in ' '.join(other.notes)
    told = observe(turned, Pairing(offset=-0.5, base_end='last'))
    assert 'run from tip to base: by --base-end' in ' '.join(told.notes)


# Midlines ----------------------------------------------------------------------------------------


numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
ARC = circle(count=401)


def test_midlines_that_end_early_or_begin_along_the_arm_are_compared_as_far_as_they_go():
    # All of it lies on the model, but not all of the model on it.
    errors = midline_errors(ARC[:301], Curve(ARC))
    missing = float(np.linalg.norm(ARC[300] - ARC[-1]))
    assert errors.tip == errors.hausdorff == pytest.approx(missing)
    assert errors.max == pytest.approx(0.0, abs=1e-12)
    assert midline_errors(ARC[40:], Curve(ARC)).hausdorff == pytest.approx(0.0, abs=1e-12)
    assert Curve(ARC).fraction_at(ARC[40]) == pytest.approx(0.1)
    with pytest.raises(MeasurementError, match='begins outside -10% to 25% of the arm'):
        Curve(ARC).fraction_at(ARC[200], check=True)


def test_the_end_that_stays_is_the_base():
    lines = [circle(angle=angle) for angle in (0.5, 1.0, 1.5)]
    assert is_tip_first(lines, None)[0] is False
    assert is_tip_first([line[::-1] for line in lines], None)[0] is True
    # One shape: only where the base is known.
    with pytest.raises(MeasurementError, match='--base-end first or last'):
        is_tip_first(lines[:1], None)
    assert is_tip_first([lines[0][::-1]], np.zeros(3))[0] is True


# Bags --------------------------------------------------------------------------------------------


def lab() -> list:
    """A few seconds at 2 N, the arm seen where it is."""
    time = np.arange(0.0, 4.0, 0.02)
    points = midline('closed_form', one_tendon(2.0), 15)
    frames = [path_sample(points, nanoseconds(at)) for at in np.arange(0.0, 4.0, 0.1)]
    return [*tension_samples(time, np.full(time.size, 2.0)), *frames]


def test_what_cannot_be_used_is_counted_by_topic_and_reason(tmp_path):
    points = midline('closed_form', one_tendon(2.0), 15)
    bad = points.copy()
    bad[4, 1] = np.nan
    extra = {
        path_sample(bad, nanoseconds(1.01)): 'point 5 is [',
        path_sample(points[:1], nanoseconds(1.02)): 'it has 1 point(s)',
        path_sample(points * 1e3, nanoseconds(1.03)): 'extends over',
        path_sample(points, nanoseconds(1.04), frame='elsewhere'): "frame is 'elsewhere', expec",
        tension_samples([1.05], [-1.0])[0]: 'tension of tendon_1_1 is -1.0 N',
    }
    seen = read_recording(bag_of(tmp_path / 'bag', [description(), *lab(), *extra]))
    assert len(seen.frames) == 40
    for sample, words in extra.items():
        reasons = seen.refusals.of(sample.topic).items()
        assert [count for reason, count in reasons if words in reason] == [1]
    assert seen.refusals.total == len(extra)
    notes = observe(seen, known=Pose()).notes
    assert any('/tendon_tensions: 1 left out, as tension of tendon_1_1' in one for one in notes)


def test_stamps_that_run_backwards_are_sorted_and_said(tmp_path):
    samples = lab()
    frames = [sample for sample in samples if sample.topic == '/camera/midline']
    # Received in order, stamped the other way round.
    swapped = [
        sample._replace(data=other.data)
        for sample, other in zip(frames, frames[::-1], strict=True)
    ]
    others = [sample for sample in samples if sample.topic != '/camera/midline']
    seen = read_recording(bag_of(tmp_path / 'bag', [description(), *others, *swapped]))
    assert (np.diff(seen.frame_time) > 0.0).all()
    assert '39 of 40 stamps on /camera/midline run backwards' in ' '.join(seen.notes)


def test_what_the_model_says_itself_is_no_measurement_unless_asked_for(tmp_path):
    points = midline('closed_form', one_tendon(2.0), 15)
    others = [sample for sample in lab() if sample.topic != '/camera/midline']
    answers = [path_sample(points, nanoseconds(at), '/backbone/path') for at in (1.0, 2.0)]
    bag = bag_of(tmp_path / 'bag', [description(), *others, *answers])
    with pytest.raises(BagError, match=r'no midlines or tips.*/path is no measurement unless'):
        read_recording(bag)
    assert len(read_recording(bag, measured=MarkerSources(('backbone/path',))).frames) == 2


RNG = np.random.default_rng(5)
TIME = 0.01 * np.arange(4000)
NOISE = np.random.default_rng(3).standard_normal(TIME.size)


def windows_of(time: np.ndarray, pulled: np.ndarray, **rule: float) -> list[Window]:
    return steady_windows(time, pulled[:, np.newaxis], SteadyRule(**rule))


def test_a_glitch_does_not_end_a_window_and_does_not_count_and_a_hole_does():
    time = np.arange(0.0, 6.0, 0.01)
    (window,) = windows_of(time, np.where((time > 3.0) & (time < 3.05), 4.0, 2.0))
    assert window.tensions.item() == pytest.approx(2.0)
    assert (window.start, window.stop) == pytest.approx((0.5, 5.99), abs=0.02)
    time = np.concatenate([np.arange(0.0, 3.0, 0.01), np.arange(8.0, 11.0, 0.01)])
    assert len(windows_of(time, np.full(time.size, 2.0))) == 2


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


def test_poses_are_at_times_of_their_own_and_not_too_many():
    step, tensions = NOT_HELD['poses']
    time = step * np.arange(len(tensions))
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


# Frames of TF ------------------------------------------------------------------------------------


FRAMES = ['m0', 'm1', 'm2', 'm3']
OPTIONS = ['--marker-s', *map(str, MARKER_S), '--marker-frames', *FRAMES, '--clock-offset', '0']
WORLD_TO_CAMERA = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.9])
WORLD_TO_BASE = Rotation.from_rotvec([-0.2, 0.5, 1.9]), np.array([1.0, 2.0, -0.5])


def pan(at: float) -> Rotation:
    """How the camera has turned about its vertical axis, at an even rate."""
    return Rotation.from_rotvec([0.0, 0.0, 0.03 * at])


def chain_bag(
    path: Path, *, has_base: bool = True, last_pan: float = np.inf, as_poses: bool = False
) -> Path:
    """The world sees the base of the arm and a mount, on which a camera pans, which sees markers.

    Pans have stamps of their own, up to ``last_pan`` [s]. Markers are frames, or ``as_poses``.
    """
    time, pulled, times = staircase_of()
    samples: list[Sample] = [description(model='exact'), *tension_samples(time, pulled)]
    static = [transform(0, 'mount', WORLD_TO_CAMERA[1], 'world', WORLD_TO_CAMERA[0].as_quat())]
    if has_base:
        quaternion = WORLD_TO_BASE[0].as_quat()
        static.append(transform(0, 'arm_base', WORLD_TO_BASE[1], 'world', quaternion))
    samples.append(tf_message(static, nanoseconds(0.0), '/tf_static'))
    for at in np.arange(0.03, time[-1] + 0.7, 0.7):
        if at <= last_pan:
            stamp, turn = nanoseconds(at), -pan(at).as_quat()  # of either sign
            panned = transform(stamp, 'camera', np.array([0.0, 0.01 * at, 0.0]), 'mount', turn)
            samples.append(tf_message([panned], stamp))
    for at, tension in zip(times, np.interp(times, time, pulled)):
        points = WORLD_TO_BASE[0].apply(seen(float(tension), MARKER_S)) + WORLD_TO_BASE[1]
        points = WORLD_TO_CAMERA[0].apply(points - WORLD_TO_CAMERA[1], inverse=True)
        points = pan(at).apply(points - [0.0, 0.01 * at, 0.0], inverse=True)
        stamp = nanoseconds(at)
        markers = [transform(stamp, name, one, 'camera') for name, one in zip(FRAMES, points)]
        array = pose_array(points, stamp, 'camera')
        samples += array if as_poses else [tf_message(markers, stamp)]
    return bag_of(path, samples)


def test_a_camera_that_moves_by_tf_is_not_one_at_rest(tmp_path, cli):
    bag, s = chain_bag(tmp_path / 'bag', as_poses=True, last_pan=12.0), OPTIONS[:5]
    said = cli.json('compare', bag, *s, '--json')
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS[: len(errors)], abs=0.03) and len(errors) > 2
    assert "'camera' moves in 'arm_base' by /tf and /tf_static, which is used" in said['notes']
    assert any("from 'camera' to 'mount' is not known at" in note for note in said['notes'])
    (model,) = cli.json('compare', bag, *s, '--align', 'fit', '--json')['models'].values()
    assert model['average_tip_error_percent'] > 2.0 * np.mean(TIP_ERRORS)
    # With one stamp it does not move.
    once = chain_bag(tmp_path / 'once', as_poses=True, last_pan=0.1)
    assert any(
        'the alignment is fitted' in one
        for one in cli.json('compare', once, *s, '--json')['notes']
    )


def test_clocks_that_differ_are_told(tmp_path, cli):
    time, pulled, times = staircase_of()
    samples: list[Sample] = [description(model='exact'), *tension_samples(time, pulled)]
    for at, tension in zip(times, np.interp(times, time, pulled)):
        (sample,) = pose_array(seen(float(tension), MARKER_S), nanoseconds(at + 7.25))
        samples.append(sample._replace(received_ns=nanoseconds(at + 0.05)))
    bag, s = bag_of(tmp_path / 'bag', samples), OPTIONS[:5]
    notes = cli.json('estimate', bag, *s, '--markers', '/mocap/markers', '--json')['notes']
    (note,) = [one for one in notes if 'by times of receipt' in one]
    assert 'stamps of markers are 7.' in note and 'ahead of those of tensions' in note
    refusal = cli.refused('compare', bag, *s, '--clock-offset', '1000', status=1)
    assert refusal.endswith('; --clock-offset is added to stamps of frames\n')


def test_without_the_base_markers_are_in_the_root_and_aligned(tmp_path, cli):
    bag = str(chain_bag(tmp_path / 'bag', has_base=False))
    said = cli.json('compare', bag, *OPTIONS, '--json')
    assert any("midlines are in 'world'" in note for note in said['notes'])
    (model,) = said['models'].values()
    found = model['alignment_camera_to_base']
    # The model is not the truth, so that the fit turns the camera a little.
    turn = Rotation.from_quat(found['quaternion']) * WORLD_TO_BASE[0]
    assert turn.magnitude() < 0.05
    assert model['average_tip_error_percent'] < np.mean(TIP_ERRORS)


def test_chains_lead_to_the_base_of_the_arm_between_their_stamps(tmp_path, cli):
    bag = str(chain_bag(tmp_path / 'bag', last_pan=12.0))
    said = cli.json('compare', bag, *OPTIONS, '--json')
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS[: len(errors)], abs=0.03)
    assert 0 < len(errors) < len(TIP_ERRORS)
    for words in ('midlines are in base_frame', "from 'camera' to 'mount' is not known at"):
        assert any(words in note for note in said['notes'])


@pytest.mark.parametrize(
    ('frames', 'message'),
    [
        (['m0', 'm1', 'm2', 'm9'], "no frame 'm9' among the transforms; there are arm_base, cam"),
        (['m0', 'm1', 'm2', 'mount'], "all transforms from 'mount' to 'arm_base' are static"),
        (['m0', 'm1', 'm2', 'm2'], '--marker-frames names m0 m1 m2 m2, expected each once'),
    ],
)
def test_frames_that_lead_nowhere_are_refused_in_one_line(frames, message, tmp_path, cli):
    words = '--marker-s', *MARKER_S, '--marker-frames', *frames
    assert message in cli.refused('compare', chain_bag(tmp_path / 'bag'), *words)


def test_how_many_transforms_are_kept_is_bounded(tmp_path, cli, monkeypatch):
    monkeypatch.setattr(bag_recording, 'MOST_TRANSFORMS', 10)
    line = cli.refused('compare', chain_bag(tmp_path / 'bag'), *OPTIONS)
    assert 'more than 10 transforms' in line


@pytest.mark.parametrize('command', ['compare', 'identify', 'estimate'])
def test_how_many_messages_are_read_is_bounded(command, tmp_path, cli, monkeypatch):
    monkeypatch.setattr(recordings, 'MOST_MESSAGES', 100)
    bag = bag_of(tmp_path / 'bag', [description(), *lab()])
    line = cli.refused(command, bag)
    assert 'messages to read, expected at most 100' in line


LEVEL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def tree_of(*links: tuple[str, str, tuple[float, ...]], is_static: bool = False) -> TransformTree:
    """Transforms at 0 ns: parent, child, and translation [m] and quaternion."""
    tree = TransformTree()
    for parent, child, numbers in links:
        tree.add(parent, child, 0, np.array(numbers[:3]), np.array(numbers[3:]), is_static)
    return tree


@pytest.mark.parametrize(
    ('quaternion', 'message'),
    [((0.0, 0.0, 0.0, 0.0), 'a quaternion of norm 1'), ((np.nan, 0.0, 0.0, 1.0), 'finite num')],
)
def test_a_rotation_on_the_way_is_one_and_that_of_the_marker_itself_does_not_count(
    quaternion, message
):
    wrong = (0.0, 0.0, 0.0, *quaternion)
    with pytest.raises(MeasurementError, match=message):
        tree_of(('world', 'camera', wrong), ('camera', 'marker', LEVEL)).origins(
            'marker', 'world', lambda why: None
        )
    # An orientation that nobody set.
    tree = tree_of(('tracker', 'marker', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)), is_static=True)
    tree.add('world', 'tracker', 5, np.array([0.0, 2.0, 0.0]), np.eye(4)[3], False)
    stamps, points = tree.origins('marker', 'world', lambda why: None)
    assert (stamps.tolist(), points.tolist()) == ([5], [[1.0, 2.0, 0.0]])


def test_circles_and_second_parents_are_refused():
    tree = tree_of(('a', 'b', LEVEL), ('b', 'a', LEVEL), ('x', 'y', LEVEL), ('z', 'w', LEVEL))
    with pytest.raises(MeasurementError, match='parents of frames form a cycle: b < a < b'):
        tree.chain('b')
    with pytest.raises(MeasurementError, match="no transforms connect 'y' and 'z'"):
        tree.origins('y', 'z', lambda why: None)
    with pytest.raises(MeasurementError, match="the parent of 'b' is 'c', expected 'a' as before"):
        tree.add('c', 'b', 1, np.zeros(3), np.eye(4)[3], False)
    with pytest.raises(MeasurementError, match="the frame 'z' is its own parent"):
        tree.add('z', 'z', 1, np.zeros(3), np.eye(4)[3], True)
    tree.add('x', 'w', 1, np.zeros(3), np.eye(4)[3], True)  # moved to another place
    assert tree.chain('w') == ['w', 'x']


def test_a_pose_in_another_frame_is_that_of_the_transforms_between():
    tree = TransformTree()
    for child, (turn, shift) in (('camera', WORLD_TO_CAMERA), ('arm_base', WORLD_TO_BASE)):
        tree.add('world', child, 0, shift, turn.as_quat(), True)
    for stamp in (0, 10):
        shift = np.array([0.0, 0.1 * stamp, 0.0])
        tree.add('camera', 'tracker', stamp, shift, pan(stamp).as_quat(), False)
    pose = tree.pose('tracker', 'arm_base', 4)
    point = np.array([0.1, 0.2, 0.3])
    world = WORLD_TO_CAMERA[0].apply(pan(4).apply(point) + [0.0, 0.4, 0.0]) + WORLD_TO_CAMERA[1]
    expected = WORLD_TO_BASE[0].inv().apply(world - WORLD_TO_BASE[1])
    found = Rotation.from_quat(pose.quaternion).apply(point) + pose.position
    assert_allclose(found, expected, atol=1e-12)
    tree.add('tracker', 'moon', 0, np.array([2e9, 0.0, 0.0]), np.eye(4)[3], True)
    for frames, stamp, message in (
        (('tracker', 'arm_base'), 11, "'tracker' to 'camera' is not known at"),
        (('elbow', 'arm_base'), 0, "no frame 'elbow'"),
        (('moon', 'tracker'), 0, r"the position of 'moon' is .*, expected 3 finite"),
    ):
        with pytest.raises((MeasurementError, ConfigError), match=message):
            tree.pose(*frames, stamp)


@pytest.mark.parametrize(
    ('first', 'later', 'history', 'known', 'forgotten'),
    [
        ([30, 10, 20], [], 10, 25, 15),
        ([1000, 1010, 1020], [5, 15], 100, 10, 1010),  # a clock that began anew
        ([10, 20], [10**18, 30, 40], 100, 35, 41),  # one stamp far ahead
    ],
)
def test_what_is_forgotten_is_older_than_the_newest_by_the_history(
    first, later, history, known, forgotten
):
    """Of a frame that is as far from its parent [m] as it is late [ns]."""
    tree = TransformTree()

    def move(stamp):
        tree.add('a', 'b', stamp, np.array([stamp, 0.0, 0.0]), np.eye(4)[3], False)

    for stamp in first:
        move(stamp)
    tree.forget(history, 1)
    for stamp in later:
        move(stamp)
        tree.forget(history, 1)
    assert tree.pose('b', 'a', known).position[0] == known
    with pytest.raises(MeasurementError, match='is not known'):
        tree.pose('b', 'a', forgotten)


def test_of_too_many_frames_those_that_came_longest_ago_are_forgotten_and_static_ones_last():
    tree = TransformTree()
    for stamp, frame in enumerate(['mount', 'one', 'two', 'one', 'three']):
        tree.add('base', frame, stamp, np.zeros(3), np.eye(4)[3], frame == 'mount')
        tree.forget(100, 3)
    for frame, is_known in (('mount', True), ('one', True), ('two', False), ('three', True)):
        assert tree.connects(frame, 'base') == is_known
