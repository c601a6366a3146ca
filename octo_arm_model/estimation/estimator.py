"""The estimator of an arm: whatever is measured in; shape and contact force out.

`Filter` is of one model. `Estimator` is the one loop of the node and of the bag tool, by stamps:
where the place of a contact is unknown there is a bank of sensors for each place, and the truth
may change from one to another at any time (first-order multiple-model estimator, Bar-Shalom, Li
and Kirubarajan 2001, 11.6).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import check_class
from octo_arm_model.estimation.estimate import Estimate, estimate_of
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.posterior import Work
from octo_arm_model.estimation.rules import Consistency, Innovation, Rules, count_innovations
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.step import EVALUATIONS, ITERATIONS, Step, next_step
from octo_arm_model.estimation.window import Window


class Estimated(NamedTuple):
    """What is known after a measurement.

    Attributes:
        estimate: by the most probable place of contact.
        step: the newest one of its bank.
        hypothesis: name of this place.
        probabilities: of all of them.
        innovations: of the measurements that were added, also where they were late.
        begins_anew: whether what was known before was given up.
    """

    estimate: Estimate
    step: Step
    hypothesis: str
    probabilities: Mapping[str, float]
    innovations: tuple[Innovation, ...]
    begins_anew: bool


@dataclass(frozen=True)
class _Moment:
    """One time, what was measured then, and the newest step of each place of contact.

    Attributes:
        time: [s].
        measurements: made then.
        steps: of each; earlier ones where the arm had no trustworthy shape, None where it never
            had.
        probability: of each, zero where the arm had no trustworthy shape.
    """

    time: float
    measurements: tuple[Measurement, ...]
    steps: tuple[Step | None, ...]
    probability: FloatArray


class Estimator:
    """Follows one arm.

    Attributes:
        consistency: of each kind of measurement, by its name.
        refused_since: stamp of the first message since which a sensor has been refused [ns].
        suspects: names of the fewest sensors of which one lies, where no single one is refused.
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
        self._models, self._rules, self._change_time = dict(models), rules, change_time
        self._window, self._length, self._late = Window(self._next, window), window, 0
        self._failing_since: float | None = None
        self._work: tuple[Work, ...] = ()
        self.consistency: dict[str, Consistency] = {}
        self.refused_since: dict[str, int] = {}
        self.suspects: tuple[str, ...] = ()
        self.failed = self.restarts = 0
        self.origin_ns: int | None = None

    @classmethod
    def from_settings(
        cls, settings: EstimatorSettings, models: Mapping[str, ArmModel], window: float
    ) -> Estimator:
        """Of ``models`` of ``settings``, for measurements up to ``window`` [s] late."""
        return cls(models, settings.rules, window, settings.change_time)

    @property
    def late(self) -> int:
        """How many measurements came too late."""
        return self._late + self._window.late

    def _is_lost(self, time: float) -> bool:
        """Whether there has been no shape for so long that the estimate has to begin anew."""
        if self._failing_since is None:
            self._failing_since = time
        after = self._rules.recover_after
        return after > 0.0 and time - self._failing_since >= after

    def add(self, stamp_ns: int, measurements: Sequence[Measurement]) -> Estimated:
        """Take ``measurements`` made at ``stamp_ns`` [ns].

        Where it fails nothing changes but the counts.

        Raises:
            MeasurementError: if they come too late, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape.
        """
        origin = stamp_ns if self.origin_ns is None else self.origin_ns
        count = len(self._models)
        share = max(2, EVALUATIONS // count), max(10, ITERATIONS // count)
        self._work = tuple(Work(*share) for _ in range(count))
        time, is_new = 1e-9 * (stamp_ns - origin), False
        try:
            added, before, newest = self._window.add(time, measurements)
        except SolveError:
            self.failed += 1
            if not self._is_lost(time):
                raise
            window, late = Window(self._next, self._length), self.late
            added, before, newest = window.add(time, measurements)
            self._window, self._late, is_new = window, late, True
        self.origin_ns, self._failing_since = origin, None
        number = int(newest.probability.argmax())
        step, own = newest.steps[number], added.steps[number]
        assert step is not None
        earlier = None if before is None else before.steps[number]
        innovations = () if own is None else own.innovations_after(earlier)
        begins_anew = is_new or (step.begins_anew and added is newest)
        self.restarts += begins_anew
        count_innovations(self.consistency, stamp_ns, innovations)
        if own is not None:
            self._note_refused(stamp_ns, own)
        names = list(self._models)
        probabilities = dict(zip(names, newest.probability.tolist(), strict=True))
        estimate = estimate_of(step, self._window.first)
        return Estimated(estimate, step, names[number], probabilities, innovations, begins_anew)

    def _note_refused(self, stamp_ns: int, step: Step) -> None:
        """Note since when sensors have been refused, of which a ``step`` heard."""
        refused = {one.name for one in step.innovations if not one.is_accepted}
        for name in refused:
            self.refused_since.setdefault(name, stamp_ns)
        heard = {name for one in step.measurements for name in one.channels(step.at)}
        heard |= {one.name for one in step.innovations}
        for name in (heard - refused) & self.refused_since.keys():
            del self.refused_since[name]
        self.suspects = step.suspects

    def _next(
        self,
        last: _Moment | None,
        time: float,
        measurements: tuple[Measurement, ...],
        near: _Moment | None,
    ) -> _Moment:
        """From the ``last`` moment to ``time`` [s].

        Raises:
            SolveError: if the arm has no trustworthy shape wherever the contact is.
        """
        count = len(self._models)
        before, changed = np.full(count, 1.0 / count), 0.0
        steps: list[Step | None] = [None] * count
        if last is not None:
            before, steps = last.probability, list(last.steps)
            changed = -math.expm1(-(time - last.time) / self._change_time)
        likelihoods, failure = np.full(count, -math.inf), None
        for number, (model, work) in enumerate(
            zip(self._models.values(), self._work, strict=True)
        ):
            nearby = None if near is None else near.steps[number]
            try:
                found = next_step(
                    model, steps[number], time, measurements, self._rules, nearby, work
                )
            except SolveError as error:
                failure = error
                continue
            steps[number] = found
            likelihoods[number] = found.log_likelihood
        with np.errstate(divide='ignore'):
            logarithms = np.log((1.0 - changed) * before + changed / count) + likelihoods
        highest = logarithms.max()
        if failure is not None and highest == -math.inf:
            raise failure
        probability = np.exp(logarithms - highest)
        return _Moment(time, measurements, tuple(steps), probability / probability.sum())


class Filter:
    """The recursive estimator of one arm.

    Measurements may come late, by at most the window: what followed is then done again.

    Attributes:
        model: the arm.
        refused: how many measurements were refused, by name.
        innovations: of the last that were added.
    """

    def __init__(self, model: ArmModel, window: float = 0.0, rules: Rules = Rules()) -> None:
        """Of ``model``, for measurements up to ``window`` [s] late, judged by ``rules``.

        Raises:
            MeasurementError: if a number is outside its range.
        """
        check_class('model', model, ArmModel)
        check_class('rules', rules, Rules)
        self.model = model
        self.refused: dict[str, int] = {}
        self.innovations: tuple[Innovation, ...] = ()
        self._window: Window[Step] = Window(
            lambda last, time, made, near: next_step(model, last, time, made, rules, near), window
        )

    @property
    def last(self) -> Step | None:
        """The newest step."""
        return self._window.last

    @property
    def late(self) -> int:
        """How many measurements came later than the window."""
        return self._window.late

    def add(self, time: float, measurements: Sequence[Measurement]) -> Estimate:
        """Take ``measurements`` made at ``time`` [s]; returns the newest estimate.

        Where it fails the filter is as it was.

        Raises:
            MeasurementError: if they come later than the window, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape.
        """
        step, before, newest = self._window.add(time, measurements)
        self.innovations = step.innovations_after(before)
        for one in self.innovations:
            if not one.is_accepted:
                self.refused[one.name] = self.refused.get(one.name, 0) + 1
        return estimate_of(newest, self._window.first)
