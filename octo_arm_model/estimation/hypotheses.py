"""Where an unknown force acts: several filters, each of another opinion, and their probabilities.

A bank of filters in which the truth may change from one to another at any time, each as likely as
the others (first-order multiple-model estimator, Bar-Shalom, Li and Kirubarajan 2001, 11.6).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.core.errors import MeasurementError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import GATE, Filter
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.prediction import ArmModel


@dataclass(frozen=True)
class Ranked:
    """One hypothesis.

    Attributes:
        name: of it.
        probability: of it after all measurements, in parts of 1.
        estimate: if it is true; None where the arm had no trustworthy shape then.
    """

    name: str
    probability: float
    estimate: Estimate | None


class Hypotheses:
    """A filter for each of several models of one arm."""

    def __init__(
        self, models: Mapping[str, ArmModel], change_time: float = math.inf, gate: float = GATE
    ) -> None:
        """Of ``models`` by name, equally probable at first.

        The truth changes to another of them once in ``change_time`` [s].

        Raises:
            MeasurementError: if there are no models, or a number is outside its range.
        """
        if not models:
            raise MeasurementError('models are none, expected at least one')
        if not change_time > 0.0:
            raise MeasurementError(f'change_time is {change_time!r}, expected > 0 [s]')
        self._filters = {name: Filter(model, 0.0, gate) for name, model in models.items()}
        self._change_time, self._time = change_time, -math.inf
        self._probability: FloatArray = np.full(len(models), 1.0 / len(models))

    def add(self, time: float, measurements: Sequence[Measurement]) -> list[Ranked]:
        """Take ``measurements`` made at ``time`` [s]; returns all hypotheses, likeliest first.

        Raises:
            MeasurementError: if they come late, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape by any hypothesis.
        """
        if not time >= self._time:
            raise MeasurementError(f'measured at {time!r} s, after {self._time!r} s')
        estimates: list[Estimate | None] = []
        logarithms, failure = [], None
        for one in self._filters.values():
            try:
                estimate = one.add(time, measurements)
                logarithms.append(estimate.log_likelihood)
                estimates.append(estimate)
            except SolveError as error:
                failure = error
                logarithms.append(-math.inf)
                estimates.append(None)
        highest = max(logarithms)
        if failure is not None and highest == -math.inf:
            raise failure
        changed = -math.expm1(-(time - self._time) / self._change_time)
        if math.isinf(self._time) or math.isinf(self._change_time):
            changed = 0.0
        self._time = time
        before = (1.0 - changed) * self._probability + changed / len(estimates)
        found = before * np.exp(np.array(logarithms) - highest)
        self._probability = found / found.sum()
        ranked = [
            Ranked(name, float(probability), estimate)
            for name, probability, estimate in zip(
                self._filters, self._probability, estimates, strict=True
            )
        ]
        return sorted(ranked, key=lambda one: -one.probability)
