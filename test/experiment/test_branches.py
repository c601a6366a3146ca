"""Loading and unloading."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.experiment.branches import difference, directions


def test_steps_are_labelled_by_how_they_were_reached() -> None:
    tensions = np.array([[0, 0], [1, 0], [3, 0], [3, 0.01], [2, 0], [1, 1], [0, 0]], dtype=float)
    assert directions(tensions) == [
        'rest', 'loading', 'loading', 'loading', 'unloading', 'mixed', 'unloading',
    ]  # fmt: skip


def test_a_difference_of_the_branches_is_found_above_the_noise() -> None:
    tension = [1.0, 2.0, 3.0, 2.0, 1.0]
    way = 3 * ['loading'] + 2 * ['unloading']
    error = [-1e-3, -2e-3, -3e-3, 2e-3, 1e-3]
    assert difference(tension, error, way, 1e-5) == (pytest.approx(-3e-3), pytest.approx(1.5))
    assert difference(tension, error, way, 2e-3) is None
    assert difference(tension, error, 5 * ['loading'], 1e-5) is None
    assert difference(tension, [np.nan, *error[1:]], way, 1e-5) is not None
