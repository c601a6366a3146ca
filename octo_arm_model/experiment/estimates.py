"""The estimates of a recording by filter or smoother, and the touches in them."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, OctoArmError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.files import CsvFiles
from octo_arm_model.estimation.estimate import Contact, Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import Consistency
from octo_arm_model.estimation.smoother import check_count, smooth_steps
from octo_arm_model.estimation.unknowns import State
from octo_arm_model.experiment.camera import CameraErrors
from octo_arm_model.experiment.sensor_recording import SensorRecording, StampedMeasurement
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.wire.messages import Refusals

Group = Sequence[StampedMeasurement]  # measurements with the same stamp


def _filtered(
    estimator: Estimator,
    groups: Sequence[Group],
    failures: Refusals,
    progress: Callable[[int, int], None],
) -> Iterator[tuple[Group, EstimatorOutput]]:
    """Yield the estimates of the recursive filter, from the measurements up to each time.

    Measurements of a time without an estimate are left out and counted in ``failures``.
    """
    for number, group in enumerate(groups):
        progress(number, len(groups))
        try:
            yield group, estimator.add(group[0].stamp_ns, [item.measurement for item in group])
        except OctoArmError as error:
            failures.count('', str(error))
    progress(len(groups), len(groups))


def _smoothed(
    filtered: Iterable[tuple[Group, EstimatorOutput]], models: Mapping[str, ArmModel]
) -> Iterator[tuple[Group, EstimatorOutput]]:
    """Yield the estimates of the smoother, each from all measurements that the filter used.

    MeasurementError if the place of contact is unknown, SolveError if there is no solution.
    """
    if len(models) > 1:
        raise MeasurementError(
            '--smooth goes with one place of contact, not with --contact somewhere'
        )
    (name,) = models
    steps: list[tuple[Group, EstimatorOutput]] = []
    for group, update in filtered:
        update.estimate.prediction.forget()
        steps.append((group, update))
    estimates = smooth_steps([update.estimate for _, update in steps])
    for (group, update), estimate in zip(steps, estimates, strict=True):
        anew = update.begins_anew
        yield group, EstimatorOutput(estimate, name, {name: 1.0}, estimate.innovations, anew)


SURE = 0.999  # probability of no false alarm at one time
LEARNT = 0.5  # largest ratio of the standard deviations of estimate and prior if a force counts
GAP = 0.5  # [s] without a significant force that ends a touch
SHORTEST = 0.1  # [s]
_NONE = Contact(np.nan, np.full(6, np.nan), np.full((6, 6), np.nan))


class Moment(NamedTuple):
    """Tip, contact and their standard deviations at one time."""

    stamp_ns: int  #: stamp of the measurements [ns]
    received_ns: int  #: time when the recorder had received all of them [ns]
    time: float  #: time from the start of the recording [s]
    tip: FloatArray  #: position of the tip (3,) [m]
    tip_stddev: FloatArray  #: standard deviations of the position of the tip (3,) [m]
    s: float  #: arc coordinate of the contact [m]; NaN for a current, and without contact
    wrench: FloatArray  #: wrench of the contact (6,) [N, N m]; NaN without contact
    #: standard deviations of the wrench (6,); zero for components that are not estimated
    wrench_stddev: FloatArray
    hypothesis: str  #: name of the hypothesis of the estimate
    is_significant: bool  #: whether the force is larger than its uncertainty explains


Output = Callable[[Moment, EstimatorOutput], None]  # takes one estimate, as to write it


def _moment_of(group: Group, update: EstimatorOutput, recorded: SensorRecording) -> Moment:
    """Return tip, contact and their deviations after the ``update`` by a ``group``."""
    estimate, stamp = update.estimate, group[0].stamp_ns
    tip_stddev = np.sqrt(np.diag(estimate.pose_covariance[-1]))[:3]
    contact = contact_of(estimate, recorded.config.arm) or _NONE
    return Moment(
        stamp,
        max(item.received_ns for item in group),
        1e-9 * (stamp - recorded.origin_ns),
        estimate.backbone.tip,
        tip_stddev,
        contact.s,
        contact.wrench,
        np.sqrt(np.diag(contact.covariance)),
        update.hypothesis,
        is_touched(estimate),
    )


def is_touched(estimate: Estimate) -> bool:
    """Whether the unknown contact force differs from zero in directions that measurements tell.

    They do not tell a force along a straight arm, for example: its estimate depends on the prior
    and on the other components.
    """
    state = estimate.state
    parts = state.tip_force, state.point_forces, state.current
    force = next((part for part in parts if part.stop > part.start), slice(0, 0))
    force = slice(force.start, min(force.start + 3, force.stop))
    if force.stop == force.start:
        return False
    variances, axes = np.linalg.eigh(estimate.covariance[force, force])
    learnt = variances <= (LEARNT * estimate.prior_stddev[force].min()) ** 2
    if not learnt.any():
        return False
    along = axes.T @ estimate.mean[force]
    square = float((along[learnt] ** 2 / variances[learnt]).sum())
    return square > chi_square_limit(SURE, int(learnt.sum()))


class Touch(NamedTuple):
    """One touch."""

    start: float  #: time of its start [s]
    stop: float  #: time of its end [s]
    force: FloatArray  #: median of the force in base_frame, (3,) [N]
    stddev: FloatArray  #: median of its standard deviations, (3,) [N]
    hypothesis: str  #: most frequent hypothesis of its estimates


def _find_touches(moments: Sequence[Moment]) -> list[Touch]:
    """Return the intervals of significant forces among ``moments`` in ascending time.

    Moments that are farther apart than `SHORTEST`, as static poses, are touches by themselves.
    """
    parts: list[list[Moment]] = []
    period = float(np.median(np.diff([one.time for one in moments]))) if len(moments) > 1 else 0.0
    for moment in moments:
        if moment.is_significant:
            if not parts or moment.time - parts[-1][-1].time > max(GAP, 1.5 * period):
                parts.append([])
            parts[-1].append(moment)
    shortest = SHORTEST if period < SHORTEST else 0.0
    return [_touch(part) for part in parts if part[-1].time - part[0].time >= shortest]


def _touch(moments: Sequence[Moment]) -> Touch:
    force = np.median([moment.wrench[:3] for moment in moments], axis=0)
    stddev = np.median([moment.wrench_stddev[:3] for moment in moments], axis=0)
    ((name, _),) = Counter(moment.hypothesis for moment in moments).most_common(1)
    return Touch(moments[0].time, moments[-1].time, force, stddev, name)


@dataclass(frozen=True)
class Result:
    """The estimates of a recording, in summary."""

    recorded: SensorRecording
    moments: Sequence[Moment]  #: tip and contact at each time
    touches: Sequence[Touch]  #: intervals in which the arm was touched
    consistency: Mapping[str, Consistency]  #: consistency of each kind of measurement, by its name
    failures: Refusals  #: counts of times without an estimate, by the reason
    #: directions of the state that no measurement depended on at the end, in words
    unobserved: Sequence[str]
    camera: CameraErrors | None  #: errors against a camera, or None
    hypotheses: Mapping[str, float]  #: mean probability of each hypothesis
    restarts: Sequence[float]  #: times at which the estimate was reset [s]
    #: times [s] at which one of several sensors may be wrong, by their names
    suspects: Mapping[tuple[str, ...], Sequence[float]]


def estimate(
    recorded: SensorRecording,
    is_smooth: bool = False,
    outputs: Iterable[Output] = (),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Result:
    """Estimate the state at all times; ``outputs`` are called with each estimate.

    ``progress`` is called with the numbers of times done and of all.

    Raises:
        SolveError: if there is no estimate at any time, or the smoother has no solution.
        MeasurementError: with ``is_smooth``, if times are too many or the contact's place unknown.
        OctoArmError: if one of ``outputs`` raises it.
    """
    failures, settings = Refusals(), recorded.settings
    change_time = settings.given.change_time
    estimator = Estimator(recorded.models, settings.rules, change_time=change_time)
    updates = _filtered(estimator, recorded.groups, failures, progress)
    if is_smooth:
        check_count(len(recorded.groups))
        updates = _smoothed(updates, recorded.models)
    moments: list[Moment] = []
    restarts: list[float] = []
    suspects: dict[tuple[str, ...], list[float]] = {}
    total: Counter[str] = Counter()
    for group, update in updates:
        moments.append(moment := _moment_of(group, update, recorded))
        for output in outputs:
            output(moment, update)
        if update.begins_anew:
            restarts.append(moment.time)
        if update.estimate.suspects:
            suspects.setdefault(tuple(sorted(update.estimate.suspects)), []).append(moment.time)
        if recorded.camera is not None:
            recorded.camera.add(moment.time, update.estimate.backbone)
        total.update(update.probabilities)
    if not moments:
        raise SolveError(f'no estimate at any time{failures.in_short}')
    return Result(
        recorded,
        moments,
        _find_touches(moments),
        estimator.consistency,
        failures,
        update.estimate.unobserved,
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
        """Create the tables in ``folder`` for estimates by ``models``.

        Raises:
            OSError: if a file cannot be written.
        """
        super().__init__()
        self._hypotheses = list(models) if len(models) > 1 else []
        self._estimates = self.open(folder / 'estimate.csv')
        self._innovations = self.open(folder / 'innovations.csv')
        self._innovations.writerow(INNOVATIONS)
        self._has_header = False

    def write(self, moment: Moment, update: EstimatorOutput) -> None:
        """Write the ``update`` of one time; OSError if it cannot be written."""
        time, estimate = round(moment.time, 9), update.estimate
        others = _besides_contact(estimate.state)
        names = [estimate.state.names[number] for number in others]
        names = [*_TIP, *_WRENCH, *(f'{name}{_unit(name)}' for name in names)]
        deviations = np.sqrt(np.diag(estimate.covariance))[others]
        values = np.concatenate([moment.tip, moment.wrench, estimate.mean[others]])
        stddevs = np.concatenate([moment.tip_stddev, moment.wrench_stddev, deviations])
        square, numbers = estimate.normalised_square
        row = {
            'time [s]': time,
            'stamp [ns]': moment.stamp_ns,
            'contact': moment.hypothesis,
            'contact s [m]': moment.s,
            **dict(zip(names, values.tolist())),
            **dict(zip([name.replace(' [', ' stddev [') for name in names], stddevs.tolist())),
            'normalised square': square,
            'numbers': numbers,
            'refused': ' and '.join(one.name for one in update.innovations if not one.is_accepted),
            **{f'probability {name}': update.probabilities[name] for name in self._hypotheses},
        }
        if not self._has_header:
            self._estimates.writerow(row)
            self._has_header = True
        self._estimates.writerow(row.values())
        for innovation in update.innovations:
            stddev = np.sqrt(np.diag(innovation.covariance))
            verdict = innovation.normalised_square, int(innovation.is_accepted)
            pairs = zip(innovation.value.tolist(), stddev.tolist(), strict=True)
            self._innovations.writerows(
                [time, innovation.name, number, *pair, *verdict]
                for number, pair in enumerate(pairs)
            )


def _besides_contact(state: State) -> list[int]:
    """Return the indices of a ``state`` without the contact, which has other columns."""
    others = slice(state.point_forces.start + 3, state.point_forces.stop)
    parts = state.tension, state.tension_bias, others, state.log_modulus, state.tension_loss
    return [number for part in parts for number in range(state.size)[part]]


def _unit(name: str) -> str:
    return ' [-]' if name.startswith(('log_modulus', 'tension_loss')) else ' [N]'
