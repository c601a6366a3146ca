"""Midlines: points along them, their errors, which end is the base, and the mean of a step."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import circle
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.experiment.midlines import (
    Curve,
    is_tip_first,
    lengths_along,
    midline_errors,
    resample,
)
from octo_arm_model.experiment.observations import POINTS, mean_shape
from octo_arm_model.experiment.steady_windows import Window

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
ARC = circle(count=401)


@given(st.integers(8, 60), st.floats(0.0, 1.0))
def test_points_of_an_arc_stay_on_it_however_few_there_were(count: int, part: float) -> None:
    (point,) = resample(circle(count=count), np.array([part]))
    assert np.linalg.norm(point - circle(count=1001)[round(1000 * part)]) < 1e-3


@given(numbers, numbers, numbers)
def test_no_point_of_a_curve_is_nearer_than_the_nearest(x: float, y: float, z: float) -> None:
    point, arc = 0.2 * np.array([[x, y, z]]), circle()
    distance, fraction = Curve(arc).nearest(point)
    brute = np.linalg.norm(resample(arc, np.linspace(0.0, 1.0, 2001)) - point, axis=1)
    assert distance[0] == pytest.approx(brute.min(), abs=2e-4)
    length = lengths_along(arc)[-1]
    assert length * abs(fraction[0] - brute.argmin() / 2000) < 0.02 or brute.min() > 0.05


def test_hausdorff_sees_what_the_distance_to_the_model_does_not() -> None:
    # The measured arm ends early: all of it lies on the model, but not all of the model on it.
    errors = midline_errors(ARC[:301], Curve(ARC))
    missing = float(np.linalg.norm(ARC[300] - ARC[-1]))
    assert errors.tip == errors.hausdorff == pytest.approx(missing)
    assert errors.max == pytest.approx(0.0, abs=1e-12)


def test_a_midline_that_begins_along_the_arm_is_compared_from_there() -> None:
    assert midline_errors(ARC[40:], Curve(ARC)).hausdorff == pytest.approx(0.0, abs=1e-12)
    assert Curve(ARC).fraction_at(ARC[40]) == pytest.approx(0.1)
    with pytest.raises(MeasurementError, match='begins outside -10% to 25% of the arm'):
        Curve(ARC).fraction_at(ARC[200], check=True)


def test_the_end_that_stays_is_the_base() -> None:
    lines = [circle(angle=angle) for angle in (0.5, 1.0, 1.5)]
    assert is_tip_first(lines, None)[0] is False
    assert is_tip_first([line[::-1] for line in lines], None)[0] is True
    # One shape: only where the base is known.
    with pytest.raises(MeasurementError, match='--base-end first or last'):
        is_tip_first(lines[:1], None)
    assert is_tip_first([lines[0][::-1]], np.zeros(3))[0] is True


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
