"""Batches of small symmetric matrices."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.core.numerics.batched_ldlt import are_definite, factorise, invert, substitute


@pytest.mark.parametrize('sets', [1, 6])
@pytest.mark.parametrize('lowest', [1e-3, -1e-3])
def test_a_set_is_definite_if_the_symmetric_parts_of_all_its_matrices_are(
    sets: int, lowest: float
) -> None:
    random = np.random.default_rng(sets)
    bases = np.linalg.qr(random.normal(size=(sets, 3, 5, 5)))[0]
    values = random.uniform(1.0, 2.0, (sets, 3, 5))
    values[0, 1, 2] = lowest
    matrices = (bases * values[..., np.newaxis, :]) @ bases.swapaxes(-1, -2)
    across = random.normal(size=matrices.shape)
    found = are_definite(matrices + across - across.swapaxes(-1, -2))
    assert found.tolist() == [lowest > 0.0] + [True] * (sets - 1)


def test_factors_solve_and_invert() -> None:
    random = np.random.default_rng(3)
    roots = random.normal(size=(4, 4, 7))
    matrices = np.einsum('ikn,jkn->ijn', roots, roots)
    right = random.normal(size=(4, 2, 7))
    factors = factorise(matrices)
    solved = np.einsum('ijn,jcn->icn', matrices, substitute(factors, right))
    np.testing.assert_allclose(solved, right, atol=1e-9)
    one = np.einsum('ijn,jkn->ikn', matrices, invert(factors))
    np.testing.assert_allclose(one, np.eye(4)[..., np.newaxis] + 0.0 * one, atol=1e-9)
