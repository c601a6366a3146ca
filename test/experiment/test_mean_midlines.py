"""The mean midline of a steady step."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import circle

from octo_arm_model.experiment.measured_shapes import POINTS, mean_shape
from octo_arm_model.experiment.midlines import resample
from octo_arm_model.experiment.steady_windows import Window


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
