"""Inverses from those nearby are inverses."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.core.numerics.inverses import inverses


@pytest.mark.parametrize('change', [1e-5, 0.01, 0.03, 1.0, 1e9])
def test_inverses_from_those_nearby_are_inverses(change: float) -> None:
    random = np.random.default_rng(3)
    before = np.eye(24) + 0.05 * random.standard_normal((2, 5, 24, 24))
    after = before + change * 0.2 * random.standard_normal(before.shape)
    for near in (np.linalg.inv(before), np.linalg.inv(before[:1])):
        found = inverses(after, near)
        expected = np.linalg.inv(after)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_a_singular_matrix_has_none_however_near_another_is() -> None:
    singular = np.eye(4)[np.newaxis].copy()
    singular[0, 3, 3] = 0.0
    near = np.linalg.inv(singular + 1e-3 * np.eye(4))
    with pytest.raises(np.linalg.LinAlgError):
        inverses(singular, near)
