"""Linear interpolation of rows."""

from __future__ import annotations

import numpy as np

from octo_arm_model.rod.interpolation import interpolated, nearest

X = np.array([0.0, 0.3, 1.0, 4.0])
ROWS = np.outer(X, [1.0, -2.0, 0.5]) + [0.1, 0.2, 0.3]  # linear in x


def test_a_linear_function_is_met_between_the_rows_and_held_beyond_the_ends() -> None:
    at = np.array([-1.0, 0.15, 0.3, 2.5, 9.0])
    expected = np.outer(np.clip(at, 0.0, 4.0), [1.0, -2.0, 0.5]) + [0.1, 0.2, 0.3]
    np.testing.assert_allclose(interpolated(at, X, ROWS), expected, atol=1e-12)


def test_rows_and_places_may_have_more_axes() -> None:
    rows = np.stack([ROWS, 2.0 * ROWS], axis=-1)
    at = np.array([[0.15, 2.5], [-1.0, 9.0]])
    found = interpolated(at, X, rows)
    assert found.shape == (2, 2, 3, 2)
    for place in np.ndindex(at.shape):
        np.testing.assert_array_equal(found[place][:, 0], interpolated(at[place], X, ROWS))
        np.testing.assert_array_equal(found[place][:, 1], interpolated(at[place], X, 2.0 * ROWS))


def test_at_one_number_there_is_one_row() -> None:
    np.testing.assert_allclose(interpolated(2.5, X, ROWS), [2.6, -4.8, 1.55], atol=1e-12)


def test_the_nearest_row_is_that_of_the_smallest_distance() -> None:
    at = np.array([-1.0, 0.0, 0.14, 0.16, 0.64, 0.66, 2.4, 2.6, 9.0])
    expected = np.abs(X[:, np.newaxis] - at).argmin(axis=0)
    np.testing.assert_array_equal(nearest(at, X), expected)
