"""The estimator of node and bag tool: stamps, refused sensors, places of forces, restarts."""

import contextlib
import dataclasses
import math
import pickle
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Arm, Backbone, Body, Material, Section, Solver
from octo_arm_model.arm.errors import ConvergenceError, MeasurementError, SolveError
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.measurements import (
    Markers,
    Measurement,
    Tensions,
    TipPose,
    TipPosition,
)
from octo_arm_model.estimation.model import BUDGET, ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

SECOND = 10**9
ORIGIN = 1_700_000_000 * SECOND
PUSH = np.array([0.0, 0.004, 0.006])
STRICT = Rules(cell_fault=0.1, sensor_fault=0.005, recover_after=0.5)
FORCE_AT_TIP = Unknowns(Walk(5.0, 0.5), tip_force=LIKELY)


def tip(push: np.ndarray = PUSH) -> np.ndarray:
    return Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(push, np.zeros(3))).tip


def test_measurements_are_counted_and_copies_go_on():
    estimator = Estimator({'tip': rubber(FORCE_AT_TIP)})
    for step in range(3):
        data = [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)]
        output = estimator.add(ORIGIN + step * SECOND // 4, data)
    copy = pickle.loads(pickle.dumps(estimator)).add(ORIGIN + SECOND, []).estimate.mean
    np.testing.assert_array_equal(copy, estimator.add(ORIGIN + SECOND, []).estimate.mean)
    assert (output.probabilities, output.estimate.time) == ({output.hypothesis: 1.0}, 0.5)
    tensions, tips = (estimator.consistency[name] for name in ('tensions', 'tip position'))
    assert tensions.accepted == tips.accepted == len(tips.recent) == 3 and tips.size == 9


CELL, PLACE, FAULT = 0.01, 5e-4, 0.3  # noise [N], [m], and the error of a faulty load cell [N]
FAULTY_CELL = f'load cell {RUBBER.tendon_names[2]}'


def sensors(error: float = 0.0) -> list[Measurement]:
    """Return readings of load cells, three markers and the tip, with an ``error`` of a cell."""
    shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(PUSH, np.zeros(3)))
    stations = np.array([10, 20, 30])
    readings = TENSIONS + np.array([0.0, 0.0, error, 0.0])
    markers = Markers(shape.s[stations], shape.position[stations], PLACE)
    return [Tensions(readings, CELL), markers, TipPosition(shape.tip, PLACE)]


def agile() -> Estimator:
    """Return an estimator whose tensions may change by much more than `FAULT`."""
    return Estimator({'tip': rubber(Unknowns(Walk(5.0, 5.0), tip_force=LIKELY))}, STRICT)


@pytest.mark.parametrize('period', [0.05, 0.25])
def test_sudden_force_is_not_taken_for_a_fault(period):
    random, size = np.random.default_rng(4), 0.025 * math.sqrt(-math.expm1(-2.0 * period))
    for _ in range(4):
        estimator = Estimator({'tip': rubber(FORCE_AT_TIP)}, STRICT)
        push = random.standard_normal(3)
        push *= size / np.linalg.norm(push)
        for step in range(8):
            position = tip(push if step > 4 else np.zeros(3)) + 2e-4 * random.standard_normal(3)
            data = [Tensions(TENSIONS, 0.01), TipPosition(position, 2e-4)]
            output = estimator.add(ORIGIN + round(step * period * SECOND), data)
        assert not estimator.refused_since and not output.begins_anew
        force = output.estimate.tip_wrench[:3]
        stddev = np.sqrt(output.estimate.tip_wrench_covariance.diagonal()[:3])
        assert (np.abs(force - push) < 5.0 * stddev).all()


