"""Errors of a model's midline, and which end of a measured one is the base."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import circle

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.experiment.midlines import (
    Curve,
    is_tip_first,
    midline_errors,
)


def test_hausdorff_sees_what_the_distance_to_the_model_does_not() -> None:
    arc = circle(count=401)
    # The measured arm ends early: all of it lies on the model, but not all of the model on it.
    errors = midline_errors(arc[:301], Curve(arc))
    missing = float(np.linalg.norm(arc[300] - arc[-1]))
    assert errors.tip == errors.hausdorff == pytest.approx(missing)
    assert errors.max == pytest.approx(0.0, abs=1e-12)


def test_a_midline_that_begins_along_the_arm_is_compared_from_there() -> None:
    arc = circle(count=401)
    assert midline_errors(arc[40:], Curve(arc)).hausdorff == pytest.approx(0.0, abs=1e-12)
    assert Curve(arc).fraction_at(arc[40]) == pytest.approx(0.1)
    with pytest.raises(MeasurementError, match='begins outside -10% to 25% of the arm'):
        Curve(arc).fraction_at(arc[200], check=True)


def test_the_tip_alone_has_only_an_error_of_the_tip() -> None:
    arc = circle()
    errors = midline_errors(arc[-1:] + [0.0, 0.004, 0.0], Curve(arc))
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
