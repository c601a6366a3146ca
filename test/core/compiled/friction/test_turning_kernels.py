"""What friction leaves of tensions, in machine code."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.core.compiled.friction.turning_kernels import SMALL, set_kept

MU, PULLED, REACH = np.array([0.3, 0.0, 0.8]), np.array([0, 2]), np.array([5, 3])


def kept_after(angle: np.ndarray) -> np.ndarray:
    """By Euler and Eytelwein."""
    return np.exp(-MU[PULLED, np.newaxis] * angle)


@pytest.mark.parametrize('size', [SMALL, 1e-6, 2.0 * SMALL, 0.5])
def test_what_friction_keeps_after_a_change_is_the_exponential(size: float) -> None:
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, 3.0, (2, 5))
    moved = size / MU.max() * rng.uniform(-1.0, 1.0, (2, 5))
    kept = kept_after(angle)
    set_kept(MU, PULLED, REACH, angle + moved, moved, size, kept)
    expected = kept_after(angle + moved)
    for row, reach in enumerate(REACH):
        np.testing.assert_allclose(kept[row, :reach], expected[row, :reach], rtol=1e-12)
        # Beyond its anchorage a tendon has no tension.
        np.testing.assert_array_equal(kept[row, reach:], kept_after(angle)[row, reach:])


def test_where_no_angle_has_changed_nothing_does() -> None:
    kept = np.full((2, 5), 0.5)
    set_kept(MU, PULLED, REACH, np.ones((2, 5)), np.zeros((2, 5)), 0.0, kept)
    np.testing.assert_array_equal(kept, 0.5)
