"""The loss that limits the influence of outliers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.experiment.fitting.least_squares import robust_loss


@given(st.floats(0.0, 1e3))
def test_small_residuals_count_as_squares_and_large_ones_as_distances(ratio: float) -> None:
    away = ratio * np.array([2.0, -1.0, 2.0]) / 3.0
    rho, first, second = robust_loss.loss(away**2)
    assert rho.sum() == pytest.approx(2.0 * (np.sqrt(1.0 + ratio**2) - 1.0))
    near = robust_loss.loss((away * (1.0 + 1e-5)) ** 2)
    squares = 2e-5 * ratio**2
    assert (near[0] - rho).sum() == pytest.approx(first[0] * squares, rel=1e-3, abs=1e-12)
    assert near[1][0] - first[0] == pytest.approx(second[0] * squares, rel=1e-3, abs=1e-12)
