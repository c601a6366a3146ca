"""The estimator of an arm: from measurements to its shape and the contact force.

If the place of a contact is unknown it has one bank of hypotheses for each place, and the contact
may move from one to another at any time (first-order multiple-model estimator, Bar-Shalom, Li and
Kirubarajan 2001, 11.6).
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, SolveError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import check_class, is_number
from octo_arm_model.estimation.estimate import EVALUATIONS, ITERATIONS, Estimate, next_estimate
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.model import ArmModel, Work
from octo_arm_model.estimation.rules import Consistency, Innovation, Rules

MAX_MOMENTS = 1000  # largest number of moments that are stored for late measurements


class EstimatorOutput(NamedTuple):
    """The output of the estimator after a message."""

    estimate: Estimate  #: the newest estimate, by the most probable place of contact
    hypothesis: str  #: name of this place
    probabilities: Mapping[str, float]  #: probabilities of all places, by name
    #: innovations of the measurements of the message, also if they were late
    innovations: tuple[Innovation, ...]
    begins_anew: bool  #: whether the estimate began anew from the prior


class _Moment(NamedTuple):
    """The measurements of one time, and the newest estimate for each place of contact.

    Without a trustworthy shape the estimate is an earlier one or None, and its probability is 0.
    The most probable place says since when each refused sensor has been refused [s], by name.
    """

    time: float
    measurements: tuple[Measurement, ...]
    estimates: tuple[Estimate | None, ...]
    probability: FloatArray
    refused_since: Mapping[str, float]

    @property
    def leading(self) -> tuple[int, Estimate]:
        """The index of the most probable place, and the estimate by it."""
        best = int(self.probability.argmax())
        estimate = self.estimates[best]
        assert estimate is not None
        return best, estimate


class Estimator:
    """The estimator of one arm.

    Measurements of different sensors at one time are processed together, in any order of their
    messages. A late measurement is inserted at its time, and later ones are processed again. One
    that equals another of the same time is the same, delivered twice, and has no effect.

    Attributes:
        consistency: statistics of each kind of measurement, by its name.
        refused_since: stamp since which each refused sensor has been refused [ns], by its name.
        suspects: names of the smallest set of sensors of which one is wrong, if none is refused.
        late: number of messages that came later than the window.
        failed: number of times at which the arm had no trustworthy shape.
        restarts: number of times that the estimate began anew.
        origin_ns: stamp of the time zero [ns]; None before the first message.
    """

    def __init__(
        self,
        models: Mapping[str, ArmModel],
        rules: Rules = Rules(),
        window: float = 0.0,
        change_time: float = math.inf,
    ) -> None:
        """Begin with one of ``models`` for each place of contact, by name, equally probable.

        Measurements may come up to ``window`` [s] late. The contact moves to another place once
        in ``change_time`` [s] on average.

        Raises:
            MeasurementError: if a number is outside its range, or there is no model.
        """
        check_class('rules', rules, Rules)
        check_class('models', models, Mapping)
        for name, model in models.items():
            check_class(f'models[{name!r}]', model, ArmModel)
        if not models:
            raise MeasurementError('models are none, expected at least one')
        if not is_number(change_time) or not change_time > 0.0:
            raise MeasurementError(f'change_time is {shown(change_time)}, expected > 0 [s]')
        if not is_number(window) or not 0.0 <= window < math.inf:
            raise MeasurementError(f'window is {shown(window)}, expected a finite number >= 0 [s]')
        self._models, self._rules, self._change_time = dict(models), rules, change_time
        self._window = window
        self._moments: list[_Moment] = []
        self._is_cut = False  # whether there were moments before these
        self._failing_since = math.inf
        self.consistency: dict[str, Consistency] = {}
        self.refused_since: dict[str, int] = {}
        self.suspects: tuple[str, ...] = ()
        self.late = self.failed = self.restarts = 0
        self.origin_ns: int | None = None

    def add(self, stamp_ns: int, measurements: Sequence[Measurement]) -> EstimatorOutput:
        """Process ``measurements`` of the time ``stamp_ns`` [ns], and return the newest estimate.

        If it fails, only the counts change.

        Raises:
            MeasurementError: if the stamp is no int64, or measurements are too late or do not fit.
            SolveError: if the arm has no trustworthy shape.
        """
        is_integer = isinstance(stamp_ns, (int, np.integer)) and not isinstance(stamp_ns, bool)
        if not (is_integer and abs(stamp_ns := int(stamp_ns)) < 2**63):
            raise MeasurementError(f'stamp_ns is {shown(stamp_ns)}, expected an int64 [ns]')
        check_class('measurements', measurements, Sequence)
        origin = stamp_ns if self.origin_ns is None else self.origin_ns
        time, is_new = 1e-9 * (stamp_ns - origin), False
        same = [old for past in self._moments if past.time == time for old in past.measurements]
        new = tuple[Measurement, ...]()
        for measurement in measurements:
            check_class('a measurement', measurement, Measurement)
            if not any(map(measurement.is_same, (*same, *new))):
                new += (measurement,)
        count = len(self._models)
        share = max(2, EVALUATIONS // count), max(10, ITERATIONS // count)
        work = [Work(*share) for _ in range(count)]
        try:
            moments, index, replaced = self._with_measurements(self._moments, time, new, work)
        except SolveError:
            self.failed += 1
            self._failing_since = min(self._failing_since, time)
            if not 0.0 < self._rules.recover_after <= time - self._failing_since:
                raise
            moments, index, replaced = self._with_measurements([], time, new, work)
            self._is_cut, is_new = False, True
        self.origin_ns, added, newest = origin, moments[index], moments[-1]
        if time >= self._failing_since:
            self._failing_since = math.inf
        # A late measurement needs the moments of the time before the window.
        times = [old.time for old in moments]
        since = max(1, bisect.bisect_left(times, newest.time - self._window))
        first = max(bisect.bisect_left(times, times[since - 1]), len(moments) - MAX_MOMENTS)
        self._moments, self._is_cut = moments[first:], self._is_cut or first > 0
        (best, estimate), (place, added_estimate) = newest.leading, added.leading
        innovations = added_estimate.innovations_after(replaced and replaced.estimates[place])
        refused = newest.refused_since.items()
        self.refused_since = {name: origin + round(1e9 * since) for name, since in refused}
        self.suspects = estimate.suspects
        # If it begins anew at a time, it does so with the first message of this time.
        begins_anew = is_new or (added is newest and replaced is None and estimate.begins_anew)
        self.restarts += begins_anew
        for innovation in innovations:
            record = self.consistency.setdefault(innovation.name, Consistency())
            record.count(stamp_ns, innovation)
        probabilities = dict(zip(self._models, newest.probability.tolist(), strict=True))
        name = list(probabilities)[best]
        return EstimatorOutput(estimate, name, probabilities, innovations, begins_anew)

    def _with_measurements(
        self,
        moments: list[_Moment],
        time: float,
        measurements: tuple[Measurement, ...],
        work: Sequence[Work],
    ) -> tuple[list[_Moment], int, _Moment | None]:
        """Return the moments with new ``measurements``, their index, and the moment replaced."""
        if not measurements and any(old.time == time for old in moments):
            return moments, -1, moments[-1]
        index, replaced = bisect.bisect_right([moment.time for moment in moments], time), None
        # The first measurement of all may come second; then it is put before the other one.
        if moments and not index and (self._is_cut or time < moments[-1].time - self._window):
            self.late += 1
            raise MeasurementError(
                f'measured {moments[-1].time - time:.4g} s before the newest measurement, '
                f'before the window of {self._window:g} s'
            )
        # A moment can be computed again only if the one before it is stored.
        if index > self._is_cut and moments[index - 1].time == time:
            same = moments[index - 1]
            heard, others = (
                {name for one in some for name in one.channels(same.leading[1].prediction)}
                for some in (same.measurements, measurements)
            )
            if not heard & others:
                index, replaced = index - 1, same
                measurements = same.measurements + measurements
        last = moments[index - 1] if index else None
        updated = [*moments[:index], self._next_moment(last, time, measurements, replaced, work)]
        for old in moments[index + (replaced is not None) :]:
            updated.append(self._next_moment(updated[-1], old.time, old.measurements, old, work))
        return updated, index, replaced

    def _next_moment(
        self,
        last: _Moment | None,
        time: float,
        measurements: tuple[Measurement, ...],
        nearby: _Moment | None,
        work: Sequence[Work],
    ) -> _Moment:
        """Return the moment at ``time`` [s] after the ``last``; search from ``nearby``, if any.

        Raises:
            SolveError: if the arm has no trustworthy shape wherever the contact is.
        """
        count = len(self._models)
        before, moved = np.full(count, 1.0 / count), 0.0
        estimates: list[Estimate | None] = [None] * count
        if last is not None:
            before, estimates = last.probability, list(last.estimates)
            moved = -math.expm1(-(time - last.time) / self._change_time)
        likelihoods, failure = np.full(count, -math.inf), None
        for number, model in enumerate(self._models.values()):
            last_estimate, start = estimates[number], nearby and nearby.estimates[number]
            try:
                estimate = next_estimate(
                    model, last_estimate, time, measurements, self._rules, start, work[number]
                )
            except SolveError as error:
                failure = error
                continue
            estimates[number] = estimate
            likelihoods[number] = estimate.log_likelihood
        with np.errstate(divide='ignore'):
            logarithms = np.log((1.0 - moved) * before + moved / count) + likelihoods
        highest = logarithms.max()
        if failure is not None and highest == -math.inf:
            raise failure
        probability = np.exp(logarithms - highest)
        moment = _Moment(time, measurements, tuple(estimates), probability / probability.sum(), {})
        newest, since = moment.leading[1], {} if last is None else last.refused_since
        refused = {name: since.get(name, time) for name in newest.refused}
        unheard = {name: since[name] for name in since.keys() - newest.heard}
        return moment._replace(refused_since=unheard | refused)
