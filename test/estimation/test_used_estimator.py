"""An estimator or model that was used before gives what a new one gives."""

import contextlib

import numpy as np
import pytest
from estimation_arms import LIKELY, TENSIONS, WEIGHT, rubber
from numpy.testing import assert_allclose

from octo_arm_model.arm.errors import MeasurementError, OctoArmError
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.measurements import (
    BaseWrench,
    Curvatures,
    Markers,
    Measurement,
    TendonDisplacements,
    Tensions,
    TipPose,
    TipPosition,
)
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

SECOND = 10**9
TRUSTING, DOUBTING = Rules(recover_after=0.3), Rules(0.9999, 0.1, 0.005, 0.3)
FORCE = (PointForce(0.1, LIKELY),)
# Unknowns for each place of contact.
CASES: dict[str, dict[str, Unknowns]] = {
    'tip': {'tip': Unknowns(Walk(5.0, 0.5), tip_force=LIKELY)},
    'friction': {'none': Unknowns(Walk(5.0, 2.0), tension_loss=Walk.stationary(0.1, 1.0))},
    'bias and E': {'none': Unknowns(Walk(5.0, 1.0), Walk(0.1, 0.01), log_modulus=Walk(0.05))},
    'current': {'current': Unknowns(Walk(5.0, 0.1), current=Walk.stationary(5.0, 1.0))},
    'somewhere': {
        'none': Unknowns(Walk(5.0, 1.0)),
        '0.1 m': Unknowns(Walk(5.0, 1.0), point_forces=FORCE),
    },
}
REFUSED: list[Measurement] = [
    Tensions(np.ones(5), 0.1),
    Tensions([1.0], 0.1, ('none',)),
    Markers([0.3], np.zeros((1, 3)), 1.0),
    TipPosition([0.2, 0.0], 1.0),
]
Recording = list[tuple[int, list[Measurement]]]


def models(case: str) -> dict[str, ArmModel]:
    return {name: rubber(unknowns, loads=WEIGHT) for name, unknowns in CASES[case].items()}


def measured(at: Prediction, rng: np.random.Generator) -> list[Measurement]:
    """Return measurements of some sensors, with noise; one of ten is wrong."""
    lie = 3.0 if rng.random() < 0.1 else 1.0

    def value(kind: type[Measurement], size: int, stddev: float) -> np.ndarray:
        zero = kind(np.zeros(size), 1.0)
        return -lie * zero.innovation(at) + stddev * rng.normal(size=size)

    shape, station = at.solved, [10, 30]
    position = shape.position[station] + 1e-3 * rng.normal(size=(2, 3))
    every: list[Measurement] = [
        Tensions(np.maximum(0.0, value(Tensions, 4, 0.02)), 0.02),
        TendonDisplacements(value(TendonDisplacements, 4, 2e-4), 2e-4),
        TipPosition(value(TipPosition, 3, 1e-3), 1e-3),
        Markers(shape.s[station], lie * position, 1e-3),
        TipPose(position[1], shape.quaternion[-1], np.repeat([1e-3, 0.02], 3)),
        Curvatures(shape.s[station], np.stack([shape.xi, shape.k], axis=1)[station], 1.0),
        BaseWrench(value(BaseWrench, 6, 1e-3), 1e-3),
    ]
    return [each for each in every if rng.random() < 0.4] or every[:1]


def recorded(model: ArmModel, rng: np.random.Generator, count: int) -> Recording:
    recording, stamp = [], 10**18
    for _ in range(count):
        stamp += int(SECOND * 10.0 ** (rng.uniform(-2, 0) if rng.random() < 0.9 else 2.0))
        x = np.zeros(model.state.size)
        x[model.state.tension] = TENSIONS * rng.uniform(0.0, 2.0, 4)
        recording.append((stamp, measured(Prediction(model, x, None), rng)))
    return recording


def added(estimator: Estimator, stamp: int, data: list[Measurement]) -> EstimatorOutput | str:
    try:
        return estimator.add(stamp, data)
    except OctoArmError as error:
        return str(error)


