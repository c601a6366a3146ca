"""Fixed points by Anderson's mixing."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.fixed_point import fixed_point


def test_each_row_is_solved_by_itself() -> None:
    found, steps = fixed_point(np.cos, np.array([[0.0, 5.0], [1.0, 1.0]]), 1e-13, 100, 'x')
    np.testing.assert_allclose(found, 0.7390851332151607, rtol=1e-12)
    # Plain iteration takes about seventy.
    assert steps < 25


def test_a_linear_step_that_spreads_converges_too() -> None:
    random = np.random.default_rng(1)
    matrix = random.normal(size=(4, 4)) * 1.5
    assert np.abs(np.linalg.eigvals(matrix)).max() > 1.5
    side = random.normal(size=(3, 4))

    def step(x: FloatArray) -> FloatArray:
        return np.asarray(side + x @ matrix.T)

    found, _ = fixed_point(step, side, 1e-12, 100, 'x')
    np.testing.assert_allclose(found, np.linalg.solve(np.eye(4) - matrix, side.T).T, rtol=1e-8)


def test_what_has_none_is_refused() -> None:
    with pytest.raises(ConvergenceError, match='the unknown did not converge') as error:
        fixed_point(lambda x: x + 1.0, np.zeros((1, 2)), 1e-12, 10, 'the unknown')
    assert error.value.iterations == 10
