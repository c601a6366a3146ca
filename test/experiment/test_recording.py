"""Tensions and midlines read from a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from experiments import (
    PARAMETERS,
    bag_of,
    description,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    pose_sample,
    tension_samples,
)

from octo_arm_model.arm.errors import BagError, ConfigError
from octo_arm_model.experiment.camera import Alignment
from octo_arm_model.experiment.observations import observe
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import Measured


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
    assert (seen.frame_id, seen.refusals.total, seen.is_tips) == ('arm_base', 0, False)
    expected = midline('closed_form', one_tendon(2.0), 15)
    np.testing.assert_allclose(seen.frames[0], expected, atol=1e-12)
    assert seen.frame_time[10] == pytest.approx(1.0)
    assert seen.parameters == PARAMETERS


def test_what_cannot_be_used_is_counted_by_topic_and_reason(tmp_path: Path) -> None:
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
    assert len(read_recording(bag, measured=Measured(('backbone/path',))).frames) == 2


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
