"""Everything measured in a recording through a filter, or through the smoother."""

from __future__ import annotations

import bisect
import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from octo_arm_model.arm.errors import MeasurementError, OctoArmError, SolveError
from octo_arm_model.bags.sensor_topics import StampedMeasurement
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import Step, next_step
from octo_arm_model.estimation.gating.updated import Innovation
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.smoother import smooth_steps
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.tracker import Beginning, Tracked, Tracker

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


def filtered(followed: Iterable[Followed]) -> Iterator[TimedEstimate]:
    """Estimates by the recursive filter, of what was measured up to each time."""
    for one in followed:
        if (found := one.found) is not None:
            yield TimedEstimate(
                *_stamps_of(one.group), found.hypothesis, found.probabilities, found.innovations,
                found.estimate, found.begins_anew,
            )  # fmt: skip


class Followed(NamedTuple):
    """Measurements of one time [s], and the filter's result; None where there is none."""

    group: Sequence[StampedMeasurement]
    time: float
    found: Tracked | None
    step: Step | None


def follow(
    groups: Sequence[Sequence[StampedMeasurement]],
    settings: EstimatorSettings,
    models: Mapping[str, ArmModel],
    failed: Failed,
    progress: Progress = lambda done, total: None,
) -> Iterator[Followed]:
    """Results of a `Tracker` for ``groups`` by ascending time, from its first estimate on.

    Where measurements of one time give no estimate they are left out, and ``failed`` is called.
    """
    tracker = Tracker.from_settings(settings, models, 0.0)
    for number, group in enumerate(groups):
        progress(number, len(groups))
        found = None
        try:
            found = tracker.add(group[0].stamp_ns, [one.measurement for one in group])
        except OctoArmError as error:
            failed(str(error))
        if tracker.origin_ns is not None:
            time = 1e-9 * (group[0].stamp_ns - tracker.origin_ns)
            yield Followed(group, time, found, found and found.step)
    progress(len(groups), len(groups))


def _stamps_of(group: Sequence[StampedMeasurement]) -> tuple[int, int]:
    """When a ``group`` was measured, and when the recorder had received all of it [ns]."""
    return group[0].stamp_ns, max(one.received_ns for one in group)


def smoothed(
    followed: Iterable[Followed], models: Mapping[str, ArmModel], gate: float
) -> Iterator[TimedEstimate]:
    """Estimates by the smoother, each of all that the filter used.

    Where the filter begins anew so does the smoother, from the first measurement of that
    beginning on: the measurements before it belong to a state that was given up.

    Raises:
        MeasurementError: if the place of contact is unknown.
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
    """
    if len(models) > 1:
        raise MeasurementError(
            '--smooth goes with one place of contact, not with --contact somewhere'
        )
    ((name, model),) = models.items()
    parts: list[list[Followed]] = [[]]
    for one in followed:
        if parts[-1] and (last := parts[-1][-1].step) is not None:
            last.updated.at.forget()
        if one.found is not None and (beginning := one.found.beginning) is not None:
            first = bisect.bisect_left(parts[-1], beginning.since, key=lambda one: one.time)
            lost = parts[-1][first:]
            del parts[-1][first:]
            parts.append(_begun(model, beginning, lost, one, gate))
        parts[-1].append(one)
    for number, part in enumerate(parts):
        known = [(one.group, one.step) for one in part if one.step is not None]
        estimates = smooth_steps(model, [step for _, step in known])
        for (group, _), estimate in zip(known, estimates, strict=True):
            yield TimedEstimate(
                *_stamps_of(group), name, {name: 1.0}, estimate.innovations, estimate,
                number > 0 and estimate is estimates[0],
            )  # fmt: skip


def _begun(
    model: ArmModel,
    beginning: Beginning,
    lost: Sequence[Followed],
    now: Followed,
    gate: float,
) -> list[Followed]:
    """Filter the measurements between the new ``beginning`` and ``now``, when it was found.

    The tracker used only the newest of them; its results until then are ``lost``.
    """
    begun, last = [], None
    for one in lost:
        made = tuple(
            part.measurement
            for part in one.group
            if part.measurement.name not in beginning.left_out
        )
        step = None
        with contextlib.suppress(SolveError):
            step = last = next_step(model, last, one.time, made, gate, now.step)
            step.updated.at.forget()
        begun.append(one._replace(step=step))
    return begun
