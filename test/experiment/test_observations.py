"""From a recording to the steps of an experiment."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from experiments import FAR, HELD, midline, recording

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.experiment.observations import POINTS, Pairing, observe
from octo_arm_model.experiment.steady_windows import SteadyRule


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
    assert 'run from tip to base: by --base-end' in ' '.join(told.notes)


def test_nothing_to_compare_is_said_with_numbers() -> None:
    seen = recording()
    late = dataclasses.replace(seen, frame_time=seen.frame_time + 1e6)
    with pytest.raises(SolveError, match=r'none of \d+ frames from 1000000\.000 to'):
        observe(late, Pairing(offset=0.0))
    with pytest.raises(SolveError, match=r'no tension stays within 0\.079 N for 9 s'):
        observe(seen, Pairing(SteadyRule(duration=9.0), offset=0.0))
