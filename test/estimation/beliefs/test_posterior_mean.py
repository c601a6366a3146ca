"""The mean of a posterior apart from its mode: by definition, and what it does to a filter."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from checkout import ROOT
from estimation_arms import TENSIONS, WEIGHT, rubber
from scipy.stats import chi2

from octo_arm_model.estimation.beliefs.belief import Belief, Gain, gain
from octo_arm_model.estimation.beliefs.curvature import (
    Curvature,
    renewed,
    renewed_along,
    stddev_of,
)
from octo_arm_model.estimation.beliefs.fit import fit, fit_at_mode
from octo_arm_model.estimation.beliefs.mode import most_probable
from octo_arm_model.estimation.beliefs.posterior_mean import (
    Agreement,
    agreement,
    gain_of_part,
    gradient,
    share_of,
)
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.measurements import Markers, Tensions, TipPosition
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.estimation.state.unknowns import Unknowns, Walk

sys.path.insert(0, str(ROOT / 'benchmarks'))

from tip_force_scenario import FORCE, PERIOD, arm_model, simulated, square


def bent(noise: float, stddev: list[float]) -> tuple[Prediction, TipPosition, Gain, np.ndarray]:
    """A shape, its tip measured, what that makes of a prior, and second derivatives there."""
    model = rubber(Unknowns(Walk(1.0), tip_force=Walk(0.01)), loads=WEIGHT)
    at = Prediction(model, np.concatenate([TENSIONS, [0.004, -0.006, 0.008]]), None)
    tip, prior = TipPosition(at.solved.tip, noise), Belief(at.x, np.diag(stddev))
    jacobian = tip.jacobian(at)
    second = renewed(Curvature.flat(jacobian), [tip], at, stddev_of(prior)).second
    return at, tip, gain(prior.root, jacobian, tip.noise_root), second


def test_the_shift_is_the_gradient_of_the_determinant() -> None:
    # Small, so that differences are those of the first order.
    stddev = np.array([2e-3, 3e-3, 2e-3, 1e-3, 1e-4, 2e-4, 1e-4])
    at, tip, by, second = bent(1e-5, stddev.tolist())

    def half_log_determinant(x: np.ndarray) -> float:
        jacobian = tip.jacobian(Prediction(at.model, x, at.solved)) * stddev
        expected = jacobian @ jacobian.T + tip.covariance
        return 0.5 * float(np.linalg.slogdet(expected)[1])

    x = at.x
    expected = np.array([
        (half_log_determinant(x + step) - half_log_determinant(x - step)) / (2.0 * step.sum())
        for step in 0.1 * np.diag(stddev)
    ])  # fmt: skip
    found = gradient(by.gain, second)
    # As shifts of the mean, in standard deviations.
    size = np.linalg.norm(expected @ by.root)
    assert np.linalg.norm((found - expected) @ by.root) < 0.02 * size


def test_second_derivatives_anew_along_what_is_corrected_are_those_of_all_there() -> None:
    stddev = np.array([2e-3, 3e-3, 2e-3, 1e-3, 1e-4, 2e-4, 1e-4])
    at, tip, by, second = bent(1e-5, stddev.tolist())
    flat = Curvature.flat(tip.jacobian(at))
    found = renewed_along(by, flat, [tip], at, stddev, stddev)
    assert np.array_equal(found.jacobian, flat.jacobian)
    assert np.allclose(found.second, found.second.transpose(0, 2, 1))
    # The tip tells of three directions.
    expected, along = (one * stddev[:, np.newaxis] @ by.gain for one in (second, found.second))
    assert np.linalg.norm(along - expected) < 0.02 * np.linalg.norm(expected)
    shift, all_of_it = (gradient(by.gain, one) * stddev for one in (found.second, second))
    assert np.linalg.norm(shift - all_of_it) < 0.02 * np.linalg.norm(all_of_it)


def test_a_slack_tendon_is_not_let_out_for_second_derivatives() -> None:
    at, tip, by, _ = bent(1e-5, [2e-3, 3e-3, 2e-3, 1e-3, 1e-4, 2e-4, 1e-4])
    slack = at.x.copy()
    slack[at.model.state.tension] = 0.0
    at = Prediction(at.model, slack, at.solved)
    stddev = np.full(slack.size, 1e-3)
    found = renewed_along(by, Curvature.flat(tip.jacobian(at)), [tip], at, stddev, stddev)
    assert np.isfinite(found.second).all()
    assert found.second.any()


def test_innovations_agree_on_average_with_what_is_expected() -> None:
    *_, by, second = bent(1e-3, [2e-2, 3e-2, 2e-2, 1e-2, 1e-3, 2e-3, 1e-3])
    count = 2000
    white = np.random.default_rng(2).normal(size=(count, 3))
    slope = gradient(by.gain, second)
    found = [agreement(by, slope, by.innovation_root @ one, second) for one in white]
    informations = {one.information for one in found}
    assert len(informations) == 1
    values, stddev = [one.value for one in found], informations.pop() ** -0.5
    assert np.std(values) == pytest.approx(stddev, rel=0.15)
    assert np.mean(values) == pytest.approx(1.0, abs=4.0 * stddev / np.sqrt(count))
    # Of innovations of half the size, a quarter.
    smaller = [agreement(by, slope, 0.5 * by.innovation_root @ one, second).value for one in white]
    assert np.mean(smaller) == pytest.approx(0.25, abs=stddev / np.sqrt(count))


def test_the_mode_is_off_as_far_as_the_state_scatters_about_the_mean_of_its_prior() -> None:
    """By many states and readings of a measurement that is quadratic, and its exact optimum."""
    rng, second, noise, count = np.random.default_rng(2), 0.04, 0.7, 400_000
    for scattered in (1.0, 0.3, 0.0):
        state = np.sqrt(scattered) * rng.normal(size=count)
        mean = np.sqrt(1.0 - scattered) * rng.normal(size=count)
        read = state + 0.5 * second * state**2 + noise * rng.normal(size=count)
        mode = mean
        for _ in range(20):  # Newton's method
            left, slope = read - mode - 0.5 * second * mode**2, 1.0 + second * mode
            downhill = left * slope / noise**2 - (mode - mean)
            mode = mode + downhill / (1.0 + (slope**2 - second * left) / noise**2)
        by = gain(np.eye(1), np.eye(1), noise * np.eye(1))
        bent = np.full((1, 1, 1), second)
        part = gradient(gain_of_part(scattered * np.eye(1), np.eye(1), by), bent)
        (shift,) = -by.root @ (by.root.T @ part)
        # The other term, along the gain: what is predicted is as large as what is measured.
        after = float(by.root[0, 0] ** 2)
        spread = (
            scattered - (1.0 - scattered) - (1.0 - after) + 2.0 * (1.0 - scattered) * (1.0 - after)
        )
        expected = float(shift) - 0.5 * second * float(by.gain[0, 0]) * spread
        error = state - mode
        assert np.mean(error) == pytest.approx(expected, abs=5.0 * error.std() / np.sqrt(count))
        assert share_of(part, gradient(by.gain, bent), by) == pytest.approx(scattered)


def test_what_scatters_is_the_part_of_the_covariance_that_no_sensor_and_no_walk_made() -> None:
    """By the errors of a linear filter: by process and prior, and by all else."""
    rng = np.random.default_rng(3)
    count, jacobian, noise = 20_000, rng.normal(size=(2, 3)), np.diag([0.3, 0.5])
    decay, growth = np.array([1.0, 0.8, 0.9]), np.array([0.5, 0.4, 0.2])
    scatters = np.array([False, True, True])
    belief = Belief(np.zeros(3), np.eye(3), np.diag(scatters * 1.0))
    drawn, rest = (rng.normal(size=(count, 3)) * part for part in (scatters, ~scatters))
    for _ in range(4):
        by = gain(belief.root, jacobian, noise)
        left = np.eye(3) - by.gain @ jacobian
        read = rng.normal(size=(count, 2)) @ noise
        drawn, rest = drawn @ left.T, rest @ left.T - read @ by.gain.T
        belief = belief.corrected(belief.mean, by, jacobian)
        for made, expected in (
            (drawn, belief.scattered),
            (rest, belief.covariance - belief.scattered),
        ):
            np.testing.assert_allclose(made.T @ made / count, expected, atol=0.03)
        moved = growth * rng.normal(size=(count, 3))
        drawn, rest = decay * drawn + moved * scatters, decay * rest + moved * ~scatters
        belief = belief.after(decay, growth, scatters)


def test_a_single_update_hardly_changes_the_weight_of_the_shift() -> None:
    agreed = Agreement()
    assert agreed.weight == 0.0
    for value in 50 * [0.0, 2.0]:
        agreed = agreed.after(Agreement(value, 1.0))
    assert agreed.value == pytest.approx(1.0, abs=0.01)
    assert agreed.after(Agreement(-5.0, 1.0)).weight == 1.0
    for _ in range(900):
        agreed = agreed.after(Agreement(0.25, 1.0))
    assert 0.25 < agreed.weight < 0.4


def test_where_innovations_tell_little_prior_and_noise_are_believed() -> None:
    agreed = Agreement(1.0, 1e-6)
    for _ in range(100):
        agreed = agreed.after(Agreement(-0.2, 1e-4))
    assert agreed.value == pytest.approx(-0.2, abs=0.01)
    assert agreed.weight == 1.0


def test_what_is_known_of_innovations_outlives_a_search_for_the_state() -> None:
    at, tip, by, _ = bent(1e-3, [2e-2, 3e-2, 2e-2, 1e-2, 1e-3, 2e-3, 1e-3])
    prior, agreed = Belief(at.x, by.root), Agreement(0.8, 400.0)
    # Second derivatives of more measurements than are accepted in the end.
    known = Curvature.flat(np.zeros((6, at.x.size)), agreed)
    found = fit(prior, [tip], at, known, is_new=True).curvature
    assert found.agreed.information > 399.0
    assert found.second.shape == (3, at.x.size, at.x.size)
    assert np.abs(found.second).max() > 0.0


def test_the_mode_that_a_search_finds_is_near_the_mean_of_what_is_nearly_linear() -> None:
    stddev = np.array([2e-3, 3e-3, 2e-3, 1e-3, 1e-4, 2e-4, 1e-4])
    at, tip, *_ = bent(1e-4, stddev.tolist())
    prior = Belief(at.x + 0.5 * stddev, np.diag(stddev))
    start = Prediction(at.model, prior.mean, at.solved)
    mode, square = most_probable(prior, [tip], [start], 1e3)
    found, mean = fit_at_mode(prior, [tip], mode), fit(prior, [tip], at, None)
    assert np.linalg.norm(found.belief.whitened(found.belief.mean - mean.belief.mean)) < 0.3
    # The same covariance, in standard deviations.
    one = np.linalg.solve(mean.belief.root, found.belief.root)
    np.testing.assert_allclose(one, np.eye(one.shape[0]), atol=0.05)
    np.testing.assert_allclose([found.square, square], mean.square, rtol=0.1)


def test_tendons_that_hold_still_draw_no_force_from_nowhere() -> None:
    # Their prior lets tensions change by ten times what load cells err by, between two readings.
    unknowns = Unknowns(Walk(5.0, 1.0), tip_force=Walk.stationary(0.01, 1.0))
    model, rng = rubber(unknowns), np.random.default_rng(1)
    force = np.array([0.0, 0.004, 0.006])
    x = np.concatenate([np.ones(4), force])
    tip, own = Prediction(model, x, None).solved.tip, Filter(model)
    for step in range(120):
        measured = [
            Tensions(1.0 + 0.01 * rng.normal(size=4), 0.01),
            TipPosition(tip + 5e-4 * rng.normal(size=3), 5e-4),
        ]
        found = own.add(0.01 * step, measured)
    # The error of the mean, whose covariance is hardly less than that of the last step.
    assert square(found, Prediction(model, x, None), model.state.tip_force) < chi2.ppf(0.999, 3)


@pytest.mark.parametrize('is_lost', [False, True])
@pytest.mark.parametrize(
    ('runs', 'steps', 'sets'), [(1, 100, 1), pytest.param(6, 250, 12, marks=pytest.mark.endurance)]
)
def test_a_force_is_as_sure_as_it_should_be_while_tendons_hold_still(
    is_lost: bool, runs: int, steps: int, sets: int
) -> None:
    """Load cells, a marker and the tip; or these alone, while tensions may be anything."""
    unknowns = Unknowns(Walk(5.0, 1.0), tip_force=Walk.stationary(0.01, 10.0))
    model, squares = rubber(unknowns), []
    state, force = model.state, model.state.tip_force
    for seed in range(runs):
        rng, own = np.random.default_rng(seed), Filter(model)
        x = np.concatenate([np.ones(4), 0.01 * rng.normal(size=3)])
        at = None
        for step in range(steps):
            noise = state.growth(0.01) * rng.normal(size=state.size)
            x[force] = (state.decay(0.01) * x + noise)[force]
            at = Prediction(model, x.copy(), None if at is None else at.solved)
            measured = [TipPosition(at.solved.tip + 5e-4 * rng.normal(size=3), 5e-4)]
            if is_lost:
                place = at.solved.position[15] + 5e-4 * rng.normal(size=3)
                measured.append(Markers(at.solved.s[[15]], [place], 5e-4))
            if not is_lost or step < 0.4 * steps:
                measured.append(Tensions(1.0 + 0.01 * rng.normal(size=4), 0.01))
            found = own.add(0.01 * step, measured)
            if step % 50 == 49:
                squares.append(square(found, at, force))
    # Half a second is hardly a tenth of the correlation time, but the force is told anew in it.
    assert np.mean(squares) < chi2.ppf(0.9999, 3 * sets) / sets


@pytest.mark.parametrize('runs', [2, pytest.param(10, marks=pytest.mark.endurance)])
def test_a_filter_that_remembers_is_as_sure_as_it_should_be(runs: int) -> None:
    model = arm_model(remembers=True, stations=31)
    force = model.state.tip_force
    squares, errors = [], []
    for seed in range(runs):
        own = Filter(model)
        made = simulated(60, seed)
        for step, (measured, _) in enumerate(made):
            found = own.add(step * PERIOD, measured)
        at = made[-1][1]
        # The last steps of runs are independent.
        squares.append(square(found, at, force))
        errors.append((found.mean - at.x)[force])
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 3 * runs)
    assert low < sum(squares) < high, squares
    # Of what guessing zero errs by, hardly more than half is left.
    assert np.sqrt(np.mean(np.square(errors))) < 0.6 * FORCE
