"""Small dense systems, as plain Python, against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.core.compiled.numerics.dense_kernels import (
    FEW,
    factorise,
    invert_three,
    is_definite,
    solve_columns,
    solve_definite,
    solve_transposed,
)


@pytest.mark.parametrize('size', [1, 2, 7, 18])
def test_factors_solve_with_the_transposed_matrix_and_know_the_sign(size: int) -> None:
    random = np.random.default_rng(size)
    for _ in range(5):
        matrix = random.normal(size=(size, size))
        factors, pivots = matrix.copy(), np.zeros(size, np.int64)
        assert factorise(factors, pivots) == np.sign(np.linalg.det(matrix))
        right = random.normal(size=(3, size))
        found = right.copy()
        solve_transposed(factors[np.newaxis], pivots[np.newaxis], found[np.newaxis])
        np.testing.assert_allclose(found @ matrix, right, atol=1e-10)


@pytest.mark.parametrize('columns', [1, FEW, FEW + 1, 40])
def test_columns_that_come_last_are_solved_alike_however_many(columns: int) -> None:
    random = np.random.default_rng(columns)
    matrix, right = random.normal(size=(18, 18)), random.normal(size=(18, columns))
    factors, pivots = matrix.copy(), np.zeros(18, np.int64)
    assert factorise(factors, pivots)
    found = right.copy()
    solve_columns(factors, pivots, found, np.empty(right.T.shape))
    np.testing.assert_allclose(matrix.T @ found, right, atol=1e-10)


def test_several_systems_are_solved_by_their_own_factors() -> None:
    random = np.random.default_rng(5)
    matrices, right = random.normal(size=(4, 7, 7)), random.normal(size=(4, 2, 7))
    factors, pivots, found = matrices.copy(), np.zeros((4, 7), np.int64), right.copy()
    assert all(factorise(*one) for one in zip(factors, pivots))
    solve_transposed(factors, pivots, found)
    np.testing.assert_allclose(found @ matrices, right, atol=1e-10)


def test_what_is_singular_or_no_number_has_no_sign() -> None:
    pivots = np.zeros(3, np.int64)
    assert factorise(np.zeros((3, 3)), pivots) == 0
    assert factorise(np.full((3, 3), np.nan), pivots) == 0


def test_three_by_three_is_inverted_by_its_cofactors() -> None:
    matrix = np.array([[2.0, -1.0, 0.5], [0.3, 1.0, 4.0], [-2.0, 0.7, 1.0]])
    inverse = np.empty((3, 3))
    assert invert_three(matrix, inverse) == pytest.approx(np.linalg.det(matrix))
    np.testing.assert_allclose(inverse @ matrix, np.eye(3), atol=1e-12)


@pytest.mark.parametrize('least', [0.1, -0.1])
def test_definite_is_what_has_positive_eigenvalues(least: float) -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(6, 6)))
    skewed = np.triu(np.ones((6, 6)), 1)
    matrix = turn @ np.diag([least, 1.0, 2.0, 3.0, 4.0, 5.0]) @ turn.T + skewed - skewed.T
    assert is_definite(matrix) == (least > 0.0)


def test_definite_matrices_are_solved_side_by_side() -> None:
    random = np.random.default_rng(4)
    roots, right = random.normal(size=(4, 4, 9)), random.normal(size=(4, 9))
    matrix = np.einsum('ikn,jkn->ijn', roots, roots)
    left = right.copy()
    solve_definite(matrix.copy(), left)
    np.testing.assert_allclose(np.einsum('ijn,jn->in', matrix, left), right, atol=1e-10)
