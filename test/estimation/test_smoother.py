"""The smoother: optimality and consistency."""

import itertools

import numpy as np
import pytest
from estimation_arms import TENSIONS, rubber

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.unknowns import Unknowns, Walk

UNKNOWNS = Unknowns(Walk(5.0, 1.0), tip_force=Walk.stationary(5e-3, 1.0))
Recording = list[tuple[float, list[Measurement]]]


def simulate(
    model: ArmModel, seed: int, count: int, pulled: float = 0.5
) -> tuple[Recording, np.ndarray]:
    rng = np.random.default_rng(seed)
    state, recording, states = model.state, [], []
    x = state.prior_stddev() * rng.normal(size=state.size)
    for step in range(count):
        x = state.decay(0.1) * x + state.growth(0.1) * rng.normal(size=state.size)
        x[state.tension] = np.maximum(TENSIONS + pulled + 0.2 * np.sin(step + np.arange(4)), 0.0)
        shape = Prediction(model, x, None).solved
        data: list[Measurement] = [Tensions(x[state.tension] + 5e-3 * rng.normal(size=4), 5e-3)]
        if step % 3 == 0:
            data.append(TipPosition(shape.tip + 1e-3 * rng.normal(size=3), 1e-3))
        recording.append((0.1 * step, data))
        states.append(x.copy())
    return recording, np.array(states)


def test_smoothed_states_are_the_optimum_of_the_cost():
    model = rubber(UNKNOWNS)
    recording, _ = simulate(model, 2, 4)
    smoothed = smooth(model, recording)
    state = model.state
    first = np.array([each.mean for each in smoothed])

    def cost(course: np.ndarray) -> float:
        """Return the squares of all noise plus ln(det A) of the information A, by definition."""
        total = float(((course[0] / state.prior_stddev()) ** 2).sum())
        for before, after in itertools.pairwise(course):
            noise = (after - state.decay(0.1) * before) / state.growth(0.1)
            total += float((noise**2).sum())
        size, count = state.size, len(course)
        rows = [np.eye(size, count * size) / state.prior_stddev()[:, np.newaxis]]
        for k in range(1, count):
            row = np.eye(size, count * size, k * size)
            row -= state.decay(0.1)[:, np.newaxis] * np.eye(size, count * size, (k - 1) * size)
            rows.append(row / state.growth(0.1)[:, np.newaxis])
        for k, (x, (_, data)) in enumerate(zip(course, recording)):
            at = Prediction(model, x, None)
            for each in data:
                residual = each.innovation(at)
                total += float(residual @ np.linalg.solve(each.covariance, residual))
                row = each.jacobian(at) @ np.eye(size, count * size, k * size)
                rows.append(np.linalg.solve(each.noise_root, row))
        root = np.concatenate(rows)
        return total + float(np.linalg.slogdet(root.T @ root)[1])

    smallest, rng = cost(first), np.random.default_rng(3)
    stddev = np.array([np.sqrt(np.diag(each.covariance)) for each in smoothed])
    for _ in range(10):
        move = stddev * rng.normal(size=first.shape)
        # The slope vanishes at the optimum.
        slope = (cost(first + 0.1 * move) - cost(first - 0.1 * move)) / 0.2
        assert abs(slope) < 1.0
        assert cost(first + move) > smallest


@pytest.mark.parametrize('pulled', [0.5, -0.4])
def test_constants_are_the_same_at_all_times_whether_or_not_tendons_are_slack(pulled):
    """The cost of changes holds no constant: courses with several values cost too little."""
    model = rubber(Unknowns(Walk(5.0, 5.0), tension_bias=Walk(0.05), log_modulus=Walk(0.1)))
    recording, states = simulate(model, 1, 8, pulled)
    assert (states[:, model.state.tension] == 0.0).any() == (pulled < 0.0)
    means = np.array([estimate.mean for estimate in smooth(model, recording)])
    assert (np.ptp(means[:, model.state.tension.stop :], axis=0) < 1e-7).all()
    assert (means[:, model.state.tension] >= 0.0).all()


@pytest.mark.parametrize(
    ('runs', 'least', 'most'),
    [(3, 0.5, 9.0), pytest.param(24, 1.7, 4.7, marks=pytest.mark.endurance)],
)
def test_errors_are_consistent_with_the_covariance(runs, least, most):
    model = rubber(UNKNOWNS)
    force, squares = model.state.tip_force, []
    for seed in range(runs):
        recording, states = simulate(model, 10 + seed, 7)
        for estimate, x in zip(smooth(model, recording, Rules(gate=1.0 - 1e-9)), states):
            error = (estimate.mean - x)[force]
            squares.append(error @ np.linalg.solve(estimate.covariance[force, force], error))
    # Runs have 7 steps with correlations over 10: one or two independent sets of 3 in each.
    assert least < np.mean(squares) < most


def test_unordered_times_are_refused():
    model = rubber(UNKNOWNS)
    data = [Tensions(TENSIONS, 0.01)]
    with pytest.raises(MeasurementError, match='in order'):
        smooth(model, [(1.0, data), (0.5, data)])
    assert smooth(model, []) == []
