"""Newton's steps to the mean of a posterior: Kalman's where nothing bends, else a true minimum."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_arms import RUBBER

from octo_arm_model.estimation.beliefs.belief import Belief, gain
from octo_arm_model.estimation.beliefs.compiled_posterior import posterior_of
from octo_arm_model.estimation.beliefs.local import Step
from octo_arm_model.estimation.beliefs.posterior import Posterior
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.state.unknowns import Unknowns, Walk
from octo_arm_model.rod.forms import is_available

UNKNOWNS = Unknowns(Walk(1.0), tip_force=Walk(0.01))
MODEL = ArmModel(RUBBER, UNKNOWNS, stations=31, compiled=False)
SIZE = MODEL.state.size
RNG = np.random.default_rng(5)
ROOT = np.tril(0.1 * RNG.normal(size=(SIZE, SIZE))) + np.eye(SIZE)
PRIOR = Belief(np.array([5.0, 6.0, 7.0, 5.0, 0.1, -0.2, 0.3]), ROOT)
JACOBIAN = RNG.normal(size=(3, SIZE))
LEFT = RNG.normal(size=3)
SECOND = RNG.normal(size=(3, SIZE, SIZE))
SECOND += SECOND.transpose(0, 2, 1)
START = PRIOR.mean + 0.3
NOISE = np.diag([0.5, 0.6, 0.7])

needs_numba = pytest.mark.skipif(not is_available(), reason='numba is not installed')


@pytest.mark.parametrize('noise', [1.0, 1e-9])
def test_a_linear_measurement_takes_one_step_to_what_a_kalman_filter_says(noise: float) -> None:
    root = noise * np.diag([1.0, 2.0, 3.0])
    posterior = Posterior(PRIOR, root, MODEL, 0.7)
    by = gain(PRIOR.root, JACOBIAN, root)
    local = posterior.local(START, LEFT, JACOBIAN, np.zeros_like(SECOND))
    step = posterior.step(local, START)
    expected = PRIOR.mean + by.gain @ (LEFT + JACOBIAN @ (START - PRIOR.mean))
    np.testing.assert_allclose(step.x, expected, rtol=1e-9)
    size = np.linalg.norm(Belief(expected, by.root).whitened(START - expected))
    assert step.size == pytest.approx(size / np.sqrt(SIZE), rel=1e-6)
    assert posterior.step(local, step.x).size < 1e-5


def descended(posterior: Posterior, bent: float) -> tuple[Step, np.ndarray]:
    """The last of many steps, and the gradient of the cost where it leads, by differences."""
    local = posterior.local(START, LEFT, JACOBIAN, bent * SECOND)
    step = posterior.step(local, posterior.mean(local, posterior.step(local, START)))
    for _ in range(100):
        step = posterior.step(local, step.x)
    steps = 1e-4 * np.eye(SIZE)
    costs = [
        posterior.step(local, step.x + one).cost - posterior.step(local, step.x - one).cost
        for one in steps
    ]
    return step, np.array(costs) / 2e-4


@pytest.mark.parametrize('weight', [0.0, 0.6, 1.0])
def test_steps_lead_to_where_the_cost_is_least(weight: float) -> None:
    posterior = Posterior(PRIOR, NOISE, MODEL, weight)
    step, slope = descended(posterior, 0.05)
    assert step.size < 1e-9
    np.testing.assert_allclose(slope, np.zeros(SIZE), atol=1e-6)


def test_how_measurements_bend_moves_the_mean_only_where_the_shift_has_a_weight() -> None:
    mode, mean = (descended(Posterior(PRIOR, NOISE, MODEL, one), 0.05)[0].x for one in (0.0, 1.0))
    assert np.linalg.norm(PRIOR.whitened(mean - mode)) > 0.01


def test_no_tension_is_less_than_zero_and_how_far_beyond_the_mean_is_counts() -> None:
    prior = PRIOR._replace(mean=PRIOR.mean - np.array([5.0, 0, 0, 0, 0, 0, 0]))
    posterior = Posterior(prior, NOISE, MODEL, 0.0)
    # It says that the first tendon pushes.
    jacobian = np.eye(3, SIZE)
    by = gain(prior.root, jacobian, NOISE)
    local = posterior.local(prior.mean, np.array([-2.0, 0.0, 0.0]), jacobian, 0.0 * SECOND)
    step = posterior.step(local, prior.mean)
    assert step.x[0] == 0.0
    free = prior.mean + by.gain @ [-2.0, 0.0, 0.0]
    after = Belief(free, by.root)
    assert step.beyond == pytest.approx(np.sum(after.whitened(step.x - free) ** 2))
    # The likeliest of all with a slack tendon: along it alone the distance grows.
    nearer = step.x + by.root @ np.linalg.pinv(by.root[:1]) @ [-0.01]
    assert np.linalg.norm(after.whitened(nearer - free)) < np.sqrt(step.beyond)
    within = [free[0] / np.sqrt((by.root[0] ** 2).sum())]
    assert step.beyond == pytest.approx(within[0] ** 2)


def test_it_is_straight_as_far_as_values_and_their_spread_bend_by_parts_of_the_noise() -> None:
    posterior = Posterior(PRIOR, NOISE, MODEL, 0.0)
    by = gain(PRIOR.root, JACOBIAN, NOISE)
    local = posterior.local(START, LEFT, JACOBIAN, SECOND)
    bent = np.linalg.solve(NOISE, SECOND.reshape(3, -1)).reshape(SECOND.shape)
    change = RNG.normal(size=SIZE)
    off = 0.5 * np.linalg.norm(bent @ change @ change)
    turned = np.linalg.norm(bent @ change @ by.root)
    most = min(np.sqrt(0.1 / off), 0.3 / turned)
    assert posterior.bend(local, START + 0.99 * most * change).is_little
    assert not posterior.bend(local, START + 1.01 * most * change).is_little


def machine(noise: np.ndarray, weight: float = 0.7) -> tuple[Posterior, Posterior]:
    """A posterior by NumPy, and the same in machine code."""
    model = ArmModel(RUBBER, UNKNOWNS, stations=31, compiled=True)
    prior = PRIOR._replace(scatter=0.7 * PRIOR.covariance)
    plain, quick = (posterior_of(prior, noise, one, weight) for one in (MODEL, model))
    assert type(plain) is not type(quick)
    return plain, quick


def assert_close(found: object, expected: object, rtol: float = 1e-10) -> None:
    """All numbers of one tuple are those of the other, within a part of the largest of each."""
    for one, other in zip(found, expected, strict=True):
        if isinstance(other, tuple):
            assert_close(one, other, rtol)
        else:
            np.testing.assert_allclose(one, other, rtol=0.0, atol=rtol * np.abs(other).max())


@needs_numba
@pytest.mark.parametrize(
    # What bends by a million times its noise leaves a step that rounding alone changes.
    ('bent', 'exact'), [(0.0, 1.0), (1.0, 1.0), (0.05, 1e-6)]
)  # fmt: skip
@pytest.mark.parametrize('weight', [0.0, 0.7])
def test_machine_code_takes_the_same_steps(bent: float, exact: float, weight: float) -> None:
    random = np.random.default_rng(7)
    noise = NOISE + np.tril(random.normal(size=(3, 3)), -1)
    noise[2] *= exact
    plain, quick = machine(noise, weight)
    # As BLAS leaves them, along columns.
    given = LEFT, np.asfortranarray(JACOBIAN), np.asfortranarray(bent * SECOND)
    expected, found = (one.local(START, *given) for one in (plain, quick))
    assert found.own is not None
    assert_close(found[:7], expected[:7], 1e-10 if exact == 1.0 else 1e-7)
    for x in (found.x, START + random.normal(size=SIZE)):
        one, other = quick.step(found, x), plain.step(expected, x)
        np.testing.assert_allclose(
            PRIOR.whitened(one.x - x), PRIOR.whitened(other.x - x), rtol=0.0,
            atol=1e-6 * max(1.0, other.size),
        )  # fmt: skip
        assert one.size == pytest.approx(other.size, rel=1e-7)
        assert one.cost == pytest.approx(other.cost, rel=1e-9)
        assert one.beyond == pytest.approx(other.beyond, rel=1e-7, abs=1e-7)
        bends = quick.bend(found, one.x), plain.bend(expected, other.x)
        np.testing.assert_allclose(*bends, rtol=1e-5 if exact == 1.0 else 1e-2)


@needs_numba
def test_machine_code_concludes_the_same() -> None:
    plain, quick = machine(0.1 * NOISE)
    expected, found = (
        one.conclude(one.local(START, LEFT, JACOBIAN, SECOND), LEFT, JACOBIAN, SECOND)
        for one in (plain, quick)
    )
    assert expected.agreed.information > 0.0
    assert 0.0 < expected.share < 1.0
    assert_close(found, expected)


def test_what_does_not_go_together_is_refused() -> None:
    posterior = Posterior(PRIOR, NOISE, MODEL, 0.0)
    for left, second in ((LEFT[:2], SECOND), (LEFT, SECOND[:2]), (LEFT, SECOND[:, :3])):
        with pytest.raises(ValueError, match='do not go with'):
            posterior.local(START, left, JACOBIAN, second)
