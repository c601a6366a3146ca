"""An arm that is lost is found again, and nobody who lies alone makes the estimate begin anew."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pytest
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Backbone, Solver
from octo_arm_model.estimation.estimator import Estimated, Estimator
from octo_arm_model.estimation.measurements import Markers, Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

SECOND = 10**9
PERIOD = SECOND // 10  # of every sensor
ORIGIN = 1_700_000_000 * SECOND
AFTER = 0.5  # [s] of refusals to begin anew
STEADY = Walk(5.0, 0.1)  # tensions that are told to change by 0.1 N in a second
RULES = Rules(cell_fault=0.1, sensor_fault=0.005, recover_after=AFTER)
JUMP = np.array([2.0, 0.0, 0.0, 0.0])  # by which they really change [N]
CELL, PLACE = 0.01, 5e-4  # noise of a load cell [N], of a coordinate [m]
Sensor = Callable[[Backbone, np.ndarray], Measurement]
RANDOM = np.random.default_rng(11)


def noise(stddev: float, *shape: int) -> np.ndarray:
    return stddev * RANDOM.standard_normal(shape)


def cells(shape: Backbone, tensions: np.ndarray) -> Measurement:
    return Tensions(tensions + noise(CELL, 4), CELL)


def markers(shape: Backbone, tensions: np.ndarray) -> Measurement:
    seen = [10, 20, 30]
    return Markers(shape.s[seen], shape.position[seen] + noise(PLACE, 3, 3), PLACE)


def tip(shape: Backbone, tensions: np.ndarray) -> Measurement:
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
) -> list[Estimated]:
    """What ``sensors`` measure at each step, one after the other; what comes of each."""
    shape, tensions = (MOVED, TENSIONS + JUMP) if is_moved else (CALM, TENSIONS)
    return [
        of.add(ORIGIN + step * PERIOD + number, [sensor(shape, tensions)])
        for step in numbers
        for number, sensor in enumerate(sensors)
    ]


def assert_is(tracked: Estimated, shape: Backbone) -> None:
    """The estimate is ``shape`` within its bounds, which are narrow."""
    estimate = tracked.estimate
    for station in (15, 30):
        covariance = estimate.pose_covariance[station, :3, :3]
        away = estimate.backbone.position[station] - shape.position[station]
        assert away @ np.linalg.solve(covariance, away) < 30.0  # chi-square of 3, 1e-6
        assert np.sqrt(np.trace(covariance)) < 0.1  # JUMP moves the tip by 0.07


def test_an_arm_that_moves_faster_than_told_is_found_again() -> None:
    own = tracker()
    assert_is(steps(own, range(2, 4), [cells, markers, tip])[-1], CALM)
    lost = steps(own, range(4, 9), [cells, markers, tip], is_moved=True)
    assert not any(one.begins_anew for one in lost) and own.restarts == 0
    # Load cells were refused first at step 4, and AFTER is five steps.
    found = steps(own, range(9, 11), [cells, markers, tip], is_moved=True)
    assert [one.begins_anew for one in found[:3]].count(True) == own.restarts == 1
    assert_is(found[-1], MOVED)
    assert all(part.is_accepted for one in found[3:] for part in one.innovations)
    later = steps(own, [11], [cells, markers, tip], is_moved=True)
    assert_is(later[-1], MOVED)
    assert own.restarts == 1


@pytest.mark.endurance
def test_a_sensor_that_lies_alone_stays_thrown_out() -> None:
    own = tracker()
    steps(own, range(4), [cells, markers, tip])
    # Long enough to begin anew three times.
    found = steps(own, range(4, 22), [cells, markers, lying_tip])
    assert own.restarts == 0
    assert own.consistency['tip position'].refused == 18
    assert own.consistency['markers'].refused == own.consistency['tensions'].refused == 0
    assert_is(found[-1], CALM)
    assert_is(steps(own, range(22, 42), [cells, markers, tip])[-1], CALM)
    assert not own.refused_since


@pytest.mark.endurance
def test_the_arm_is_found_again_beside_a_sensor_that_lies() -> None:
    own = tracker()
    steps(own, range(4), [cells, markers, tip])
    steps(own, range(4, 8), [cells, markers, lying_tip])
    found = steps(own, range(8, 20), [cells, markers, lying_tip], is_moved=True)
    assert_is(found[-1], MOVED)


def test_one_sensor_alone_is_believed_once_it_has_contradicted_for_long() -> None:
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
def test_it_begins_anew_where_the_place_of_a_force_is_unknown() -> None:
    def at(s: float) -> ArmModel:
        return rubber(Unknowns(STEADY, point_forces=(PointForce(s, LIKELY),)))

    own = Estimator({'0.1 m': at(0.1), '0.2 m': at(0.2)}, RULES, change_time=1.0)
    steps(own, range(3), [cells, markers])
    found = steps(own, range(3, 10), [cells, markers], is_moved=True)
    assert_is(found[-1], MOVED)
    assert sum(found[-1].probabilities.values()) == pytest.approx(1.0)
