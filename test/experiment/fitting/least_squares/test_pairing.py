"""Measured points less those of the model, and the derivatives of the difference."""

from __future__ import annotations

import numpy as np
from differences import jacobian
from experiments import circle

from octo_arm_model.experiment.fitting.least_squares.pairing import residuals, residuals_change
from octo_arm_model.experiment.shapes.curves import resample


def test_derivatives_of_residuals_are_those_of_differences() -> None:
    rng = np.random.default_rng(3)
    arc = circle(count=30)
    seen = resample(circle(0.11, 1.7, 60), np.linspace(0.03, 1.0, 17)) + 1e-3
    by_model, by_seen = rng.standard_normal((30, 3, 4)), rng.standard_normal((17, 3, 4))

    def moved(p: np.ndarray) -> np.ndarray:
        return residuals(seen + by_seen @ p, arc + by_model @ p)

    got = residuals_change(seen, by_seen, arc, by_model)
    np.testing.assert_allclose(got, jacobian(moved, np.zeros(4), 1e-6), rtol=1e-6, atol=1e-6)
