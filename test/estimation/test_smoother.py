"""The batch estimator against the recursive one, and against its own optimum."""

import itertools

import numpy as np
import pytest
from estimation_arms import TENSIONS, rubber

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.estimation.estimator import Filter
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.unknowns import Unknowns, Walk

UNKNOWNS = Unknowns(Walk(5.0, 1.0), tip_force=Walk.stationary(5e-3, 1.0))
Recording = list[tuple[float, list[Measurement]]]


def recorded(model: ArmModel, seed: int, count: int) -> tuple[Recording, np.ndarray]:
    rng = np.random.default_rng(seed)
    state, recording, states = model.state, [], []
    x = state.prior_stddev() * rng.normal(size=state.size)
    for step in range(count):
        x = state.decay(0.1) * x + state.growth(0.1) * rng.normal(size=state.size)
        x[state.tension] = TENSIONS + 0.5 + 0.2 * np.sin(step + np.arange(4))
        shape = Prediction(model, x, None).solved
        made: list[Measurement] = [Tensions(x[state.tension] + 5e-3 * rng.normal(size=4), 5e-3)]
        if step % 3 == 0:
            made.append(TipPosition(shape.tip + 1e-3 * rng.normal(size=3), 1e-3))
        recording.append((0.1 * step, made))
        states.append(x.copy())
    return recording, np.array(states)


def test_at_the_last_time_both_agree():
    model = rubber(UNKNOWNS)
    recording, _ = recorded(model, 1, 7)
    own = Filter(model)
    filtered = [own.add(*one) for one in recording]
    smoothed = smooth(model, recording)
    stddev = np.sqrt(np.diag(filtered[-1].covariance))
    np.testing.assert_allclose(smoothed[-1].mean / stddev, filtered[-1].mean / stddev, atol=0.1)
    np.testing.assert_allclose(np.diag(smoothed[-1].covariance) / stddev**2, 1.0, atol=0.05)
    # Before, what came later helps: never a larger variance.
    for later, now in zip(smoothed, filtered):
        assert (np.diag(later.covariance) <= 1.02 * np.diag(now.covariance)).all()
    force = model.state.tip_force
    assert (
        np.diag(smoothed[1].covariance)[force].sum()
        < 0.9 * np.diag(filtered[1].covariance)[force].sum()
    )


def test_its_course_is_where_probability_and_information_balance():
    model = rubber(UNKNOWNS)
    recording, _ = recorded(model, 2, 4)
    smoothed = smooth(model, recording)
    state = model.state
    first = np.array([one.mean for one in smoothed])

    def cost(course: np.ndarray) -> float:
        """Squares of all noise and ln(det A) of the information A, from their definitions."""
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
        for k, (x, (_, made)) in enumerate(zip(course, recording)):
            at = Prediction(model, x, None)
            for one in made:
                left = one.innovation(at)
                total += float(left @ np.linalg.solve(one.covariance, left))
                row = one.jacobian(at) @ np.eye(size, count * size, k * size)
                rows.append(np.linalg.solve(one.noise_root, row))
        root = np.concatenate(rows)
        return total + float(np.linalg.slogdet(root.T @ root)[1])

    best, rng = cost(first), np.random.default_rng(3)
    stddev = np.array([np.sqrt(np.diag(one.covariance)) for one in smoothed])
    for _ in range(10):
        move = stddev * rng.normal(size=first.shape)
        # Half of what both directions differ by is the slope, which vanishes at the optimum.
        slope = (cost(first + 0.1 * move) - cost(first - 0.1 * move)) / 0.2
        assert abs(slope) < 1.0
        assert cost(first + move) > best


@pytest.mark.parametrize(
    ('runs', 'least', 'most'),
    [(3, 0.5, 9.0), pytest.param(24, 1.7, 4.7, marks=pytest.mark.endurance)],
)
def test_errors_are_as_large_as_the_covariance_says(runs, least, most):
    model = rubber(UNKNOWNS)
    force, squares = model.state.tip_force, []
    for seed in range(runs):
        recording, states = recorded(model, 10 + seed, 7)
        for found, x in zip(smooth(model, recording, Rules(gate=1.0 - 1e-9)), states):
            error = (found.mean - x)[force]
            squares.append(error @ np.linalg.solve(found.covariance[force, force], error))
    # Runs of 7 steps, correlated over 10: one or two independent sets of 3 in each.
    assert least < np.mean(squares) < most


def test_what_it_refuses():
    model = rubber(UNKNOWNS)
    made = [Tensions(TENSIONS, 0.01)]
    with pytest.raises(MeasurementError, match='in order'):
        smooth(model, [(1.0, made), (0.5, made)])
    assert smooth(model, []) == []