def assert_equal(output: EstimatorOutput | str, expected: EstimatorOutput | str) -> None:
    if isinstance(output, str) or isinstance(expected, str):
        assert output == expected
        return
    assert output.hypothesis == expected.hypothesis
    estimate, other = output.estimate, expected.estimate
    stddev = np.sqrt(np.diag(other.covariance))
    assert_allclose(estimate.mean / stddev, other.mean / stddev, rtol=0.0, atol=1e-6)
    assert_allclose(estimate.root / stddev, other.root / stddev, rtol=0.0, atol=1e-6)
    assert estimate.refused == other.refused and estimate.doubted == other.doubted
    assert estimate.suspects == other.suspects
    assert len(estimate.unobserved) == len(other.unobserved)
    assert_allclose(estimate.pose_covariance, other.pose_covariance, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize('case', CASES)
def test_used_models_and_refused_measurements_leave_no_trace(case):
    rng, used = np.random.default_rng(len(case)), models(case)
    recording, before = (recorded(next(iter(used.values())), rng, count) for count in (6, 4))
    crushed = Tensions([3e3, 0.0, 0.0, 0.0], 0.1)  # without an equilibrium
    for rules in (TRUSTING, DOUBTING):
        estimator, other = Estimator(used, rules, 0.1), Estimator(used, rules, 0.1)
        new = Estimator(models(case), rules, 0.1)
        for stamp, data in before:
            for each in (data, [crushed]):
                added(other, stamp, each)
        for stamp, data in recording:
            for refused in REFUSED:
                with pytest.raises(MeasurementError):
                    estimator.add(stamp, [*data, refused])
            with contextlib.suppress(OctoArmError):
                other.add(stamp, [crushed])
            assert_equal(added(estimator, stamp, data), added(new, stamp, data))
        assert estimator.refused_since == new.refused_since
        assert (estimator.failed, estimator.restarts) == (new.failed, new.restarts)


SHAPES = [
    rubber(Unknowns(Walk(5.0))).solver.solve([TENSIONS + change])
    for change in ([0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0])
]


def jumping(step: int) -> list[Measurement]:
    """Return what is measured of an arm that moves suddenly after four steps."""
    shape = SHAPES[step >= 4]
    markers = Markers(shape.s[10::10], shape.position[10::10], 5e-4)
    return [Tensions(shape.tensions.ravel(), 0.01), markers]


STIFF = Unknowns(Walk(5.0, 0.1), tip_force=Walk(1e-3), tip_moment=Walk(1e-4, 1e-3))


@pytest.mark.parametrize('together', [True, False])
def test_estimate_that_begins_anew_is_that_of_a_new_estimator_and_is_counted_once(together):
    model = {'tip': rubber(STIFF)}
    estimator = Estimator(model, TRUSTING)
    for step in range(8):
        data = jumping(step)
        for part in [data] if together else [[each] for each in data]:
            output = estimator.add(step * SECOND // 10, part)
            if output.begins_anew:
                assert output.estimate.elapsed == 0.0
                assert_equal(output, Estimator(model, TRUSTING).add(step * SECOND // 10, part))
    assert estimator.restarts == 1


def test_smoother_begins_anew_where_the_filter_does():
    model = rubber(STIFF)
    recording = [(0.1 * step, jumping(step)) for step in range(9)]
    smoothed = smooth(model, recording, TRUSTING)
    (first,) = {each.first for each in smoothed} - {0.0}
    after = [step for step in recording if step[0] >= first]
    for estimate, expected in zip(smoothed[-len(after) :], smooth(model, after, TRUSTING)):
        assert_allclose(estimate.mean, expected.mean, rtol=0.0, atol=1e-9)
        assert_allclose(estimate.covariance, expected.covariance, rtol=1e-6, atol=1e-12)


def test_late_readings_do_not_change_since_when_a_sensor_is_refused():
    estimators = [Estimator({'tip': rubber(CASES['tip']['tip'])}, DOUBTING, 1.0) for _ in '12']
    shape = SHAPES[0]
    for estimator, order in zip(estimators, ([0, 1, 2, 3, 4], [0, 1, 3, 4, 2])):
        for step in order:
            error = 0.04 if step > 2 else 0.0
            markers = Markers(shape.s[10::10], shape.position[10::10], 5e-4)
            tip = TipPosition(shape.tip + [0.0, 0.0, error], 5e-4)
            cells = Tensions(TENSIONS, 0.01)
            estimator.add(step * SECOND // 20, [cells, markers, tip])
    in_order, late = estimators
    assert late.refused_since == in_order.refused_since == {'tip position': 3 * SECOND // 20}
    tip = in_order.consistency['tip position']
    assert (tip.refused_from, tip.refused_to) == (3 * SECOND // 20, 4 * SECOND // 20)
    assert late.suspects == in_order.suspects


def test_a_sensor_is_refused_since_earlier_though_it_is_alone_at_first():
    estimator, shape = Estimator({'tip': rubber(CASES['tip']['tip'])}, DOUBTING), SHAPES[0]
    for step in range(4):
        stamp, error = step * SECOND // 2, 0.04 if step > 1 else 0.0
        tip = TipPosition(shape.tip + [0.0, 0.0, error], 5e-4)
        is_alone_accepted = not estimator.add(stamp, [tip]).estimate.refused
        markers = Markers(shape.s[10::10], shape.position[10::10], 5e-4)
        estimator.add(stamp, [Tensions(TENSIONS, 0.01), markers])
    assert is_alone_accepted
    assert estimator.refused_since == {'tip position': SECOND}