@pytest.mark.parametrize('order', [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_order_of_measurements_of_one_time_does_not_matter(order):
    together, separately = agile(), agile()
    for estimator in (together, separately):
        estimator.add(ORIGIN, sensors())
    for step in range(1, 5):
        stamp, data = ORIGIN + step * SECOND // 10, sensors(FAULT if step in (2, 3) else 0.0)
        expected = together.add(stamp, data).estimate
        for number in order:
            estimate = separately.add(stamp, [data[number]]).estimate
        stddev = np.sqrt(np.diag(expected.covariance))
        # Within the tolerance of the iterations.
        assert (np.abs(estimate.mean - expected.mean) < 0.15 * stddev).all()
        assert np.allclose(np.sqrt(np.diag(estimate.covariance)), stddev, rtol=0.05, atol=1e-9)
        assert np.abs(estimate.tensions - TENSIONS).max() < 0.1 * FAULT
    for estimator in (together, separately):
        counts = {name: (one.accepted, one.refused) for name, one in estimator.consistency.items()}
        assert counts.pop(FAULTY_CELL)[1] >= 2
        assert sum(refused for _, refused in counts.values()) <= (estimator is separately)
        assert {sum(count) for count in counts.values()} == {5} and len(counts) == 3


def test_first_time_does_not_depend_on_the_number_of_messages():
    together, separately, names = agile(), agile(), RUBBER.tendon_names
    cells = [Tensions(TENSIONS[some], CELL, names[some]) for some in (np.s_[2:], np.s_[:2])]
    for measurement in [*sensors()[:0:-1], *cells]:
        estimate = separately.add(ORIGIN, [measurement]).estimate
    expected = together.add(ORIGIN, sensors()).estimate
    stddev = np.sqrt(np.diag(expected.covariance))
    np.testing.assert_allclose(estimate.mean / stddev, expected.mean / stddev, rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(estimate.root, expected.root, rtol=1e-3, atol=1e-3 * stddev.min())
    assert separately.consistency['tensions'].accepted == 2 and not estimate.refused


def test_a_measurement_that_is_delivered_twice_counts_once():
    once, often = (Estimator({'tip': rubber(FORCE_AT_TIP)}, STRICT, 0.2) for _ in range(2))
    pose = TipPose(tip(), CALM.quaternion[-1], np.repeat([PLACE, 0.05], 3))
    for step in (0, 2, 1):
        stamp = ORIGIN + step * SECOND // 10
        for measurement in [*sensors()[:2], pose]:
            expected = once.add(stamp, [measurement]).estimate
            for _ in range(2):
                output = often.add(stamp, pickle.loads(pickle.dumps([measurement])) * 2)
        assert not output.innovations
    np.testing.assert_allclose(output.estimate.mean, expected.mean, rtol=1e-9)
    np.testing.assert_allclose(output.estimate.root, expected.root, rtol=1e-9)
    assert often.consistency == once.consistency


def test_duplicates_from_before_the_window_count_once():
    estimator = Estimator({'tip': rubber(FORCE_AT_TIP)})
    for step in (0, 1, 2, 1, 1, 1):
        estimator.add(np.uint64(ORIGIN + step * SECOND), [Tensions(TENSIONS, CELL)])
    assert estimator.consistency['tensions'].accepted == 3


RAISED = TENSIONS + 0.5


class TipOfAnother(TipPosition):
    """A tip to which an arm under `RAISED` tensions does not get."""

    def innovation(self, prediction: Prediction) -> np.ndarray:
        if np.allclose(prediction.x[:4], RAISED, atol=0.1):
            raise SolveError('no way there')
        return super().innovation(prediction)


def test_duplicates_do_not_put_off_that_an_estimate_begins_anew():
    estimator = Estimator({'tip': rubber(FORCE_AT_TIP)}, STRICT, 2.0)
    for stamp in range(ORIGIN + SECOND, ORIGIN + 2 * SECOND, SECOND // 10):
        estimator.add(ORIGIN, [Tensions(RAISED, CELL)])
        with contextlib.suppress(SolveError):
            output = estimator.add(stamp, [TipOfAnother([RUBBER.length, 0.0, 0.0], PLACE)])
            break
    assert estimator.failed == 6 and estimator.restarts == 1 and output.begins_anew


def test_covariance_includes_faults_that_are_not_detectable():
    strict = Estimator({'tip': rubber(Unknowns(Walk(5.0, 1.0), tip_force=LIKELY))}, STRICT)
    trusting = Estimator({'tip': rubber(Unknowns(Walk(5.0, 1.0), tip_force=LIKELY))})
    shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(PUSH, np.zeros(3)))
    readings = TENSIONS * [1.0, 0.5, 1.0, 1.0]
    for step in range(20):
        data = [Tensions(readings, CELL), TipPosition(shape.tip, PLACE)]
        stamp = ORIGIN + step * SECOND // 10
        estimate, other = (one.add(stamp, data).estimate for one in (strict, trusting))
        ratio, trusting_ratio = (
            np.linalg.norm(one.backbone.position - shape.position, axis=1)[1:]
            / np.sqrt(np.trace(one.pose_covariance[1:, :3, :3], axis1=1, axis2=2))
            for one in (estimate, other)
        )
        assert ratio.max() < 8.0
    assert trusting_ratio.max() > 3.0 * ratio.max()


def test_iterations_per_message_are_bounded(monkeypatch):
    model, iterations = rubber(FORCE_AT_TIP), [0]
    follow = model.solver.follow

    def count_iterations(*arguments: Any) -> Backbone:
        try:
            shape = follow(*arguments)
        except ConvergenceError as error:
            iterations[0] += error.iterations
            raise
        iterations[0] += int(shape.iterations)
        return shape

    monkeypatch.setattr(model.solver, 'follow', count_iterations)
    bank, rng = Estimator({'tip': model}, STRICT), np.random.default_rng(1)
    bank.add(ORIGIN, [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)])
    for step in range(1, 12):
        data = Tensions(4.0 * rng.random(4), 0.01), TipPosition(0.2 * rng.normal(size=3), 1e-3)
        for item in data:
            iterations[0] = 0
            with contextlib.suppress(SolveError):
                bank.add(ORIGIN + step * SECOND // 20, [item])
            # The iterations of a step, of a restart, and of their last solves.
            assert iterations[0] <= 80 + 160 + 4 * BUDGET.iterations


# Where an unknown force acts ---------------------------------------------------------------------


UNKNOWNS = Unknowns(Walk(5.0, 1.0))
PLACES = (0.07, 0.13, 0.19)
FORCE = Walk.stationary(0.02, 0.2)


def markers_on(model: ArmModel, force: list[float], s: list[float]) -> Markers:
    """Return markers at ``s`` on the arm of a ``model`` with this force."""
    at = Prediction(model, np.append(TENSIONS, force), None)
    position = -Markers(s, np.zeros((len(s), 3)), 1e-3).innovation(at)
    return Markers(s, position.reshape(-1, 3), 1e-3)


def models() -> dict[str, object]:
    with_force = {
        f'{s} m': rubber(dataclasses.replace(UNKNOWNS, point_forces=(PointForce(s, FORCE),)))
        for s in PLACES
    }
    return {'free': rubber(UNKNOWNS), **with_force}


@pytest.mark.parametrize(
    'place',
    [0.13, None, *(pytest.param(place, marks=pytest.mark.endurance) for place in (0.07, 0.19))],
)
def test_place_of_a_force_is_found(place):
    rng = np.random.default_rng(7)
    hypotheses = models()
    name = 'free' if place is None else f'{place} m'
    model = hypotheses[name]
    true = [] if place is None else [0.0, 0.02, -0.015]
    exact = markers_on(model, true, [0.05, 0.1, 0.15, 0.2])
    bank = Estimator(hypotheses)
    for step in range(3):
        noisy = Markers(exact.s, exact.value + 1e-3 * rng.normal(size=12), 1e-3)
        output = bank.add(step * SECOND // 10, [Tensions(TENSIONS, 0.01), noisy])
    assert sum(output.probabilities.values()) == pytest.approx(1.0)
    assert output.hypothesis == name and output.probabilities[name] > 0.9
    np.testing.assert_allclose(output.estimate.backbone.tip, exact.value[-3:], atol=2e-3)
    if place is not None:
        force = model.state.point_forces
        error = output.estimate.mean[force] - true
        assert error @ np.linalg.solve(output.estimate.covariance[force, force], error) < 16.0


def test_units_do_not_decide_between_places_where_one_refuses_a_sensor():
    probabilities = []
    for a, b in (1.0, 1.0), (4.0, 1.0), (1.0, 16.0):  # factors on lengths and stresses
        force = a * a * b
        young, length = b * 1.1e5, a * 0.2
        body, section = Body(length, a * 0.0075, a * 0.003), Section(a * 0.18, a * 0.006, a * 2e-3)
        arm = Arm(Material(young), body, (section,))
        free = Unknowns(Walk(force * 5.0, force * 0.5))
        tip = PointForce(length, Walk.stationary(force * 0.01, 1.0))
        touched = dataclasses.replace(free, point_forces=(tip,))
        bank = Estimator({name: ArmModel(arm, each) for name, each in zip('ab', (free, touched))})
        for step, away in enumerate([0.0, 0.05 * length]):
            bank.add(step * SECOND, [Tensions(force * TENSIONS, force * 0.01)])
            position = Solver(arm).solve([force * TENSIONS]).tip + np.array([0.0, away, 0.0])
            output = bank.add(step * SECOND, [TipPosition(position, 0.006 * length)])
        probabilities.append(output.probabilities['a'])
    assert probabilities == pytest.approx(3 * [probabilities[0]], rel=1e-9)
    assert 1e-6 < probabilities[0] < 0.1


def test_change_of_the_place_is_followed():
    hypotheses = {name: model for name, model in models().items() if name in ('free', '0.19 m')}
    bank = Estimator(hypotheses, change_time=1.0)
    for step, force in enumerate([0.0, 0.0, 0.02, 0.02, 0.02]):
        seen = markers_on(hypotheses['0.19 m'], [0.0, force, 0.0], [0.1, 0.2])
        output = bank.add(step * SECOND // 10, [Tensions(TENSIONS, 0.01), seen])
        assert output.hypothesis == ('0.19 m' if force else 'free')
        # No hypothesis is ever excluded.
        assert min(output.probabilities.values()) > 1e-20
    with pytest.raises(MeasurementError, match=r'measured 1\.4 s before .* window of 0 s'):
        bank.add(-SECOND, [])
    assert bank.late == 1
    with pytest.raises(MeasurementError, match='at least one'):
        Estimator({})
    with pytest.raises(MeasurementError, match='change_time'):
        Estimator(hypotheses, change_time=0.0)


def test_order_within_the_window_does_not_change_probabilities():
    hypotheses = {name: model for name, model in models().items() if name in ('free', '0.19 m')}
    seen = markers_on(hypotheses['0.19 m'], [0.0, 0.004, 0.0], [0.1, 0.2])
    data = 2 * [[Tensions(TENSIONS, 0.01)], [Markers(seen.s, seen.value, 3e-3)]]
    results = []
    for order in ((0, 1, 2, 3), (0, 2, 3, 1), (1, 0, 2, 3)):
        bank = Estimator(hypotheses, change_time=1.0, window=1.0)
        for step in order:
            output = bank.add(step * SECOND // 10, data[step])
            assert [first.name for first in output.innovations] == [data[step][0].name]
        results.append(output)
        assert output.estimate.elapsed == pytest.approx(0.3)
        assert [each.accepted for each in bank.consistency.values()] == [2, 2]
    first = results[0]
    for other in results[1:]:
        assert first.hypothesis == other.hypothesis
        for name, probability in first.probabilities.items():
            assert 1e-3 < probability < 0.999
            assert probability == pytest.approx(other.probabilities[name], rel=1e-2)
        np.testing.assert_allclose(first.estimate.mean, other.estimate.mean, atol=5e-3)


# Restarts ----------------------------------------------------------------------------------------


PERIOD = SECOND // 10  # of every sensor
AFTER = 0.5  # [s] of refusals before a restart
STEADY = Walk(5.0, 0.1)  # prior of tensions that change by 0.1 N in a second
RULES = Rules(cell_fault=0.1, sensor_fault=0.005, recover_after=AFTER)
JUMP = np.array([2.0, 0.0, 0.0, 0.0])  # their true change [N]
Sensor = Callable[[Backbone, np.ndarray], Measurement]
RANDOM = np.random.default_rng(11)


def noise(stddev: float, *shape: int) -> np.ndarray:
    return stddev * RANDOM.standard_normal(shape)


def cells(shape: Backbone, tensions: np.ndarray) -> Measurement:
    return Tensions(tensions + noise(CELL, 4), CELL)


def markers(shape: Backbone, tensions: np.ndarray) -> Measurement:
    stations = [10, 20, 30]
    return Markers(shape.s[stations], shape.position[stations] + noise(PLACE, 3, 3), PLACE)


def good_tip(shape: Backbone, tensions: np.ndarray) -> Measurement:
    return TipPosition(shape.tip + noise(PLACE, 3), PLACE)


SOLVER = Solver(RUBBER, 'exact', 31)
CALM, MOVED = (SOLVER.solve([tensions]) for tensions in (TENSIONS, TENSIONS + JUMP))


def tracker(**options: float) -> Estimator:
    model = rubber(Unknowns(STEADY, tip_force=LIKELY))
    return Estimator({'tip': model}, RULES, **options)


def steps(
    bank: Estimator, numbers: Iterable[int], sensors: Iterable[Sensor], *, is_moved: bool = False
) -> list[EstimatorOutput]:
    """Add measurements of ``sensors`` at each step, one by one; return all outputs."""
    shape, tensions = (MOVED, TENSIONS + JUMP) if is_moved else (CALM, TENSIONS)
    return [
        bank.add(ORIGIN + step * PERIOD + number, [sensor(shape, tensions)])
        for step in numbers
        for number, sensor in enumerate(sensors)
    ]


def assert_is(output: EstimatorOutput, shape: Backbone) -> None:
    """Check that the estimate is ``shape`` within its covariance, and that this is small."""
    estimate = output.estimate
    for station in (15, 30):
        covariance = estimate.pose_covariance[station, :3, :3]
        error = estimate.backbone.position[station] - shape.position[station]
        assert error @ np.linalg.solve(covariance, error) < 30.0  # chi-square of 3, 1e-6
        assert np.sqrt(np.trace(covariance)) < 0.1  # JUMP moves the tip by 0.07


def test_restart_after_unexpectedly_fast_motion():
    bank = tracker()
    assert_is(steps(bank, range(2, 4), [cells, markers, good_tip])[-1], CALM)
    before_restart = steps(bank, range(4, 9), [cells, markers, good_tip], is_moved=True)
    assert not any(one.begins_anew for one in before_restart) and bank.restarts == 0
    # Load cells were refused from step 4 on, and AFTER is five steps.
    outputs = steps(bank, range(9, 11), [cells, markers, good_tip], is_moved=True)
    assert [one.begins_anew for one in outputs[:3]].count(True) == bank.restarts == 1
    assert_is(outputs[-1], MOVED)
    assert all(part.is_accepted for one in outputs[3:] for part in one.innovations)
    later = steps(bank, [11], [cells, markers, good_tip], is_moved=True)
    assert_is(later[-1], MOVED)
    assert bank.restarts == 1


def test_single_sensor_restarts_and_restarts_are_bounded():
    bank = tracker()
    steps(bank, range(4), [cells])
    assert_is(steps(bank, range(4, 12), [cells], is_moved=True)[-1], MOVED)
    before = bank.restarts
    for step in range(12, 40):
        # A broken wire: random readings.
        readings = Tensions(np.abs(noise(2.0, 4)) + 4.0 * (step % 2), CELL)
        bank.add(ORIGIN + step * PERIOD, [readings])
    # After each restart without success the time to the next one doubles.
    assert bank.restarts <= before + 3
