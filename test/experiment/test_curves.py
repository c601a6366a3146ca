"""Curves given by points: resampling, and the nearest point."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import circle
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.experiment.midlines import Curve, lengths_along, resample

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)


@given(st.integers(3, 60), st.floats(0.0, 1.0))
def test_points_of_an_arc_stay_on_it_however_few_there_were(count: int, part: float) -> None:
    arc = circle(count=max(count, 8))
    (point,) = resample(arc, np.array([part]))
    expected = circle(count=1001)[round(1000 * part)]
    assert np.linalg.norm(point - expected) < 1e-3


@given(numbers, numbers, numbers)
def test_no_point_of_a_curve_is_nearer_than_the_nearest(x: float, y: float, z: float) -> None:
    point, arc = 0.2 * np.array([[x, y, z]]), circle()
    distance, fraction = Curve(arc).nearest(point)
    fine = resample(arc, np.linspace(0.0, 1.0, 2001))
    brute = np.linalg.norm(fine - point, axis=1)
    assert distance[0] == pytest.approx(brute.min(), abs=2e-4)
    length = lengths_along(arc)[-1]
    assert length * abs(fraction[0] - brute.argmin() / 2000) < 0.02 or brute.min() > 0.05
