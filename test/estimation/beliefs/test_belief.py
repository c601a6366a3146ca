"""Square roots of covariances against the textbook's formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.estimation.beliefs.belief import Belief, gain, normalised_square
from octo_arm_model.estimation.observability import unlearnt
from octo_arm_model.estimation.state.unknowns import Walk
from octo_arm_model.rod.sensitivity import chi_square_limit

SEEDS = st.integers(0, 2**32 - 1)


def lower(rng: np.random.Generator, size: int) -> np.ndarray:
    return np.tril(rng.normal(size=(size, size))) + 2.0 * np.eye(size)


@given(SEEDS, st.integers(1, 6), st.integers(1, 5))
def test_gain_is_kalmans(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    root, noise, jacobian = lower(rng, n), lower(rng, m), rng.normal(size=(m, n))
    covariance = root @ root.T
    innovation = jacobian @ covariance @ jacobian.T + noise @ noise.T
    by = gain(root, jacobian, noise)
    expected = covariance @ jacobian.T @ np.linalg.inv(innovation)
    np.testing.assert_allclose(by.gain, expected, atol=1e-8)
    np.testing.assert_allclose(by.innovation_root @ by.innovation_root.T, innovation, rtol=1e-9,
                               atol=1e-9 * np.abs(innovation).max())  # fmt: skip
    after = covariance - expected @ innovation @ expected.T
    scale = np.abs(covariance).max()
    np.testing.assert_allclose(by.root @ by.root.T, after, atol=1e-9 * scale)
    value = rng.normal(size=m)
    square = value @ np.linalg.solve(innovation, value)
    assert normalised_square(value, by.innovation_root) == pytest.approx(square, rel=1e-7)


def test_a_nearly_exact_measurement_leaves_the_rest_exact() -> None:
    # By P - K S K' nothing of the second variance would be left but rounding.
    by = gain(np.array([[1.0, 0.0], [1.0, 1e-6]]), np.array([[1.0, 0.0]]), np.array([[1e-9]]))
    assert (by.root @ by.root.T)[1, 1] == pytest.approx(1e-12, rel=1e-5)


@given(SEEDS)
def test_after_a_while_variance_has_grown(seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = Belief(rng.normal(size=4), lower(rng, 4))
    decay, growth = rng.uniform(0.1, 1.0, 4), rng.uniform(0.0, 2.0, 4)
    scatters = rng.random(4) < 0.5
    after = belief.after(decay, growth, scatters)
    kept = np.outer(decay, decay) * belief.covariance
    expected = kept + np.diag(growth**2)
    np.testing.assert_allclose(after.covariance, expected, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(after.scatter, kept + np.diag(scatters * growth**2), atol=1e-11)
    np.testing.assert_array_equal(after.mean, decay * belief.mean)


@given(
    st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.sampled_from([0.3, 7.0, math.inf]),
    st.floats(0.0, 3.0),
)  # fmt: skip
def test_two_whiles_are_one(first: float, second: float, time: float, rate: float) -> None:
    walk = Walk(1.0, rate, time)
    both = walk.variance(first + second)
    parts = walk.variance(first) * walk.decay(second) ** 2 + walk.variance(second)
    assert both == pytest.approx(parts, rel=1e-9, abs=1e-12)
    assert walk.decay(first + second) == pytest.approx(walk.decay(first) * walk.decay(second))


def test_a_stationary_process_keeps_its_variance() -> None:
    walk = Walk.stationary(0.3, 2.0)
    for elapsed in (0.0, 0.1, 10.0):
        variance = (0.3 * walk.decay(elapsed)) ** 2 + walk.variance(elapsed)
        assert variance == pytest.approx(0.09)


def test_gate() -> None:
    assert chi_square_limit(0.95, 3) == pytest.approx(7.8147, abs=1e-4)


def test_unlearnt_directions_are_named() -> None:
    names = ('tip_force x', 'tip_force y', 'tension tendon_1_1')
    prior = np.array([0.1, 0.1, 5.0])
    # Of x and y the sum is known, of the tension all.
    by = gain(np.diag(prior), np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), 1e-3 * np.eye(2))
    (found,) = unlearnt(by.root, prior, names)
    assert found.left == pytest.approx(1.0)
    assert 'tip_force x' in found.reason and 'tip_force y' in found.reason
    assert 'tension' not in found.reason and 'keep their prior' in found.reason
    by = gain(np.diag(prior), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 1e-3 * np.eye(2))
    (found,) = unlearnt(by.root, prior, names)
    assert found.reason == 'tip_force y keeps its prior'
    np.testing.assert_allclose(np.abs(found.direction), [0.0, 0.1, 0.0], atol=1e-9)
