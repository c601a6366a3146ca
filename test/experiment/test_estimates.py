"""Filter and smoother over one recording: both use the same measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Solver
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.sensor_topics import StampedMeasurement
from octo_arm_model.estimation.measurements import Measurement, Tensions, TipPosition
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.settings import EstimatorSettings, SensorNoise
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.experiment.estimates import (
    TimedEstimate,
    filtered,
    follow,
    smoothed,
)

SECOND = 10**9
PERIOD = SECOND // 10
CELL, PLACE = 0.01, 5e-4  # noise of a load cell [N], of a coordinate [m]
JUMP = np.array([2.0, 0.0, 0.0, 0.0])  # of the tensions, which are told to change by far less [N]
UNKNOWNS = Unknowns(Walk(5.0, 0.1), tip_force=LIKELY)
SETTINGS = EstimatorSettings(
    {'tip': UNKNOWNS}, SensorNoise(CELL, 0.0, PLACE, (), PLACE, 0.0, 0.0, 0.0, 0.0, 0.0),
    Rules(recover_after=0.5), window=0.0, change_time=1.0, notes=(),
)  # fmt: skip
SOLVER = Solver(RUBBER, 'exact', 31)
SHAPES = SOLVER.solve([TENSIONS]), SOLVER.solve([TENSIONS + JUMP])
Groups = list[list[StampedMeasurement]]


class TipOfBentArm(TipPosition):
    """What a camera sees of an arm that was pulled as far as after the jump."""

    def innovation(self, at: Prediction) -> FloatArray:
        if at.x[at.model.state.tension].sum() < (TENSIONS + 0.5 * JUMP).sum():
            raise SolveError('out of sight')
        return super().innovation(at)


def stamped(stamp: int, *measurements: Measurement) -> list[StampedMeasurement]:
    return [StampedMeasurement(stamp, stamp, one) for one in measurements]


def both(groups: Groups) -> tuple[list[TimedEstimate], list[TimedEstimate], list[str]]:
    """What filter and smoother make of ``groups``, and what failed in the filter."""
    failed: list[str] = []
    models = {'tip': rubber(UNKNOWNS)}
    return (
        list(filtered(follow(groups, SETTINGS, models, failed.append))),
        list(smoothed(follow(groups, SETTINGS, models, [].append), models)),
        failed,
    )


def begun(found: Sequence[TimedEstimate]) -> int:
    """Stamp of the new beginning, in periods."""
    (one,) = (one for one in found if one.begins_anew)
    return one.stamp_ns // PERIOD


def assert_tip(one: TimedEstimate, tip: FloatArray) -> None:
    covariance = one.estimate.pose_covariance[-1, :3, :3]
    away = one.estimate.backbone.tip - tip
    assert away @ np.linalg.solve(covariance, away) < 30.0  # chi-square of 3, 1e-6
    assert np.sqrt(np.trace(covariance)) < 5e-3  # the jump moves the tip by 0.07


def test_after_updates_that_failed_the_smoother_begins_where_the_filter_did() -> None:
    rng = np.random.default_rng(4)
    groups: Groups = []
    for step in range(14):
        is_bent = step >= 4
        seen = TipOfBentArm if is_bent else TipPosition
        tip = SHAPES[is_bent].tip + PLACE * rng.normal(size=3)
        tensions = TENSIONS + is_bent * JUMP + CELL * rng.normal(size=4)
        groups.append(stamped(step * PERIOD, Tensions(tensions, CELL), seen(tip, PLACE)))
    known, smooth, failed = both(groups)
    # Without a shape for 0.5 s at step 9, which is taken from the prior on.
    assert begun(known) == 9 and failed == ['out of sight'] * 5
    assert begun(smooth) == 9
    assert [one.stamp_ns // PERIOD for one in smooth] == [*range(4), *range(9, 14)]
    for one in smooth[4:]:
        assert_tip(one, SHAPES[1].tip)
        assert [part.is_accepted for part in one.innovations] == [True, True]
