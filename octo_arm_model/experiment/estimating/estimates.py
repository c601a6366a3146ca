"""Everything measured in a recording through a filter, or through the smoother."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from octo_arm_model.bags.sensor_topics import StampedMeasurement
from octo_arm_model.core.errors import MeasurementError, OctoArmError
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.prediction import ArmModel
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.tracker import Tracked, Tracker
from octo_arm_model.estimation.updated import Innovation

# Called with how many of the times are done, and of how many.
Progress = Callable[[int, int], None]
# Called with why the measurements of one time gave no estimate.
Failed = Callable[[str], None]


class TimedEstimate(NamedTuple):
    """The estimate of one time.

    Attributes:
        stamp_ns: when [ns].
        received_ns: when the recorder had received all that was measured then [ns].
        hypothesis: by which it is.
        probabilities: of all hypotheses.
        innovations: of what was measured.
        estimate: what is known.
        begins_anew: whether what was known before was given up, see `Tracker`.
    """

    stamp_ns: int
    received_ns: int
    hypothesis: str
    probabilities: Mapping[str, float]
    innovations: tuple[Innovation, ...]
    estimate: Estimate
    begins_anew: bool


def filtered(
    groups: Sequence[Sequence[StampedMeasurement]],
    settings: EstimatorSettings,
    models: Mapping[str, ArmModel],
    failed: Failed,
    progress: Progress = lambda done, total: None,
) -> Iterator[TimedEstimate]:
    """Estimates by the recursive filter, of what was measured up to each time.

    Args:
        groups: what was measured, by ascending time.
        settings: of the estimator.
        models: of its hypotheses.
        failed: told why of times without an estimate, whose measurements are left out.
        progress: called with how many of the times are done, and of how many.
    """
    for group, found in _tracked(groups, settings, models, failed, progress):
        yield TimedEstimate(
            *_stamps_of(group), found.hypothesis, found.probabilities, found.innovations,
            found.estimate, found.begins_anew,
        )  # fmt: skip


def _tracked(
    groups: Sequence[Sequence[StampedMeasurement]],
    settings: EstimatorSettings,
    models: Mapping[str, ArmModel],
    failed: Failed,
    progress: Progress,
) -> Iterator[tuple[Sequence[StampedMeasurement], Tracked]]:
    """What a `Tracker` makes of each of ``groups`` that has an estimate; see `filtered`."""
    tracker = Tracker.from_settings(settings, models, 0.0)
    for number, group in enumerate(groups):
        progress(number, len(groups))
        try:
            found = tracker.add(group[0].stamp_ns, [one.measurement for one in group])
        except OctoArmError as error:
            failed(str(error))
            continue
        yield group, found
    progress(len(groups), len(groups))


def _stamps_of(group: Sequence[StampedMeasurement]) -> tuple[int, int]:
    """When a ``group`` was measured, and when the recorder had received all of it [ns]."""
    return group[0].stamp_ns, max(one.received_ns for one in group)


def smoothed(
    groups: Sequence[Sequence[StampedMeasurement]],
    settings: EstimatorSettings,
    models: Mapping[str, ArmModel],
    failed: Failed,
    progress: Progress = lambda done, total: None,
) -> Iterator[TimedEstimate]:
    """Estimates by the smoother, each of all that was measured; otherwise as `filtered`.

    Where the filter begins anew so does the smoother, from the first measurement of that
    beginning on: what was measured before tells nothing of an arm that was lost.

    Raises:
        MeasurementError: if the place of contact is unknown, or a measurement does not fit the
            arm.
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
    """
    if len(models) > 1:
        raise MeasurementError(
            '--smooth goes with one place of contact, not with --contact somewhere'
        )
    ((name, model),) = models.items()
    times: list[float] = []
    kept: list[Sequence[StampedMeasurement]] = []
    starts, total = [0], 2 * len(groups)  # by the filter that finds where to begin, then by this

    def advanced(before: int) -> Callable[..., None]:
        return lambda done, *_: progress(before + done, total)

    for group, found in _tracked(groups, settings, models, failed, advanced(0)):
        kept.append(group)
        times.append(1e-9 * (group[0].stamp_ns - kept[0][0].stamp_ns))
        if found.anew_from is not None:
            starts.append(bisect.bisect_left(times, found.anew_from))
    for part, (start, stop) in enumerate(itertools.pairwise([*starts, len(kept)])):
        recording = [
            (time, [one.measurement for one in group])
            for time, group in zip(times[start:stop], kept[start:stop], strict=True)
        ]
        estimates = smooth(model, recording, settings.gate, advanced(len(groups) + start))
        for number, estimate in enumerate(estimates):
            yield TimedEstimate(
                *_stamps_of(kept[start + number]), name, {name: 1.0}, estimate.innovations,
                estimate, part > 0 and number == 0,
            )  # fmt: skip
    progress(total, total)
