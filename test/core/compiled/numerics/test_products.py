"""Products of rows with small matrices, as plain Python, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.core.compiled.numerics.products import add_each, add_runs, multiply


@pytest.mark.parametrize('each', [3, 6, 8, 10])
def test_runs_are_interpolated_from_the_points_of_their_elements(each: int) -> None:
    random = np.random.default_rng(each)
    rows, out = random.normal(size=(3, 2 * each)), np.ones((3, 9))
    # Of the second element first, and none at the place 4.
    runs = np.array([[1, 5, 4], [0, 0, 3], [0, 3, 1]])
    matrices = [random.normal(size=(each, count)) for count in runs[:, 2]]
    add_runs(runs, np.concatenate([x.ravel() for x in matrices]), each, rows, out)
    expected = np.ones((3, 9))
    for (element, first, count), matrix in zip(runs, matrices):
        expected[:, first : first + count] += rows[:, element * each :][:, :each] @ matrix
    np.testing.assert_allclose(out, expected, rtol=1e-12)


@pytest.mark.parametrize('rows', [1, 5, 6, 8, 11, 24])
@pytest.mark.parametrize('columns', [1, 2, 10])
def test_small_products_are_those_of_numpy(rows: int, columns: int) -> None:
    random = np.random.default_rng(rows)
    matrix, other = random.normal(size=(rows, 7)), random.normal(size=(rows, columns))
    out = np.full((7, columns), np.nan)
    multiply(matrix, other, out)
    np.testing.assert_allclose(out, matrix.T @ other, rtol=1e-12, atol=1e-12)
    one, matrices = random.normal(size=(3, rows)), random.normal(size=(3, rows, columns))
    found = np.ones((3, columns))
    add_each(one, matrices, found)
    expected = 1.0 + np.einsum('kn,knm->km', one, matrices)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
