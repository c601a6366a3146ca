"""The estimates of a recording by filter or smoother, and when the arm was touched."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, OctoArmError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.sensor_topics import StampedMeasurement
from octo_arm_model.config.files import CsvFiles
from octo_arm_model.estimation.estimate import Contact, Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import Consistency, count_innovations
from octo_arm_model.estimation.smoother import check_count, smooth_steps
from octo_arm_model.estimation.unknowns import State
from octo_arm_model.experiment.camera import CameraErrors
from octo_arm_model.experiment.sensor_recording import SensorRecording
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.wire.messages import Refusals

Group = Sequence[StampedMeasurement]  # what has the same stamp


def _filtered(
    recorded: SensorRecording, failures: Refusals, progress: Callable[[int, int], None]
) -> Iterator[tuple[Group, EstimatorOutput]]:
    """Estimates by the recursive filter, of what was measured up to each time.

    Where measurements of one time give no estimate they are left out, and are ``failures``.
    """
    estimator = Estimator.from_settings(recorded.settings, recorded.models, 0.0)
    for number, group in enumerate(recorded.groups):
        progress(number, len(recorded.groups))
        try:
            yield group, estimator.add(group[0].stamp_ns, [one.measurement for one in group])
        except OctoArmError as error:
            failures.count('', str(error))
    progress(len(recorded.groups), len(recorded.groups))


def _smoothed(
    filtered: Iterable[tuple[Group, EstimatorOutput]], models: Mapping[str, ArmModel]
) -> Iterator[tuple[Group, EstimatorOutput]]:
    """Estimates by the smoother, each of all that the filter used.

    Where the filter begins anew so does the smoother: the measurements before belong to a state
    that was given up.
    MeasurementError if the place of contact is unknown, SolveError if there is no solution.
    """
    if len(models) > 1:
        raise MeasurementError(
            '--smooth goes with one place of contact, not with --contact somewhere'
        )
    (name,) = models
    parts: list[list[tuple[Group, Estimate]]] = [[]]
    for group, one in filtered:
        if one.begins_anew:
            parts.append([])
        one.estimate.at.forget()
        parts[-1].append((group, one.estimate))
    for number, part in enumerate(parts):
        estimates = smooth_steps([step for _, step in part])
        for (group, _), estimate in zip(part, estimates, strict=True):
            begins = number > 0 and estimate is estimates[0]
            yield group, EstimatorOutput(estimate, name, {name: 1.0}, estimate.innovations, begins)


SURE = 0.999  # probability of no false alarm at one time
LEARNT = 0.5  # part of the standard deviation of the prior that is left where a force counts
GAP = 0.5  # [s] without a significant force that ends a touch
SHORTEST = 0.1  # [s]
_NONE = Contact(np.nan, np.full(6, np.nan), np.full((6, 6), np.nan))


class Moment(NamedTuple):
    """Tip, contact and their standard deviations at one time.

    Attributes:
        stamp_ns: when [ns].
        received_ns: when the recorder had received all that was measured then [ns].
        time: when, from the start of the recording [s].
        tip: position (3,) [m].
        tip_stddev: (3,) [m].
        s: where the contact is [m]; NaN of a current, and of none.
        wrench: of the contact, (6,) [N, N m]; NaN of none.
        wrench_stddev: zero of what is not estimated, (6,).
        hypothesis: by which it is.
        is_significant: whether the force is more than its uncertainty explains.
    """

    stamp_ns: int
    received_ns: int
    time: float
    tip: FloatArray
    tip_stddev: FloatArray
    s: float
    wrench: FloatArray
    wrench_stddev: FloatArray
    hypothesis: str
    is_significant: bool


def _moment_of(group: Group, one: EstimatorOutput, recorded: SensorRecording) -> Moment:
    """Tip, contact and their deviations by ``one`` estimate, of what a ``group`` measured."""
    estimate, stamp = one.estimate, group[0].stamp_ns
    tip_stddev = np.sqrt(np.diag(estimate.pose_covariance[-1]))[:3]
    contact = contact_of(estimate, recorded.config.arm) or _NONE
    return Moment(
        stamp,
        max(part.received_ns for part in group),
        1e-9 * (stamp - recorded.origin_ns),
        estimate.backbone.tip,
        tip_stddev,
        contact.s,
        contact.wrench,
        np.sqrt(np.diag(contact.covariance)),
        one.hypothesis,
        is_touched(estimate),
    )


def is_touched(estimate: Estimate) -> bool:
    """Whether the unknown force of a contact is not zero, as far as anything was learnt of it.

    Along a straight arm, as an example, nothing is: a force that is found there is what the prior
    makes of others that would have been seen.
    """
    state = estimate.state
    parts = state.tip_force, state.point_forces, state.current
    where = next((part for part in parts if part.stop > part.start), slice(0, 0))
    where = slice(where.start, min(where.start + 3, where.stop))
    if where.stop == where.start:
        return False
    variances, axes = np.linalg.eigh(estimate.covariance[where, where])
    learnt = variances <= (LEARNT * estimate.prior_stddev[where].min()) ** 2
    if not learnt.any():
        return False
    along = axes.T @ estimate.mean[where]
    square = float((along[learnt] ** 2 / variances[learnt]).sum())
    return square > chi_square_limit(SURE, int(learnt.sum()))


class Touch(NamedTuple):
    """One touch.

    Attributes:
        start: when it begins [s].
        stop: when it ends [s].
        force: median of the force in base_frame, (3,) [N].
        stddev: median of its standard deviations, (3,) [N].
        hypothesis: by which it was mostly found.
    """

    start: float
    stop: float
    force: FloatArray
    stddev: FloatArray
    hypothesis: str


def _find_touches(moments: Iterable[Moment]) -> list[Touch]:
    """Intervals of significant forces among ``moments`` by ascending time."""
    parts: list[list[Moment]] = []
    for one in moments:
        if one.is_significant:
            if not parts or one.time - parts[-1][-1].time > GAP:
                parts.append([])
            parts[-1].append(one)
    return [_touch(part) for part in parts if part[-1].time - part[0].time >= SHORTEST]


def _touch(part: Sequence[Moment]) -> Touch:
    force = np.median([one.wrench[:3] for one in part], axis=0)
    stddev = np.median([one.wrench_stddev[:3] for one in part], axis=0)
    ((name, _),) = Counter(one.hypothesis for one in part).most_common(1)
    return Touch(part[0].time, part[-1].time, force, stddev, name)


@dataclass(frozen=True)
class Result:
    """The estimates of a recording, in summary.

    Attributes:
        recorded: what was measured.
        moments: course of the estimate.
        touches: when the arm was touched.
        consistency: of each kind of measurement, by its name.
        failures: times without an estimate, by the reason.
        unobserved: directions of the state that no measurement depended on at the end, in words.
        camera: errors against a camera; None where there is none.
        hypotheses: mean probability of each.
        restarts: times at which what was known before was given up [s].
        suspects: times [s] at which one of some sensors may lie, by their names; see `Estimate`.
    """

    recorded: SensorRecording
    moments: Sequence[Moment]
    touches: Sequence[Touch]
    consistency: Mapping[str, Consistency]
    failures: Refusals
    unobserved: Sequence[str]
    camera: CameraErrors | None
    hypotheses: Mapping[str, float]
    restarts: Sequence[float]
    suspects: Mapping[tuple[str, ...], Sequence[float]]


def estimate(
    recorded: SensorRecording,
    is_smooth: bool = False,
    write: Callable[[Moment, EstimatorOutput], None] = lambda moment, one: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Result:
    """Estimates of all times, of which ``write`` is called with each.

    ``progress`` is called with how many of the times are done, and of how many.

    Raises:
        SolveError: if there is none; with ``is_smooth`` as `_smoothed`.
        MeasurementError: with ``is_smooth`` also if there are too many times.
        OctoArmError: as ``write``.
    """
    failures = Refusals()
    found = _filtered(recorded, failures, progress)
    if is_smooth:
        check_count(len(recorded.groups))
        found = _smoothed(found, recorded.models)
    moments: list[Moment] = []
    consistency: dict[str, Consistency] = {}
    restarts: list[float] = []
    suspects: dict[tuple[str, ...], list[float]] = {}
    total: Counter[str] = Counter()
    for group, one in found:
        moments.append(moment := _moment_of(group, one, recorded))
        write(moment, one)
        if one.begins_anew:
            restarts.append(moment.time)
        if one.estimate.suspects:
            suspects.setdefault(tuple(sorted(one.estimate.suspects)), []).append(moment.time)
        count_innovations(consistency, moment.stamp_ns, one.innovations)
        if recorded.camera is not None:
            recorded.camera.add(moment.time, one.estimate.backbone)
        total.update(one.probabilities)
    if not moments:
        raise SolveError(f'no estimate at any time{failures.in_short}')
    return Result(
        recorded,
        moments,
        _find_touches(moments),
        consistency,
        failures,
        [direction.reason for direction in one.estimate.unobserved],
        recorded.camera.errors() if recorded.camera is not None else None,
        {name: value / len(moments) for name, value in total.items()},
        restarts,
        suspects,
    )


_WRENCH = [*(f'force {axis} [N]' for axis in 'xyz'), *(f'moment {axis} [N m]' for axis in 'xyz')]
_TIP = [f'tip {axis} [m]' for axis in 'xyz']
INNOVATIONS = (
    'time [s]',
    'measurement',
    'component',
    'innovation',
    'stddev',
    'normalised square',
    'accepted',
)


class EstimateTables(CsvFiles):
    """Writes estimate.csv, a row for each time, and innovations.csv, a row for each number."""

    def __init__(self, folder: Path, models: Mapping[str, ArmModel]) -> None:
        """Write into ``folder`` what is estimated by ``models``.

        Raises:
            OSError: if a file cannot be written.
        """
        super().__init__()
        self._hypotheses = list(models) if len(models) > 1 else []
        self._estimates = self.open(folder / 'estimate.csv')
        self._innovations = self.open(folder / 'innovations.csv')
        self._innovations.writerow(INNOVATIONS)
        state = next(iter(models.values())).state
        others = [state.names[number] for number in _besides_contact(state)]
        values = [*_TIP, *_WRENCH, *(f'{name}{_unit(name)}' for name in others)]
        deviations = [name.replace(' [', ' stddev [') for name in values]
        self._estimates.writerow(
            [
                'time [s]',
                'stamp [ns]',
                'contact',
                'contact s [m]',
                *values,
                *deviations,
                'normalised square',
                'numbers',
                'refused',
                *(f'probability {name}' for name in self._hypotheses),
            ]
        )

    def write(self, moment: Moment, one: EstimatorOutput) -> None:
        """Write ``one`` estimate; OSError if it cannot be written."""
        time, estimate = round(moment.time, 9), one.estimate
        at = _besides_contact(estimate.state)
        deviations = np.sqrt(np.diag(estimate.covariance))[at]
        self._estimates.writerow(
            [
                time,
                moment.stamp_ns,
                moment.hypothesis,
                moment.s,
                *moment.tip.tolist(),
                *moment.wrench.tolist(),
                *estimate.mean[at].tolist(),
                *moment.tip_stddev.tolist(),
                *moment.wrench_stddev.tolist(),
                *deviations.tolist(),
                *estimate.normalised_square,
                ' and '.join(part.name for part in one.innovations if not part.is_accepted),
                *(one.probabilities[name] for name in self._hypotheses),
            ]
        )
        for part in one.innovations:
            stddev = np.sqrt(np.diag(part.covariance))
            for number, (value, size) in enumerate(zip(part.value, stddev, strict=True)):
                self._innovations.writerow(
                    [
                        time,
                        part.name,
                        number,
                        float(value),
                        float(size),
                        part.normalised_square,
                        int(part.is_accepted),
                    ]
                )


def _besides_contact(state: State) -> list[int]:
    """Components of a ``state`` but those of the contact, which has columns of its own."""
    others = slice(state.point_forces.start + 3, state.point_forces.stop)
    parts = state.tension, state.tension_bias, others, state.log_modulus, state.tension_loss
    return [number for part in parts for number in range(state.size)[part]]


def _unit(name: str) -> str:
    return ' [-]' if name.startswith(('log_modulus', 'tension_loss')) else ' [N]'
