"""Where an unknown force acts: several filters, each of another opinion, and their probabilities.

A bank of filters in which the truth may change from one to another at any time, each as likely as
the others (first-order multiple-model estimator, Bar-Shalom, Li and Kirubarajan 2001, 11.6).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import GATE, Step, check_gate, next_step
from octo_arm_model.estimation.gating.updated import Innovation
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.window import Window


@dataclass(frozen=True)
class Ranked:
    """One hypothesis.

    Attributes:
        name: of it.
        probability: of it after all measurements, in parts of 1.
        step: the newest of its filter; None where the arm had no trustworthy shape then.
        estimate: of that step, if it is true.
        innovations: of the measurements added last, also where they were late; empty where the
            arm had no trustworthy shape.
    """

    name: str
    probability: float
    step: Step | None
    estimate: Estimate | None
    innovations: tuple[Innovation, ...]


@dataclass(frozen=True)
class _Step:
    """One time, what was measured then and what came of it.

    Attributes:
        time: [s].
        measurements: made then.
        steps: the newest of each hypothesis, earlier where it had no trustworthy shape; None
            where it never had.
        has_shape: which had one (hypotheses,).
        probability: of each (hypotheses,).
    """

    time: float
    measurements: tuple[Measurement, ...]
    steps: tuple[Step | None, ...]
    has_shape: tuple[bool, ...]
    probability: FloatArray


class Hypotheses:
    """A filter for each of several models of one arm."""

    def __init__(
        self,
        models: Mapping[str, ArmModel],
        change_time: float = math.inf,
        gate: float = GATE,
        window: float = 0.0,
    ) -> None:
        """Of ``models`` by name, equally probable at first; `Filter` has the other two.

        The truth changes to another of them once in ``change_time`` [s].

        Raises:
            MeasurementError: if there are no models, or a number is outside its range.
        """
        if not models:
            raise MeasurementError('models are none, expected at least one')
        if not change_time > 0.0:
            raise MeasurementError(f'change_time is {change_time}, expected > 0 [s]')
        check_gate(gate)
        self._models, self._change_time, self._gate = dict(models), change_time, gate
        self._window = Window(self._next, window)

    @property
    def late(self) -> int:
        """How many measurements came later than the window."""
        return self._window.late

    def add(self, time: float, measurements: Sequence[Measurement]) -> list[Ranked]:
        """Take ``measurements`` made at ``time`` [s]; returns all hypotheses, likeliest first.

        Where it fails all is as it was.

        Raises:
            MeasurementError: if they come later than the window, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape by any hypothesis.
        """
        added, before, newest = self._window.add(time, measurements)
        ranked = []
        for number, name in enumerate(self._models):
            then, now = added.steps[number], newest.steps[number]
            innovations: tuple[Innovation, ...] = ()
            step = now if newest.has_shape[number] else None
            estimate = None if step is None else step.estimate(self._window.first)
            if then is not None and added.has_shape[number]:
                earlier = None
                if before is not None and before.has_shape[number]:
                    earlier = before.steps[number]
                innovations = then.updated.innovations_after(
                    () if before is None else before.measurements,
                    None if earlier is None else earlier.updated,
                )
            probability = float(newest.probability[number])
            ranked.append(Ranked(name, probability, step, estimate, innovations))
        return sorted(ranked, key=lambda one: -one.probability)

    def _next(
        self,
        last: _Step | None,
        time: float,
        measurements: tuple[Measurement, ...],
        near: _Step | None,
    ) -> _Step:
        """From the ``last`` step to ``time`` [s]; see `next_step`.

        Raises:
            SolveError: if the arm has no trustworthy shape by any hypothesis.
        """
        count = len(self._models)
        before, changed = np.full(count, 1.0 / count), 0.0
        steps: list[Step | None] = [None] * count
        if last is not None:
            before, steps = last.probability, list(last.steps)
            changed = -math.expm1(-(time - last.time) / self._change_time)
        likelihoods, failure = np.full(count, -math.inf), None
        for number, model in enumerate(self._models.values()):
            try:
                nearby = None if near is None else near.steps[number]
                found = next_step(model, steps[number], time, measurements, self._gate, nearby)
            except SolveError as error:
                failure = error
                continue
            steps[number] = found
            likelihoods[number] = found.updated.log_likelihood
        with np.errstate(divide='ignore'):
            logarithms = np.log((1.0 - changed) * before + changed / count) + likelihoods
        highest = logarithms.max()
        if failure is not None and highest == -math.inf:
            raise failure
        probability = np.exp(logarithms - highest)
        return _Step(
            time, measurements, tuple(steps), tuple((likelihoods > -math.inf).tolist()),
            probability / probability.sum(),
        )  # fmt: skip
