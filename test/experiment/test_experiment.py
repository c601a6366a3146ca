"""Recordings: what is steady, which frames count, where the camera is and what its clock says."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from differences import jacobian
from experiments import (
    ARM,
    FAR,
    HELD,
    PARAMETERS,
    bag_of,
    description,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    pose_sample,
    recording,
    shapes,
    staircase,
    tension_samples,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from octo_arm_model.core.errors import (
    ArmDefinitionError,
    BagError,
    ConfigError,
    MeasurementError,
    SolveError,
)
from octo_arm_model.experiment.fitting.fit import fit_alignment
from octo_arm_model.experiment.fitting.pairing import residuals, residuals_change
from octo_arm_model.experiment.recording.alignment import (
    Alignment,
    align,
    left_jacobian,
    undetermined,
)
from octo_arm_model.experiment.recording.clock_offset import clock_offset
from octo_arm_model.experiment.recording.curves import lengths_along, nearest, resample
from octo_arm_model.experiment.recording.mean_midlines import POINTS, mean_shape
from octo_arm_model.experiment.recording.midlines import (
    fraction_at_start,
    is_tip_first,
    midline_errors,
)
from octo_arm_model.experiment.recording.observations import Pairing, observe
from octo_arm_model.experiment.recording.recording import read_recording
from octo_arm_model.experiment.recording.steady_windows import SteadyRule, Window, steady_windows

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)


def circle(radius: float = 0.1, angle: float = 2.0, count: int = 41) -> np.ndarray:
    """An arc in the plane z = 0 from the origin along x [m]."""
    at = np.linspace(0.0, angle, count)
    return radius * np.stack([np.sin(at), 1.0 - np.cos(at), 0.0 * at], axis=1)


# Steady windows ---------------------------------------------------------------------------------


def windows_of(time: np.ndarray, pulled: np.ndarray, **rule: float) -> list[Window]:
    return steady_windows(time, pulled[:, np.newaxis], SteadyRule(**rule))


def test_every_held_tension_is_a_window_and_no_way_between_is() -> None:
    rng = np.random.default_rng(0)
    time, pulled = staircase(HELD, hold=3.0, ramp=1.0)
    found = windows_of(time, pulled + 0.01 * rng.standard_normal(pulled.size))
    assert len(found) == len(HELD)
    for number, (window, tension) in enumerate(zip(found, HELD)):
        assert window.tensions == pytest.approx([tension], abs=0.005)
        assert window.noise == pytest.approx([0.01], rel=0.3)
        # From half a second after it is reached, within what the tolerance lets in of the ramp.
        assert window.start == pytest.approx(4.0 * number + 0.5, abs=0.2)
        assert window.stop == pytest.approx(4.0 * number + 3.0, abs=0.2)


def test_a_ramp_is_steady_nowhere() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    assert windows_of(time, 0.3 * time) == []


def test_a_glitch_does_not_make_two_steps_of_one_and_does_not_count() -> None:
    time = np.arange(0.0, 6.0, 0.01)
    pulled = np.where((time > 3.0) & (time < 3.05), 4.0, 2.0)
    (window,) = windows_of(time, pulled)
    assert window.tensions.item() == pytest.approx(2.0)
    assert (window.start, window.stop) == pytest.approx((0.5, 5.99), abs=0.02)


def test_a_hole_in_the_recording_ends_a_window() -> None:
    time = np.concatenate([np.arange(0.0, 3.0, 0.01), np.arange(8.0, 11.0, 0.01)])
    assert len(windows_of(time, np.full(time.size, 2.0))) == 2


def test_what_is_too_short_to_settle_is_no_window() -> None:
    time = np.arange(0.0, 1.2, 0.01)
    assert windows_of(time, np.ones(time.size), duration=1.0, settle=2.0) == []
    assert windows_of(np.zeros(0), np.zeros(0)) == []


@pytest.mark.parametrize('rule', [{'tolerance': 0.0}, {'duration': -1.0}, {'settle': np.nan}])
def test_rules_that_make_no_sense_are_refused(rule: dict[str, float]) -> None:
    with pytest.raises(ArmDefinitionError):
        SteadyRule(**rule)


# Midlines ---------------------------------------------------------------------------------------


@given(st.integers(3, 60), st.floats(0.0, 1.0))
def test_points_of_an_arc_stay_on_it_however_few_there_were(count: int, part: float) -> None:
    arc = circle(count=max(count, 8))
    (point,) = resample(arc, np.array([part]))
    expected = circle(count=1001)[round(1000 * part)]
    assert np.linalg.norm(point - expected) < 1e-3


def test_a_wrong_point_stays_a_wrong_point() -> None:
    arc = circle(count=81)
    wrong = arc.copy()
    wrong[30, 2] += 0.05
    fraction = np.linspace(0.0, 1.0, 41)
    off = np.linalg.norm(resample(wrong, fraction) - resample(arc, fraction), axis=1)
    assert np.median(off) < 1e-4
    assert off.max() > 0.04


def test_repeated_points_are_taken_as_one() -> None:
    arc = np.repeat(circle(), 2, axis=0)
    got = resample(arc, np.linspace(0.0, 1.0, 11))
    np.testing.assert_allclose(got, resample(circle(), np.linspace(0.0, 1.0, 11)), atol=1e-4)


@given(numbers, numbers, numbers)
def test_no_point_of_a_curve_is_nearer_than_the_nearest(x: float, y: float, z: float) -> None:
    point, arc = 0.2 * np.array([[x, y, z]]), circle()
    distance, fraction = nearest(point, arc)
    fine = resample(arc, np.linspace(0.0, 1.0, 2001))
    brute = np.linalg.norm(fine - point, axis=1)
    assert distance[0] == pytest.approx(brute.min(), abs=2e-4)
    length = lengths_along(arc)[-1]
    assert length * abs(fraction[0] - brute.argmin() / 2000) < 0.02 or brute.min() > 0.05


def test_errors_of_a_displaced_midline_are_the_displacement() -> None:
    arc = circle(count=401)
    errors = midline_errors(arc + [0.0, 0.0, 0.003], arc)
    assert errors == pytest.approx((0.003, 0.003, 0.003, 0.003), rel=1e-9)


def test_hausdorff_sees_what_the_distance_to_the_model_does_not() -> None:
    arc = circle(count=401)
    # The measured arm ends early: all of it lies on the model, but not all of the model on it.
    errors = midline_errors(arc[:301], arc)
    missing = float(np.linalg.norm(arc[300] - arc[-1]))
    assert errors.tip == errors.hausdorff == pytest.approx(missing)
    assert errors.max == pytest.approx(0.0, abs=1e-12)


def test_a_midline_that_begins_along_the_arm_is_compared_from_there() -> None:
    arc = circle(count=401)
    assert midline_errors(arc[40:], arc).hausdorff == pytest.approx(0.0, abs=1e-12)
    assert fraction_at_start(arc[40:], arc) == pytest.approx(0.1)
    with pytest.raises(MeasurementError, match='begins outside -10% to 25% of the arm'):
        fraction_at_start(arc[200:], arc, check=True)


def test_the_tip_alone_has_only_an_error_of_the_tip() -> None:
    arc = circle()
    errors = midline_errors(arc[-1:] + [0.0, 0.004, 0.0], arc)
    assert errors.tip == pytest.approx(0.004)
    assert errors[1:] == (None, None, None)


def test_the_end_that_stays_is_the_base() -> None:
    lines = [circle(angle=angle) for angle in (0.5, 1.0, 1.5)]
    assert is_tip_first(lines, None)[0] is False
    assert is_tip_first([line[::-1] for line in lines], None)[0] is True
    # One shape: only where the base is known.
    with pytest.raises(MeasurementError, match='--base-end first or last'):
        is_tip_first(lines[:1], None)
    assert is_tip_first([lines[0][::-1]], np.zeros(3))[0] is True


def test_derivatives_of_residuals_are_those_of_differences() -> None:
    rng = np.random.default_rng(3)
    arc = circle(count=30)
    seen = resample(circle(0.11, 1.7, 60), np.linspace(0.03, 1.0, 17)) + 1e-3
    by_model, by_seen = rng.standard_normal((30, 3, 4)), rng.standard_normal((17, 3, 4))

    def moved(p: np.ndarray) -> np.ndarray:
        return residuals(seen + by_seen @ p, arc + by_model @ p)

    got = residuals_change(seen, by_seen, arc, by_model)
    np.testing.assert_allclose(got, jacobian(moved, np.zeros(4), 1e-6), rtol=1e-6, atol=1e-6)


# Alignment --------------------------------------------------------------------------------------

turns = st.tuples(numbers, numbers, numbers).map(lambda v: 3.0 * np.array(v))


@given(turns, st.tuples(numbers, numbers, numbers))
def test_the_rigid_motion_of_points_is_found(turn: np.ndarray, shift: tuple[float, ...]) -> None:
    points = midline('closed_form', one_tendon(2.0))
    true = Alignment(turn, np.array(shift))
    found = align(true.to_camera(points), points)
    np.testing.assert_allclose(found.to_base(true.to_camera(points)), points, atol=1e-12)
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-9)


@given(turns)
def test_derivatives_of_an_alignment_are_those_of_differences(turn: np.ndarray) -> None:
    points = np.random.default_rng(1).standard_normal((5, 3))
    at = np.concatenate([[0.1, -0.2, 0.3], turn])
    got = Alignment(at[3:], at[:3]).by_parameters(points)
    expected = jacobian(lambda x: Alignment(x[3:], x[:3]).to_base(points), at, 1e-4)
    np.testing.assert_allclose(got, expected, atol=1e-9)
    small = np.array([1e-6, -2e-6, 3e-6])
    after = Rotation.from_rotvec(turn + small) * Rotation.from_rotvec(turn).inv()
    np.testing.assert_allclose(after.as_rotvec(), left_jacobian(turn) @ small, atol=1e-10)


def test_the_camera_is_found_despite_outliers_and_midlines_that_begin_late() -> None:
    rng = np.random.default_rng(5)
    pulls = [one_tendon(tension) for tension in HELD]
    lines = [FAR.to_camera(midline('closed_form', pull)[3:]) for pull in pulls]
    seen = shapes(lines, pulls, rng, noise=2e-4)
    # A third of one midline is nowhere near the arm.
    lost = seen[4].points.copy()
    lost[-15:] += [0.04, -0.03, 0.02]
    seen[4] = dataclasses.replace(seen[4], points=lost)
    found = fit_alignment(seen, PARAMETERS, 'closed_form')
    away = Rotation.from_matrix(found.rotation @ FAR.rotation.T).magnitude()
    assert away < 2e-3
    points = midline('closed_form', one_tendon(2.0))
    assert np.abs(found.to_base(FAR.to_camera(points)) - points).max() < 5e-4


def test_what_an_alignment_leaves_open_is_said() -> None:
    line = np.linspace(0.0, 1.0, 10)[:, np.newaxis] * [1.0, 2.0, 0.5]
    assert 'rotation about it is not determined' in undetermined(line)[0]
    assert 'mirror image' in undetermined(circle())[0]
    assert undetermined(np.concatenate([circle(), circle()[:, [0, 2, 1]]])) == ()
    assert 'no rotation' in undetermined(np.zeros((4, 3)))[0]


def test_too_few_points_align_nothing() -> None:
    (tip,) = shapes([np.zeros((1, 3))], [one_tendon(1.0)])
    with pytest.raises(MeasurementError, match=r'1 measured point\(s\), expected at least 3'):
        fit_alignment([tip], PARAMETERS, 'closed_form')


# Shapes, frames and clocks ----------------------------------------------------------------------


def test_a_step_is_the_mean_of_its_frames_without_the_outliers() -> None:
    rng = np.random.default_rng(2)
    arc = resample(circle(), np.linspace(0.0, 1.0, 40))
    lines = [arc + 1e-3 * rng.standard_normal(arc.shape) for _ in range(40)]
    for line in lines[::8]:
        line[20:] += [0.0, 0.03, 0.02]
    shape = mean_shape(Window(0.0, 1.0, np.ones(1), np.zeros(1)), lines)
    assert (shape.frames, shape.outliers) == (35, 5)
    assert shape.noise == pytest.approx(1e-3 * 3**0.5, rel=0.3)
    expected = resample(circle(), np.linspace(0.0, 1.0, POINTS))
    # Better than one frame, by about the root of their number.
    assert np.sqrt(((shape.points - expected) ** 2).sum(axis=1).mean()) < 5e-4


@pytest.mark.parametrize('ahead', [-0.7, 0.0, 0.35])
def test_the_clock_of_the_camera_is_set_by_the_motion(ahead: float) -> None:
    seen = recording('exact', ahead, material__youngs_modulus=1.3e5)
    tips = np.array([points[-1] for points in seen.frames])
    found = clock_offset(ARM, seen.tension_time, seen.tensions, seen.frame_time, tips)
    assert found == pytest.approx(-ahead, abs=0.03)


def test_an_arm_at_rest_tells_no_time() -> None:
    seen = recording(held=(2.0, 2.0))
    rng = np.random.default_rng(0)
    tips = 1e-3 * rng.standard_normal((len(seen.frames), 3))
    assert clock_offset(ARM, seen.tension_time, seen.tensions, seen.frame_time, tips) is None


def test_only_frames_well_inside_steady_steps_count() -> None:
    seen = observe(recording(), Pairing(tolerance=0.2, offset=0.0))
    assert [shape.tension for shape in seen.shapes] == pytest.approx(HELD, abs=5e-3)
    # 3 s at 10 Hz, but for 0.5 s to settle and the tolerance at both ends.
    assert all(18 <= shape.frames <= 23 for shape in seen.shapes)
    for shape in seen.shapes:
        expected = midline('closed_form', shape.window.tensions, POINTS)
        assert np.abs(FAR.to_base(shape.points) - expected).max() < 1e-3
    assert 'run from base to tip: the first points spread by 0.0 mm' in ' '.join(seen.notes)


def test_reversed_midlines_and_a_wrong_clock_change_nothing() -> None:
    straight = recording()
    turned = dataclasses.replace(
        straight,
        frame_time=straight.frame_time + 0.5,
        frames=tuple(points[::-1] for points in straight.frames),
    )
    one, other = observe(straight, Pairing(offset=0.0)), observe(turned, Pairing(offset=-0.5))
    for shape, same in zip(one.shapes, other.shapes, strict=True):
        np.testing.assert_allclose(shape.points, same.points, atol=1e-5)
    assert 'run from tip to base' in ' '.join(other.notes)
    told = observe(turned, Pairing(offset=-0.5, base_end='last'))
    assert 'run from tip to base: as told' in ' '.join(told.notes)


def test_nothing_to_compare_is_said_with_numbers() -> None:
    seen = recording()
    late = dataclasses.replace(seen, frame_time=seen.frame_time + 1e6)
    with pytest.raises(SolveError, match=r'none of \d+ frames from 1000000\.000 to'):
        observe(late, Pairing(offset=0.0))
    with pytest.raises(SolveError, match=r'no tension stays within 0\.079 N for 9 s'):
        observe(seen, Pairing(SteadyRule(duration=9.0), offset=0.0))


# Bags -------------------------------------------------------------------------------------------


def lab(seconds: float = 4.0) -> list:
    """A few seconds at 2 N, the arm seen where it is."""
    time = np.arange(0.0, seconds, 0.02)
    points = midline('closed_form', one_tendon(2.0), 15)
    frames = [path_sample(points, nanoseconds(at)) for at in np.arange(0.0, seconds, 0.1)]
    return [*tension_samples(time, np.full(time.size, 2.0)), *frames]


def test_a_bag_is_read_with_the_arm_it_describes(tmp_path: Path) -> None:
    seen = read_recording(bag_of(tmp_path / 'bag', [description(), *lab()]))
    assert seen.tensions.shape == (200, 4)
    assert len(seen.frames) == 40
    assert (seen.frame_id, seen.skipped, seen.is_tips) == ('arm_base', (), False)
    np.testing.assert_array_equal(seen.frames[0], midline('closed_form', one_tendon(2.0), 15))
    assert seen.frame_time[10] == pytest.approx(1.0)
    assert seen.parameters == PARAMETERS


def test_what_cannot_be_used_is_counted_with_stamp_and_reason(tmp_path: Path) -> None:
    points = midline('closed_form', one_tendon(2.0), 15)
    bad = points.copy()
    bad[4, 1] = np.nan
    extra = [
        path_sample(bad, nanoseconds(1.01)),
        path_sample(points[:1], nanoseconds(1.02)),
        path_sample(points * 1e3, nanoseconds(1.03)),
        path_sample(points, nanoseconds(1.04), frame='elsewhere'),
        *tension_samples(np.array([1.05]), np.array([-1.0])),
    ]
    seen = read_recording(bag_of(tmp_path / 'bag', [description(), *lab(), *extra]))
    assert len(seen.frames) == 40
    reasons = {skip.stamp_ns - nanoseconds(0.0): skip.reason for skip in seen.skipped}
    assert sorted(reasons) == [10**7 * n for n in (101, 102, 103, 104, 105)]
    assert 'point 5 is [' in reasons[1_010_000_000]
    assert 'it has 1 point(s)' in reasons[1_020_000_000]
    assert 'extends over' in reasons[1_030_000_000]
    assert "frame is 'elsewhere', expected 'arm_base'" in reasons[1_040_000_000]
    assert 'tension of tendon_1_1 is -1.0 N' in reasons[1_050_000_000]
    assert '5 messages left out' in ' '.join(observe(seen, known=Alignment.none()).notes)


def test_stamps_that_run_backwards_are_sorted_and_said(tmp_path: Path) -> None:
    samples = lab()
    frames = [sample for sample in samples if sample.topic == '/camera/midline']
    # Received in order, stamped the other way round.
    swapped = [
        sample._replace(data=other.data)
        for sample, other in zip(frames, frames[::-1], strict=True)
    ]  # fmt: skip
    others = [sample for sample in samples if sample.topic != '/camera/midline']
    seen = read_recording(bag_of(tmp_path / 'bag', [description(), *others, *swapped]))
    assert (np.diff(seen.frame_time) > 0.0).all()
    assert '39 of 40 stamps on /camera/midline run backwards' in ' '.join(seen.notes)


def test_what_the_model_says_itself_is_no_measurement_unless_asked_for(tmp_path: Path) -> None:
    points = midline('closed_form', one_tendon(2.0), 15)
    others = [sample for sample in lab() if sample.topic != '/camera/midline']
    answers = [path_sample(points, nanoseconds(at), '/backbone/path') for at in (1.0, 2.0)]
    bag = bag_of(tmp_path / 'bag', [description(), *others, *answers])
    with pytest.raises(BagError, match='no midlines or tips'):
        read_recording(bag)
    assert len(read_recording(bag, midlines='backbone/path').frames) == 2


def test_tips_are_midlines_of_one_point(tmp_path: Path) -> None:
    tip = midline('closed_form', one_tendon(2.0))[-1]
    others = [sample for sample in lab() if sample.topic != '/camera/midline']
    tips = [pose_sample(tip, nanoseconds(at)) for at in np.arange(0.0, 4.0, 0.1)]
    seen = read_recording(bag_of(tmp_path / 'bag', [description(), *others, *tips]))
    assert seen.is_tips
    (shape,) = observe(seen).shapes
    np.testing.assert_allclose(shape.points, [tip])


def test_a_bag_without_an_arm_or_with_another_one_is_refused(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / 'bag', lab())
    with pytest.raises(ConfigError, match='--config'):
        read_recording(bag)
    with pytest.raises(BagError, match='no tensions for this arm on /tendon_tensions'):
        read_recording(bag, 'renda2012_table4')
    assert len(read_recording(bag, 'renda2012_prototype').frames) == 40
