"""Noise and rate of recorded tensions."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.experiment.sensor_recording import tension_statistics

TIME = 0.01 * np.arange(4000)


def test_of_white_noise_the_noise_is_found() -> None:
    noise = np.random.default_rng(0).standard_normal((4000, 2)) * [0.02, 0.005]
    assert tension_statistics(TIME, 1.0 + noise).noise == pytest.approx(0.02, rel=0.05)


def test_a_step_is_three_standard_deviations_of_the_rate() -> None:
    tensions = np.where(TIME < 20.0, 0.0, 1.5)[:, np.newaxis]
    found = tension_statistics(TIME, tensions)
    assert found.rate == pytest.approx(1.5 / 3.0 / np.sqrt(0.01))
    shuffled = np.random.default_rng(1).permutation(4000)
    assert tension_statistics(TIME[shuffled], tensions[shuffled]) == found


@pytest.mark.parametrize('jitter', [1e-9, 1e-6, 9e-3])
def test_readings_of_nearly_one_stamp_make_no_tension_fast(jitter: float) -> None:
    """A tension that changes by 0.01 N from reading to reading, pairs of which came together."""
    time = 2.0 * TIME - np.where(np.arange(4000) % 2, 0.01 - jitter, 0.0)
    tensions = 0.01 * np.arange(4000)[:, np.newaxis]
    assert tension_statistics(time, tensions).rate <= 0.01 / 3.0 / np.sqrt(0.01) + 1e-9
