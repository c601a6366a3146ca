"""From a recording to the steps of an experiment, and the midlines of these."""

import dataclasses

import numpy as np
import pytest
from experiments import (
    FAR,
    HELD,
    PARAMETERS,
    bag_of,
    circle,
    description,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    recording,
    tension_samples,
)
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.experiment.camera import Alignment
from octo_arm_model.experiment.midlines import (
    Curve,
    is_tip_first,
    lengths_along,
    midline_errors,
    resample,
)
from octo_arm_model.experiment.observations import POINTS, Pairing, mean_shape, observe
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import Measured
from octo_arm_model.experiment.steady_windows import Window


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


@given(numbers, numbers, numbers)
def test_no_point_of_a_curve_is_nearer_than_the_nearest(x, y, z):
    point, arc = 0.2 * np.array([[x, y, z]]), circle()
    distance, fraction = Curve(arc).nearest(point)
    brute = np.linalg.norm(resample(arc, np.linspace(0.0, 1.0, 2001)) - point, axis=1)
    assert distance[0] == pytest.approx(brute.min(), abs=2e-4)
    length = lengths_along(arc)[-1]
    assert length * abs(fraction[0] - brute.argmin() / 2000) < 0.02 or brute.min() > 0.05


def test_hausdorff_sees_what_the_distance_to_the_model_does_not():
    # The measured arm ends early: all of it lies on the model, but not all of the model on it.
    errors = midline_errors(ARC[:301], Curve(ARC))
    missing = float(np.linalg.norm(ARC[300] - ARC[-1]))
    assert errors.tip == errors.hausdorff == pytest.approx(missing)
    assert errors.max == pytest.approx(0.0, abs=1e-12)


def test_a_midline_that_begins_along_the_arm_is_compared_from_there():
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


def test_a_step_is_the_mean_of_its_frames_without_the_outliers():
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


# Bags --------------------------------------------------------------------------------------------


def lab(seconds: float = 4.0) -> list:
    """A few seconds at 2 N, the arm seen where it is."""
    time = np.arange(0.0, seconds, 0.02)
    points = midline('closed_form', one_tendon(2.0), 15)
    frames = [path_sample(points, nanoseconds(at)) for at in np.arange(0.0, seconds, 0.1)]
    return [*tension_samples(time, np.full(time.size, 2.0)), *frames]


def test_what_cannot_be_used_is_counted_by_topic_and_reason(tmp_path):
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
    expected = [
        ('/camera/midline', 'point 5 is ['),
        ('/camera/midline', 'it has 1 point(s)'),
        ('/camera/midline', 'extends over'),
        ('/camera/midline', "frame is 'elsewhere', expected 'arm_base'"),
        ('/tendon_tensions', 'tension of tendon_1_1 is -1.0 N'),
    ]
    for topic, words in expected:
        reasons = [reason for reason in seen.refusals.of(topic) if words in reason]
        assert len(reasons) == 1 and seen.refusals.of(topic)[reasons[0]] == 1
    assert seen.refusals.total == len(expected)
    notes = observe(seen, known=Alignment.none()).notes
    assert any('/tendon_tensions: 1 left out, as tension of tendon_1_1' in one for one in notes)


def test_stamps_that_run_backwards_are_sorted_and_said(tmp_path):
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


def test_what_the_model_says_itself_is_no_measurement_unless_asked_for(tmp_path):
    points = midline('closed_form', one_tendon(2.0), 15)
    others = [sample for sample in lab() if sample.topic != '/camera/midline']
    answers = [path_sample(points, nanoseconds(at), '/backbone/path') for at in (1.0, 2.0)]
    bag = bag_of(tmp_path / 'bag', [description(), *others, *answers])
    with pytest.raises(BagError, match='no midlines or tips'):
        read_recording(bag)
    assert len(read_recording(bag, measured=Measured(('backbone/path',))).frames) == 2


def test_a_bag_without_an_arm_or_with_another_one_is_refused(tmp_path):
    bag = bag_of(tmp_path / 'bag', lab())
    with pytest.raises(ConfigError, match='--config'):
        read_recording(bag)
    described = read_recording(bag_of(tmp_path / 'described', [description(), *lab()]))
    assert described.parameters == PARAMETERS and described.frame_id == 'arm_base'
    assert described.tensions.shape == (200, 4) and not described.refusals.total
    with pytest.raises(BagError, match='no tensions for this arm on /tendon_tensions'):
        read_recording(bag, 'renda2012_table4')
    assert len(read_recording(bag, 'renda2012_prototype').frames) == 40
