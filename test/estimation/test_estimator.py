"""The loop of node and bag tool: stamps, what is thrown out or found, where forces act."""

import contextlib
import dataclasses
import math
import pickle
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Backbone, Solver
from octo_arm_model.arm.errors import ConvergenceError, MeasurementError, SolveError
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput, Filter
from octo_arm_model.estimation.measurements import Markers, Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import BUDGET, ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

SECOND = 10**9
ORIGIN = 1_700_000_000 * SECOND
PUSH = np.array([0.0, 0.004, 0.006])
DOUBTING = Rules(cell_fault=0.1, sensor_fault=0.005, recover_after=0.5)
FORCE_AT_TIP = Unknowns(Walk(5.0, 0.5), tip_force=LIKELY)


def tip(push: np.ndarray = PUSH) -> np.ndarray:
    return Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(push, np.zeros(3))).tip


def test_it_is_the_filter_by_seconds_from_the_first_stamp():
    estimator, one = Estimator({'tip': rubber(FORCE_AT_TIP)}), Filter(rubber(FORCE_AT_TIP))
    for step in range(3):
        given = [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)]
        found = estimator.add(ORIGIN + step * SECOND // 4, given)
        expected = one.add(0.25 * step, given)
        np.testing.assert_allclose(found.estimate.mean, expected.mean, rtol=0, atol=1e-12)
    copy = pickle.loads(pickle.dumps(estimator)).add(ORIGIN + SECOND, []).estimate.mean
    np.testing.assert_array_equal(copy, estimator.add(ORIGIN + SECOND, []).estimate.mean)
    assert (found.probabilities, found.estimate.time) == ({found.hypothesis: 1.0}, 0.5)
    tensions, tips = (estimator.consistency[name] for name in ('tensions', 'tip position'))
    assert tensions.accepted == tips.accepted == len(tips.recent) == 3 and tips.size == 9


def test_late_ones_are_put_in_place_within_the_window_and_refused_beyond():
    in_order, late = (Estimator({'tip': rubber(FORCE_AT_TIP)}, window=0.3) for _ in range(2))
    messages = [
        (0, Tensions(TENSIONS, 0.01)),
        (1, TipPosition(tip(), 1e-3)),
        (2, Tensions(TENSIONS, 0.01)),
        (3, TipPosition(tip(), 1e-3)),
    ]
    for estimator, order in ((in_order, (0, 1, 2, 3)), (late, (0, 2, 3, 1))):
        for number in order:
            step, one = messages[number]
            found = estimator.add(ORIGIN + step * SECOND // 10, [one])
            assert [part.name for part in found.innovations] == [one.name]
    first, second = (one.add(ORIGIN + SECOND // 2, []).estimate for one in (in_order, late))
    np.testing.assert_allclose(first.mean, second.mean, rtol=0, atol=1e-6)
    with pytest.raises(MeasurementError, match='before the window'):
        late.add(ORIGIN + SECOND // 20, [Tensions(TENSIONS, 0.01)])
    assert (late.late, in_order.late) == (1, 0)
    for estimator in (late, in_order):
        assert [one.accepted for one in estimator.consistency.values()] == [2, 2]


def test_a_sensor_that_lies_is_refused_named_and_believed_again_within_two_seconds():
    # Three markers tell where the arm is; a tip ten standard deviations off does not fit them.
    estimator = Estimator({'tip': rubber(FORCE_AT_TIP)}, DOUBTING)
    shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(PUSH, np.zeros(3)))
    at = np.array([10, 20, 30])
    for step in range(30):
        stamp = ORIGIN + step * SECOND // 10
        markers = Markers(shape.s[at], shape.position[at], 5e-4)
        estimator.add(stamp, [Tensions(TENSIONS, 0.01), markers])
        wrong = 3 <= step < 10
        lie = TipPosition(shape.tip + [0.0, 0.0, 0.02 if wrong else 0.0], 5e-4)
        found = estimator.add(stamp, [lie])
        if wrong:
            assert estimator.refused_since == {'tip position': ORIGIN + 3 * SECOND // 10}
        force, covariance = found.estimate.tip_wrench[:3] - PUSH, found.estimate.covariance
        assert force @ np.linalg.solve(covariance[4:7, 4:7], force) < 16.3
    assert not estimator.refused_since and not found.estimate.doubted
    kind = estimator.consistency['tip position']
    assert kind.refused_from == ORIGIN + 3 * SECOND // 10
    assert ORIGIN + 9 * SECOND // 10 <= kind.refused_to < ORIGIN + 3 * SECOND


CELL, PLACE, LIE = 0.01, 5e-4, 0.3  # noise [N], [m], and what a load cell shows too much [N]
LIAR = f'load cell {RUBBER.tendon_names[2]}'


def sensors(lie: float = 0.0) -> list[Measurement]:
    """What load cells, three markers and a camera that sees the tip measure of one shape."""
    shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(PUSH, np.zeros(3)))
    at = np.array([10, 20, 30])
    readings = TENSIONS + np.array([0.0, 0.0, lie, 0.0])
    markers = Markers(shape.s[at], shape.position[at], PLACE)
    return [Tensions(readings, CELL), markers, TipPosition(shape.tip, PLACE)]


def quick() -> Estimator:
    """Of an arm whose tensions may change by far more than what a load cell lies."""
    return Estimator({'tip': rubber(Unknowns(Walk(5.0, 5.0), tip_force=LIKELY))}, DOUBTING)


@pytest.mark.parametrize('period', [0.05, 0.25])
def test_a_sudden_touch_is_believed_where_the_sensors_are_far_more_exact_than_its_prior(period):
    random, size = np.random.default_rng(4), 0.025 * math.sqrt(-math.expm1(-2.0 * period))
    for _ in range(4):
        estimator = Estimator({'tip': rubber(FORCE_AT_TIP)}, DOUBTING)
        push = random.standard_normal(3)
        push *= size / np.linalg.norm(push)
        for step in range(8):
            true = tip(push if step > 4 else np.zeros(3)) + 2e-4 * random.standard_normal(3)
            given = [Tensions(TENSIONS, 0.01), TipPosition(true, 2e-4)]
            found = estimator.add(ORIGIN + round(step * period * SECOND), given)
        assert not estimator.refused_since and not found.begins_anew
        force = found.estimate.tip_wrench[:3]
        stddev = np.sqrt(found.estimate.tip_wrench_covariance.diagonal()[:3])
        assert (np.abs(force - push) < 5.0 * stddev).all()


@pytest.mark.parametrize('order', [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_what_is_measured_at_one_time_is_judged_together_whichever_comes_first(order):
    """Whether in one message or in several, and a load cell that lies is found in both."""
    together, apart = quick(), quick()
    for estimator in (together, apart):
        estimator.add(ORIGIN, sensors())
    for step in range(1, 5):
        stamp, given = ORIGIN + step * SECOND // 10, sensors(LIE if step in (2, 3) else 0.0)
        expected = together.add(stamp, given).estimate
        for number in order:
            found = apart.add(stamp, [given[number]]).estimate
        stddev = np.sqrt(np.diag(expected.covariance))
        # As exactly as either of them converges.
        assert (np.abs(found.mean - expected.mean) < 0.15 * stddev).all()
        assert np.allclose(np.sqrt(np.diag(found.covariance)), stddev, rtol=0.05, atol=1e-9)
        assert np.abs(found.tensions - TENSIONS).max() < 0.1 * LIE
    for estimator in (together, apart):
        counts = {name: (one.accepted, one.refused) for name, one in estimator.consistency.items()}
        assert counts.pop(LIAR)[1] >= 2
        assert sum(refused for _, refused in counts.values()) <= (estimator is apart)
        assert {sum(count) for count in counts.values()} == {5} and len(counts) == 3


def test_where_nothing_can_tell_the_covariance_holds_what_would_be():
    """Tensions and a tip are explained by a force, whichever load cell lies."""
    own = Estimator({'tip': rubber(Unknowns(Walk(5.0, 1.0), tip_force=LIKELY))}, DOUBTING)
    trusting = Estimator({'tip': rubber(Unknowns(Walk(5.0, 1.0), tip_force=LIKELY))})
    shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(PUSH, np.zeros(3)))
    readings = TENSIONS * [1.0, 0.5, 1.0, 1.0]
    for step in range(20):
        given = [Tensions(readings, CELL), TipPosition(shape.tip, PLACE)]
        stamp = ORIGIN + step * SECOND // 10
        found, other = (one.add(stamp, given).estimate for one in (own, trusting))
        off, wrong = (
            np.linalg.norm(one.backbone.position - shape.position, axis=1)[1:]
            / np.sqrt(np.trace(one.pose_covariance[1:, :3, :3], axis1=1, axis2=2))
            for one in (found, other)
        )
        assert off.max() < 8.0
    assert wrong.max() > 3.0 * off.max()


def test_a_failure_changes_nothing_but_the_counts():
    unbounded = Unknowns(Walk(1e4, 1e4), tip_force=LIKELY)
    estimator = Estimator({'tip': rubber(unbounded)})
    given = [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)]
    estimator.add(ORIGIN, given)
    crushed = Tensions([3e3, 0.0, 0.0, 0.0], 0.1)  # no shape holds that
    with pytest.raises(SolveError):
        estimator.add(ORIGIN + SECOND, [crushed])
    with pytest.raises(MeasurementError, match='one for each tendon'):
        estimator.add(ORIGIN + SECOND, [Tensions([1.0], 0.1)])
    assert estimator.failed == 1 and estimator.consistency['tensions'].accepted == 1
    other = Estimator({'tip': rubber(unbounded)})
    other.add(ORIGIN, given)
    found, expected = (one.add(ORIGIN + SECOND // 5, given).estimate for one in (estimator, other))
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=1e-12)


def test_what_a_message_says_does_not_change_what_it_may_cost(monkeypatch):
    model, spent = rubber(FORCE_AT_TIP), [0]
    follow = model.solver.follow

    def counted(*given: Any) -> Backbone:
        try:
            found = follow(*given)
        except ConvergenceError as error:
            spent[0] += error.iterations
            raise
        spent[0] += int(found.iterations)
        return found

    monkeypatch.setattr(model.solver, 'follow', counted)
    own, rng = Estimator({'tip': model}, DOUBTING), np.random.default_rng(1)
    own.add(ORIGIN, [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)])
    for step in range(1, 12):
        wild = Tensions(4.0 * rng.random(4), 0.01), TipPosition(0.2 * rng.normal(size=3), 1e-3)
        for one in wild:
            spent[0] = 0
            with contextlib.suppress(SolveError):
                own.add(ORIGIN + step * SECOND // 20, [one])
            # Those of a step and of a new beginning, and the last solve of each.
            assert spent[0] <= 80 + 160 + 4 * BUDGET.iterations


# Where an unknown force acts ---------------------------------------------------------------------


UNKNOWNS = Unknowns(Walk(5.0, 1.0))
PLACES = (0.07, 0.13, 0.19)
FORCE = Walk.stationary(0.02, 0.2)


def models() -> dict[str, object]:
    found = {
        f'{s} m': rubber(dataclasses.replace(UNKNOWNS, point_forces=(PointForce(s, FORCE),)))
        for s in PLACES
    }
    return {'free': rubber(UNKNOWNS), **found}


@pytest.mark.parametrize(
    'place',
    [0.13, None, *(pytest.param(place, marks=pytest.mark.endurance) for place in (0.07, 0.19))],
)
def test_the_place_is_found(place):
    rng = np.random.default_rng(7)
    given = models()
    name = 'free' if place is None else f'{place} m'
    model = given[name]
    x = np.concatenate([TENSIONS, [] if place is None else [0.0, 0.02, -0.015]])
    shape = Prediction(model, x, None).solved
    s = np.array([0.05, 0.1, 0.15, 0.2])
    at = Markers(s, np.zeros((4, 3)), 1e-3)
    positions = -at.innovation(Prediction(model, x, None)).reshape(4, 3)
    bank = Estimator(given)
    for step in range(3):
        noisy = positions + 1e-3 * rng.normal(size=(4, 3))
        found = bank.add(step * SECOND // 10, [Tensions(TENSIONS, 0.01), Markers(s, noisy, 1e-3)])
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    assert found.hypothesis == name and found.probabilities[name] > 0.9
    np.testing.assert_allclose(found.estimate.backbone.tip, shape.tip, atol=2e-3)
    if place is not None:
        where = model.state.point_forces
        error = found.estimate.mean[where] - x[where]
        assert error @ np.linalg.solve(found.estimate.covariance[where, where], error) < 16.0


def test_a_truth_that_changes_is_followed():
    given = {name: model for name, model in models().items() if name in ('free', '0.19 m')}
    s = np.array([0.1, 0.2])
    bank = Estimator(given, change_time=1.0)
    for step, force in enumerate([0.0, 0.0, 0.02, 0.02, 0.02]):
        model = given['0.19 m']
        x = np.concatenate([TENSIONS, [0.0, force, 0.0]])
        positions = -Markers(s, np.zeros((2, 3)), 1e-3).innovation(Prediction(model, x, None))
        measured = [Tensions(TENSIONS, 0.01), Markers(s, positions.reshape(2, 3), 1e-3)]
        found = bank.add(step * SECOND // 10, measured)
        assert found.hypothesis == ('0.19 m' if force else 'free')
        # Neither is ever beyond doubt.
        assert min(found.probabilities.values()) > 1e-20
    with pytest.raises(MeasurementError, match='before the window'):
        bank.add(-SECOND, [])
    assert bank.late == 1
    with pytest.raises(MeasurementError, match='at least one'):
        Estimator({})
    with pytest.raises(MeasurementError, match='change_time'):
        Estimator(given, change_time=0.0)


def test_late_measurements_count_as_in_time():
    """In any order within the window: the same probabilities and the same states."""
    given = {name: model for name, model in models().items() if name in ('free', '0.19 m')}
    model, s = given['0.19 m'], np.array([0.1, 0.2])
    x = np.concatenate([TENSIONS, [0.0, 0.004, 0.0]])
    positions = -Markers(s, np.zeros((2, 3)), 1e-3).innovation(Prediction(model, x, None))
    seen = Markers(s, positions.reshape(2, 3), 3e-3)
    measured = [[Tensions(TENSIONS, 0.01)], [seen], [Tensions(TENSIONS, 0.01)], [seen]]
    results = []
    for order in ((0, 1, 2, 3), (0, 2, 3, 1), (1, 0, 2, 3)):
        bank = Estimator(given, change_time=1.0, window=1.0)
        for step in order:
            found = bank.add(step * SECOND // 10, measured[step])
            assert [one.name for one in found.innovations] == [measured[step][0].name]
        results.append(found)
        assert found.estimate.elapsed == pytest.approx(0.3)
    one = results[0]
    for other in results[1:]:
        assert one.hypothesis == other.hypothesis
        for name, probability in one.probabilities.items():
            assert 1e-3 < probability < 0.999
            assert probability == pytest.approx(other.probabilities[name], rel=1e-2)
        np.testing.assert_allclose(one.estimate.mean, other.estimate.mean, atol=5e-3)


# Lost and found again ----------------------------------------------------------------------------


PERIOD = SECOND // 10  # of every sensor
AFTER = 0.5  # [s] of refusals to begin anew
STEADY = Walk(5.0, 0.1)  # tensions that are told to change by 0.1 N in a second
RULES = Rules(cell_fault=0.1, sensor_fault=0.005, recover_after=AFTER)
JUMP = np.array([2.0, 0.0, 0.0, 0.0])  # by which they really change [N]
Sensor = Callable[[Backbone, np.ndarray], Measurement]
RANDOM = np.random.default_rng(11)


def noise(stddev: float, *shape: int) -> np.ndarray:
    return stddev * RANDOM.standard_normal(shape)


def cells(shape: Backbone, tensions: np.ndarray) -> Measurement:
    return Tensions(tensions + noise(CELL, 4), CELL)


def markers(shape: Backbone, tensions: np.ndarray) -> Measurement:
    seen = [10, 20, 30]
    return Markers(shape.s[seen], shape.position[seen] + noise(PLACE, 3, 3), PLACE)


def seen_tip(shape: Backbone, tensions: np.ndarray) -> Measurement:
    return TipPosition(shape.tip + noise(PLACE, 3), PLACE)


def lying_tip(shape: Backbone, tensions: np.ndarray) -> Measurement:
    return TipPosition(shape.tip + [0.0, 0.0, 0.04] + noise(PLACE, 3), PLACE)


SOLVER = Solver(RUBBER, 'exact', 31)
CALM, MOVED = (SOLVER.solve([tensions]) for tensions in (TENSIONS, TENSIONS + JUMP))


def tracker(**options: float) -> Estimator:
    model = rubber(Unknowns(STEADY, tip_force=LIKELY))
    return Estimator({'tip': model}, RULES, **options)


def steps(
    of: Estimator, numbers: Iterable[int], sensors: Iterable[Sensor], *, is_moved: bool = False
) -> list[EstimatorOutput]:
    """What ``sensors`` measure at each step, one after the other; what comes of each."""
    shape, tensions = (MOVED, TENSIONS + JUMP) if is_moved else (CALM, TENSIONS)
    return [
        of.add(ORIGIN + step * PERIOD + number, [sensor(shape, tensions)])
        for step in numbers
        for number, sensor in enumerate(sensors)
    ]


def assert_is(tracked: EstimatorOutput, shape: Backbone) -> None:
    """The estimate is ``shape`` within its bounds, which are narrow."""
    estimate = tracked.estimate
    for station in (15, 30):
        covariance = estimate.pose_covariance[station, :3, :3]
        away = estimate.backbone.position[station] - shape.position[station]
        assert away @ np.linalg.solve(covariance, away) < 30.0  # chi-square of 3, 1e-6
        assert np.sqrt(np.trace(covariance)) < 0.1  # JUMP moves the seen_tip by 0.07


def test_an_arm_that_moves_faster_than_told_is_found_again():
    own = tracker()
    assert_is(steps(own, range(2, 4), [cells, markers, seen_tip])[-1], CALM)
    lost = steps(own, range(4, 9), [cells, markers, seen_tip], is_moved=True)
    assert not any(one.begins_anew for one in lost) and own.restarts == 0
    # Load cells were refused first at step 4, and AFTER is five steps.
    found = steps(own, range(9, 11), [cells, markers, seen_tip], is_moved=True)
    assert [one.begins_anew for one in found[:3]].count(True) == own.restarts == 1
    assert_is(found[-1], MOVED)
    assert all(part.is_accepted for one in found[3:] for part in one.innovations)
    later = steps(own, [11], [cells, markers, seen_tip], is_moved=True)
    assert_is(later[-1], MOVED)
    assert own.restarts == 1


@pytest.mark.endurance
def test_a_sensor_that_lies_alone_stays_thrown_out():
    own = tracker()
    steps(own, range(4), [cells, markers, seen_tip])
    # Long enough to begin anew three times.
    found = steps(own, range(4, 22), [cells, markers, lying_tip])
    assert own.restarts == 0
    # At first it may be right: a force on the tip explains what it says.
    assert own.consistency['tip position'].refused >= 15
    assert own.consistency['markers'].refused == own.consistency['tensions'].refused == 0
    assert_is(found[-1], CALM)
    assert_is(steps(own, range(22, 42), [cells, markers, seen_tip])[-1], CALM)
    assert not own.refused_since


@pytest.mark.endurance
def test_the_arm_is_found_again_beside_a_sensor_that_lies():
    own = tracker()
    steps(own, range(4), [cells, markers, seen_tip])
    steps(own, range(4, 8), [cells, markers, lying_tip])
    found = steps(own, range(8, 20), [cells, markers, lying_tip], is_moved=True)
    assert_is(found[-1], MOVED)


def test_one_sensor_alone_is_believed_once_it_has_contradicted_for_long():
    own = tracker()
    steps(own, range(4), [cells])
    assert_is(steps(own, range(4, 12), [cells], is_moved=True)[-1], MOVED)
    before = own.restarts
    for step in range(12, 40):
        # A broken wire: readings that no arm has, each another.
        wild = Tensions(np.abs(noise(2.0, 4)) + 4.0 * (step % 2), CELL)
        own.add(ORIGIN + step * PERIOD, [wild])
    # Each time that it is in vain it takes twice as long to the next.
    assert own.restarts <= before + 3


@pytest.mark.endurance
def test_it_begins_anew_where_the_place_of_a_force_is_unknown():
    def at(s: float) -> ArmModel:
        return rubber(Unknowns(STEADY, point_forces=(PointForce(s, LIKELY),)))

    own = Estimator({'0.1 m': at(0.1), '0.2 m': at(0.2)}, RULES, change_time=1.0)
    steps(own, range(3), [cells, markers])
    found = steps(own, range(3, 10), [cells, markers], is_moved=True)
    assert_is(found[-1], MOVED)
    assert sum(found[-1].probabilities.values()) == pytest.approx(1.0)
