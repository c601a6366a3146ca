"""Filter and smoother against least squares over the whole course; optimum and consistency."""

import itertools
import sys

import numpy as np
import pytest
from checkout import ROOT
from estimation_arms import RUBBER, TENSIONS, rubber
from numpy.testing import assert_allclose

sys.path.insert(0, str(ROOT / 'benchmarks'))

from faults import Bench, Case

from octo_arm_model import Arm, Body, Material, Section, Solver
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.unknowns import Unknowns, Walk

# A stiff rod of two sections.
ROD = Arm(
    Material(2e6, 0.4),
    Body(0.3, 0.006, 0.005),
    (Section(0.3, 0.004, 0.003), Section(0.15, 0.005, 0.004, angles=(0.5, 2.6, 4.7))),
)
CELL, TIP, PERIOD, FORCE_TIME = 0.01, 2e-3, 0.1, 0.5  # [N, m, s, s]
TENSION, RATE = 0.05, 0.1  # [N, N/s^0.5]
Recording = list[tuple[float, list[Measurement]]]


class Course:
    """The least squares of a course of tensions and forces on the tip."""

    def __init__(self, arm: Arm, force: float) -> None:
        """Expect a ``force`` [N] on the tip of ``arm``."""
        self.solver, self.tendons = Solver(arm, 'exact', 21), len(arm.tendons)
        unknowns = Unknowns(Walk(TENSION, RATE), tip_force=Walk.stationary(force, FORCE_TIME))
        self.model = ArmModel(arm, unknowns, stations=21)
        size, self.decay = self.tendons + 3, np.exp(-PERIOD / FORCE_TIME)
        self.prior, self.growth, self.keep = np.empty((3, size))
        rest, tip = slice(self.tendons), slice(self.tendons, None)
        self.prior[rest], self.growth[rest], self.keep[rest] = TENSION, RATE * PERIOD**0.5, 1.0
        self.prior[tip], self.keep[tip] = force, self.decay
        self.growth[tip] = force * np.sqrt(1.0 - self.decay**2)

    def tip(self, x: FloatArray) -> FloatArray:
        tensions = x[: self.tendons].reshape(self.solver.arm.tension_shape)
        return self.solver.solve(tensions, np.append(x[self.tendons :], np.zeros(3))).tip

    def recording(self, seed: int, count: int) -> tuple[Recording, FloatArray]:
        """Return measurements of a random course, and the course."""
        rng, x, recording, course = np.random.default_rng(seed), 0.0 * self.prior, [], []
        x[: self.tendons] = TENSION
        for step in range(count):
            x = self.keep * x + 0.5 * self.growth * rng.normal(size=x.size)
            x[: self.tendons] = np.maximum(0.1 * TENSION, x[: self.tendons])
            data: list[Measurement] = [
                Tensions(x[: self.tendons] + CELL * rng.normal(size=self.tendons), CELL),
                TipPosition(self.tip(x) + TIP * rng.normal(size=3), TIP),
            ]
            recording.append((PERIOD * step, data[: 1 + (step != 1)]))
            course.append(x.copy())
        return recording, np.array(course)

    def solve(self, recording: Recording, near: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and covariances (times, n, n) of the course; begin ``near`` it."""
        course, (count, size) = near.copy(), near.shape
        for _ in range(4):
            rows, rest = [np.eye(size, count * size) / self.prior[:, np.newaxis]], []
            rest.append(-course[0] / self.prior)
            for k, (_, data) in enumerate(recording):
                block = np.eye(size, count * size, k * size)
                if k:
                    move = block - self.keep[:, np.newaxis] * np.roll(block, -size, axis=1)
                    rows.append(move / self.growth[:, np.newaxis])
                    rest.append(-(course[k] - self.keep * course[k - 1]) / self.growth)
                rows.append(block[: self.tendons] / CELL)
                rest.append((data[0].value - course[k, : self.tendons]) / CELL)
                for each in data[1:]:
                    steps = np.diag(1e-3 * self.prior)
                    tips = [[self.tip(course[k] + s * d) for s in (1, -1)] for d in steps]
                    slope = np.array([(a - b) / (2 * d.sum()) for (a, b), d in zip(tips, steps)])
                    rows.append(slope.T @ block / TIP)
                    rest.append((each.value - self.tip(course[k])) / TIP)
            matrix = np.concatenate(rows)
            information = matrix.T @ matrix
            change = np.linalg.solve(information, matrix.T @ np.concatenate(rest))
            course = course + change.reshape(course.shape)
        covariance = np.linalg.inv(information).reshape(count, size, count, size)
        return course, np.einsum('kikj->kij', covariance)


@pytest.mark.parametrize(('arm', 'force'), [(RUBBER, 2e-4), (ROD, 4e-3)], ids=['cone', 'rod'])
def test_filter_and_smoother_solve_the_normal_equations(arm, force):
    course = Course(arm, force)
    recording, states = course.recording(3, 4)
    recursive = Estimator({'': course.model})

    def check(estimate: Estimate, mean: FloatArray, covariance: FloatArray) -> None:
        stddev = np.sqrt(np.diag(covariance))
        # Least squares have the mode, from which the mean differs along the rod.
        assert_allclose(estimate.mean / stddev, mean / stddev, rtol=0.0, atol=0.3)
        scale = np.outer(stddev, stddev)
        assert_allclose(estimate.covariance / scale, covariance / scale, rtol=0.0, atol=0.03)

    for count, (time, data) in enumerate(recording, start=1):
        means, covariances = course.solve(recording[:count], states[:count])
        check(recursive.add(round(1e9 * time), data).estimate, means[-1], covariances[-1])
    for smoothed in zip(smooth(course.model, recording), means, covariances):
        check(*smoothed)


def test_a_tip_that_is_thrown_far_within_a_period_is_accepted():
    unknowns = Unknowns(Walk(0.2, 0.4), tip_force=Walk.stationary(2e-3, FORCE_TIME))
    recursive = Estimator({'': ArmModel(RUBBER, unknowns)})
    solver = Solver(RUBBER, 'exact')
    for step, tendon in enumerate([0, 2, 1, 3, 0]):
        tensions = 0.3 * np.eye(4)[tendon]
        tip = solver.solve([tensions], np.array([0.0, 1e-3, -1e-3, 0.0, 0.0, 0.0])).tip
        data = [Tensions(tensions, CELL), TipPosition(tip, 1e-3)]
        estimate = recursive.add(round(1e9 * PERIOD * step), data).estimate
        assert not estimate.refused
        assert_allclose(estimate.backbone.tip, tip, rtol=0.0, atol=1e-3)


UNKNOWNS = Unknowns(Walk(5.0, 1.0), tip_force=Walk.stationary(5e-3, 1.0))


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


@pytest.mark.parametrize(('pulled', 'seed'), [(0.5, 1), (-0.4, 1), (-0.4, 20)])
def test_constants_are_the_same_at_all_times_whether_or_not_tendons_are_slack(pulled, seed):
    model = rubber(Unknowns(Walk(5.0, 5.0), tension_bias=Walk(0.05), log_modulus=Walk(0.1)))
    recording, states = simulate(model, seed, 9, pulled)
    assert (states[:, model.state.tension] == 0.0).any() == (pulled < 0.0)
    means = np.array([estimate.mean for estimate in smooth(model, recording)])
    assert (np.ptp(means[:, model.state.tension.stop :], axis=0) < 1e-7).all()
    assert (means[:, model.state.tension] >= 0.0).all()


@pytest.mark.parametrize(
    ('arm', 'sensor'), [('renda2012_table4', 2), ('renda2012_table2', 1), ('rao2021', 2)]
)
def test_course_with_slack_tendons_is_found_by_tip_or_markers_alone(arm, sensor):
    bench = Bench(arm)
    shapes, data = zip(*itertools.islice(bench.measurements(Case(arm, 'none')), 12))
    recording = [(0.05 * step, [each[sensor]]) for step, each in enumerate(data)]
    for estimate, shape in zip(smooth(bench.model, recording), shapes, strict=True):
        assert (estimate.tensions >= 0.0).all()
        error, covariance = estimate.backbone.tip - shape.tip, estimate.pose_covariance[-1, :3, :3]
        assert error @ np.linalg.solve(covariance, error) < 25.0


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
