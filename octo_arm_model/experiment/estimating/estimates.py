"""Everything measured in a recording through a filter, or through the smoother."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from octo_arm_model.bags.sensor_topics import Measured
from octo_arm_model.core.errors import MeasurementError, OctoArmError
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.prediction import ArmModel
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.smoother import smooth
from octo_arm_model.estimation.tracker import Tracker
from octo_arm_model.estimation.updated import Innovation

# Called with how many of the times are done, and of how many.
Progress = Callable[[int, int], None]
# Called with the stamp [ns] of measurements that gave no estimate, and why.
Failed = Callable[[int, str], None]


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
    groups: Sequence[Sequence[Measured]],
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
        failed: told of times without an estimate, whose measurements are left out.
        progress: called with how many of the times are done, and of how many.
    """
    tracker = Tracker.from_settings(settings, models, 0.0)
    for number, group in enumerate(groups):
        progress(number, len(groups))
        stamp = group[0].stamp_ns
        try:
            found = tracker.add(stamp, [one.measurement for one in group])
        except OctoArmError as error:
            failed(stamp, str(error))
            continue
        received = max(one.received_ns for one in group)
        yield TimedEstimate(
            stamp, received, found.hypothesis, found.probabilities, found.innovations,
            found.estimate, found.begins_anew,
        )  # fmt: skip
    progress(len(groups), len(groups))


def smoothed(
    groups: Sequence[Sequence[Measured]],
    settings: EstimatorSettings,
    models: Mapping[str, ArmModel],
    progress: Progress = lambda done, total: None,
) -> Iterator[TimedEstimate]:
    """Estimates by the smoother, each of all that was measured; otherwise as `filtered`.

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
    origin, total = groups[0][0].stamp_ns, len(groups)
    recording = [
        (1e-9 * (group[0].stamp_ns - origin), [one.measurement for one in group])
        for group in groups
    ]
    found = smooth(model, recording, settings.gate, lambda done: progress(done, total))
    for group, estimate in zip(groups, found, strict=True):
        received = max(one.received_ns for one in group)
        yield TimedEstimate(
            group[0].stamp_ns, received, name, {name: 1.0}, estimate.innovations, estimate, False
        )
