"""Simulated laboratories: a few of those of `validation/laboratories.py`."""

from __future__ import annotations

import sys

from checkout import ROOT

sys.path.insert(0, str(ROOT / 'validation'))

from laboratories import KINDS, Truth, laboratory, outcome, shapes_of


def test_a_laboratory_records_what_it_says() -> None:
    recording, young = laboratory(Truth('closed_form'), KINDS['right model'], 3)
    assert 0.85 * 1.1e5 <= young <= 1.2 * 1.1e5
    shapes = shapes_of(recording).shapes
    assert len(shapes) == 10
    # A fifth of the frames is lost, and most readings of slack tendons are within the deadband.
    assert 0.7 < len(recording.frames) / (10.0 * recording.tension_time[-1]) < 0.9
    assert all(0.0 <= shape.window.tensions[1] < 1e-3 for shape in shapes)


def test_the_interval_of_the_right_model_is_narrow_and_near_the_truth() -> None:
    one = outcome(Truth('closed_form'), KINDS['right model, no friction'], 0)
    assert one.reach < 0.01
    assert abs(one.error) < 2.0 * one.reach
