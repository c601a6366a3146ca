"""The estimates of a recording: each is passed to a writer, and a summary of all returned."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.gating.consistency import Consistency, count_innovations
from octo_arm_model.estimation.smoother import check_count
from octo_arm_model.experiment.estimating.camera_check import CameraErrors
from octo_arm_model.experiment.estimating.estimates import (
    Progress,
    TimedEstimate,
    filtered,
    follow,
    smoothed,
)
from octo_arm_model.experiment.estimating.history import Moment, Touch, find_touches, moment_of
from octo_arm_model.experiment.estimating.recorded import Recorded
from octo_arm_model.wire.refusals import Refusals


@dataclass(frozen=True)
class Result:
    """The estimates of a recording, in summary.

    Attributes:
        recorded: what was measured.
        moments: course of the estimate.
        touches: when the arm was touched.
        consistency: of each kind of measurement, by its name.
        failures: times without an estimate, by the reason.
        unlearnt: directions of the state that no measurement depended on at the end, in words.
        camera: errors against a camera; None where there is none.
        hypotheses: mean probability of each.
        restarts: times at which what was known before was given up [s].
    """

    recorded: Recorded
    moments: Sequence[Moment]
    touches: Sequence[Touch]
    consistency: Mapping[str, Consistency]
    failures: Refusals
    unlearnt: Sequence[str]
    camera: CameraErrors | None
    hypotheses: Mapping[str, float]
    restarts: Sequence[float]


def estimate(
    recorded: Recorded,
    is_smooth: bool = False,
    write: Callable[[Moment, TimedEstimate], None] = lambda moment, one: None,
    progress: Progress = lambda done, total: None,
) -> Result:
    """Estimates of all times, of which ``write`` is called with each.

    Raises:
        SolveError: if there is none; with ``is_smooth`` as `smoothed`.
        MeasurementError: with ``is_smooth`` also if there are too many times.
        OctoArmError: as ``write``.
    """
    failures = Refusals()
    followed = follow(
        recorded.groups, recorded.settings, recorded.models,
        lambda reason: failures.count('', reason), progress,
    )  # fmt: skip
    found = filtered(followed)
    if is_smooth:
        check_count(len(recorded.groups))
        found = smoothed(followed, recorded.models, recorded.settings.gate)
    moments: list[Moment] = []
    consistency: dict[str, Consistency] = {}
    restarts: list[float] = []
    total: Counter[str] = Counter()
    for one in found:
        time = 1e-9 * (one.stamp_ns - recorded.origin_ns)
        moments.append(moment_of(time, one, recorded.config.arm))
        write(moments[-1], one)
        if one.begins_anew:
            restarts.append(time)
        count_innovations(consistency, one.stamp_ns, one.innovations)
        if recorded.camera is not None:
            recorded.camera.add(time, one.estimate.backbone)
        total.update(one.probabilities)
    if not moments:
        raise SolveError(f'no estimate at any time{failures.in_short}')
    return Result(
        recorded, moments, find_touches(moments), consistency, failures,
        [direction.reason for direction in one.estimate.unlearnt],
        recorded.camera.errors() if recorded.camera is not None else None,
        {name: value / len(moments) for name, value in total.items()},
        restarts,
    )  # fmt: skip
