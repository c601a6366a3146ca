"""The estimator of an arm: whatever is measured in; shape and contact force out.

`Filter` is of one model. `Estimator` is the one loop of the node and of the bag tool, by stamps:
where the place of a contact is unknown there is a bank of sensors for each place, and the truth
may change from one to another at any time (first-order multiple-model estimator, Bar-Shalom, Li
and Kirubarajan 2001, 11.6).
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import check_class
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.posterior import Work
from octo_arm_model.estimation.rules import Consistency, Innovation, Rules, count_innovations
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.step import EVALUATIONS, ITERATIONS, next_estimate

MAX_MOMENTS = 1000  # that are kept so that measurements may come late


class EstimatorOutput(NamedTuple):
    """What is known after a message.

    Attributes:
        estimate: the newest one, by the most probable place of contact.
        hypothesis: name of this place.
        probabilities: of all of them.
        innovations: of the measurements that were added, also where they were late.
        begins_anew: whether what was known before was given up.
    """

    estimate: Estimate
    hypothesis: str
    probabilities: Mapping[str, float]
    innovations: tuple[Innovation, ...]
    begins_anew: bool


class _Moment(NamedTuple):
    """One time, what was measured then, and the newest estimate of each place of contact.

    That is an earlier one where the arm had no trustworthy shape, None where it never had; the
    probability is zero then.
    """

    time: float
    measurements: tuple[Measurement, ...]
    estimates: tuple[Estimate | None, ...]
    probability: FloatArray


class Estimator:
    """Follows one arm.

    What different sensors measured at one time is judged together, whichever of their messages
    comes first. What is late is put in its place, and what followed is done again.

    Attributes:
        consistency: of each kind of measurement, by its name.
        refused_since: stamp of the first message since which a sensor has been refused [ns].
        suspects: names of the fewest sensors of which one lies, where no single one is refused.
        late: how many messages came later than the window.
        failed: at how many times the arm had no trustworthy shape.
        restarts: how often it began anew.
        origin_ns: stamp that times count from [ns]; None before the first.
    """

    def __init__(
        self,
        models: Mapping[str, ArmModel],
        rules: Rules = Rules(),
        window: float = 0.0,
        change_time: float = math.inf,
    ) -> None:
        """Of one ``model`` for each place of contact, by name, equally probable at first.

        Measurements may come up to ``window`` [s] late; the contact is at another place once in
        ``change_time`` [s].

        Raises:
            MeasurementError: if a number is outside its range, or there is no model.
        """
        check_class('rules', rules, Rules)
        check_class('models', models, Mapping)
        for name, model in models.items():
            check_class(f'models[{name!r}]', model, ArmModel)
        if not models:
            raise MeasurementError('models are none, expected at least one')
        if not change_time > 0.0:
            raise MeasurementError(f'change_time is {change_time}, expected > 0 [s]')
        if not 0.0 <= window < math.inf:
            raise MeasurementError(f'window is {window}, expected a finite number >= 0 [s]')
        self._models, self._rules, self._change_time = dict(models), rules, change_time
        self._window = window
        self._moments: list[_Moment] = []
        self._is_cut = False  # whether there were moments before these
        self._failing_since: float | None = None
        self.consistency: dict[str, Consistency] = {}
        self.refused_since: dict[str, int] = {}
        self.suspects: tuple[str, ...] = ()
        self.late = self.failed = self.restarts = 0
        self.origin_ns: int | None = None

    @classmethod
    def from_settings(
        cls, settings: EstimatorSettings, models: Mapping[str, ArmModel], window: float
    ) -> Estimator:
        """Of ``models`` of ``settings``, for measurements up to ``window`` [s] late."""
        return cls(models, settings.rules, window, settings.change_time)

    def add(self, stamp_ns: int, measurements: Sequence[Measurement]) -> EstimatorOutput:
        """Take ``measurements`` made at ``stamp_ns`` [ns].

        Where it fails nothing changes but the counts.

        Raises:
            MeasurementError: if they come too late, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape.
        """
        for one in measurements:
            check_class('a measurement', one, Measurement)
        origin = stamp_ns if self.origin_ns is None else self.origin_ns
        count = len(self._models)
        share = max(2, EVALUATIONS // count), max(10, ITERATIONS // count)
        work = [Work(*share) for _ in range(count)]
        time, made, is_new = 1e-9 * (stamp_ns - origin), tuple(measurements), False
        try:
            moments, place, before = self._with(self._moments, time, made, work)
        except SolveError:
            self.failed += 1
            if self._failing_since is None:
                self._failing_since = time
            if not 0.0 < self._rules.recover_after <= time - self._failing_since:
                raise
            moments, place, before = self._with([], time, made, work)
            self._is_cut, is_new = False, True
        self.origin_ns, self._failing_since = origin, None
        added, newest = moments[place], moments[-1]
        # The moment before the window is what a late measurement begins from.
        since = bisect.bisect_left([one.time for one in moments], newest.time - self._window)
        first = max(0, since - 1, len(moments) - MAX_MOMENTS)
        self._moments, self._is_cut = moments[first:], self._is_cut or first > 0
        number = int(newest.probability.argmax())
        estimate, own = newest.estimates[number], added.estimates[number]
        assert estimate is not None
        innovations: tuple[Innovation, ...] = ()
        if own is not None:
            innovations = own.innovations_after(before and before.estimates[number])
            self._note_refused(stamp_ns, own)
        begins_anew = is_new or (estimate.begins_anew and added is newest)
        self.restarts += begins_anew
        count_innovations(self.consistency, stamp_ns, innovations)
        names = list(self._models)
        probabilities = dict(zip(names, newest.probability.tolist(), strict=True))
        return EstimatorOutput(estimate, names[number], probabilities, innovations, begins_anew)

    def _note_refused(self, stamp_ns: int, estimate: Estimate) -> None:
        """Note since when sensors have been refused, of which an ``estimate`` heard."""
        refused = {one.name for one in estimate.innovations if not one.is_accepted}
        for name in refused:
            self.refused_since.setdefault(name, stamp_ns)
        heard = {name for one in estimate.measurements for name in one.channels(estimate.at)}
        heard |= {one.name for one in estimate.innovations}
        for name in (heard - refused) & self.refused_since.keys():
            del self.refused_since[name]
        self.suspects = estimate.suspects

    def _with(
        self,
        moments: list[_Moment],
        time: float,
        made: tuple[Measurement, ...],
        work: Sequence[Work],
    ) -> tuple[list[_Moment], int, _Moment | None]:
        """With what was ``made``, where that is among them, and the one that it is put into."""
        place, before = bisect.bisect_right([one.time for one in moments], time), None
        # Of two sensors the one measured first may be heard second: it begins the window then.
        if moments and not place and (self._is_cut or time < moments[-1].time - self._window):
            self.late += 1
            raise MeasurementError(
                f'measured at {time:.6g} s, before the window, which begins at '
                f'{moments[0].time:.6g} s'
            )
        # Without the moment before it one cannot be done again.
        if place > self._is_cut and moments[place - 1].time == time:
            names = {one.name for one in moments[place - 1].measurements}
            if not any(one.name in names for one in made):
                place, before = place - 1, moments[place - 1]
                made = before.measurements + made
        found = moments[:place]
        found.append(self._next(found[-1] if found else None, time, made, before, work))
        for later in moments[place + (before is not None) :]:
            found.append(self._next(found[-1], later.time, later.measurements, later, work))
        return found, place, before

    def _next(
        self,
        last: _Moment | None,
        time: float,
        made: tuple[Measurement, ...],
        near: _Moment | None,
        work: Sequence[Work],
    ) -> _Moment:
        """From the ``last`` moment to ``time`` [s]; looked for from one ``near``, if any.

        Raises:
            SolveError: if the arm has no trustworthy shape wherever the contact is.
        """
        count = len(self._models)
        before, changed = np.full(count, 1.0 / count), 0.0
        estimates: list[Estimate | None] = [None] * count
        if last is not None:
            before, estimates = last.probability, list(last.estimates)
            changed = -math.expm1(-(time - last.time) / self._change_time)
        likelihoods, failure = np.full(count, -math.inf), None
        for number, model in enumerate(self._models.values()):
            nearby = near and near.estimates[number]
            try:
                found = next_estimate(
                    model, estimates[number], time, made, self._rules, nearby, work[number]
                )
            except SolveError as error:
                failure = error
                continue
            estimates[number] = found
            likelihoods[number] = found.log_likelihood
        with np.errstate(divide='ignore'):
            logarithms = np.log((1.0 - changed) * before + changed / count) + likelihoods
        highest = logarithms.max()
        if failure is not None and highest == -math.inf:
            raise failure
        probability = np.exp(logarithms - highest)
        return _Moment(time, made, tuple(estimates), probability / probability.sum())


class Filter:
    """The recursive estimator of one arm, an `Estimator` by seconds.

    Attributes:
        model: the arm.
        innovations: of the last that were added.
        last: the newest estimate.
    """

    def __init__(self, model: ArmModel, window: float = 0.0, rules: Rules = Rules()) -> None:
        """Of ``model``, for measurements up to ``window`` [s] late, judged by ``rules``.

        Raises:
            MeasurementError: if a number is outside its range.
        """
        check_class('model', model, ArmModel)
        self.model, self._estimator = model, Estimator({'': model}, rules, window)
        self._estimator.origin_ns = 0
        self.innovations: tuple[Innovation, ...] = ()
        self.last: Estimate | None = None

    @property
    def refused(self) -> dict[str, int]:
        """How many measurements were refused, by name."""
        kinds = self._estimator.consistency
        return {name: one.refused for name, one in kinds.items() if one.refused}

    @property
    def late(self) -> int:
        """How many measurements came later than the window."""
        return self._estimator.late

    def add(self, time: float, measurements: Sequence[Measurement]) -> Estimate:
        """Take ``measurements`` made at ``time`` [s]; returns the newest estimate.

        Where it fails the filter is as it was.

        Raises:
            MeasurementError: if they come later than the window, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape.
        """
        if not math.isfinite(time):
            raise MeasurementError(f'time is {time}, expected a finite number [s]')
        found = self._estimator.add(round(1e9 * time), measurements)
        self.last, self.innovations = found.estimate, found.innovations
        return found.estimate
