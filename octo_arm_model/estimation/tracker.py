"""Estimates from measurements with stamps as they come, and how well they agree with each other.

The one loop of the node and of the bag tool: a filter, or several where the place of a contact is
unknown, what they refused, and their normalised innovations.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from octo_arm_model.core.errors import MeasurementError, SolveError
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import GATE, Filter
from octo_arm_model.estimation.hypotheses import Hypotheses
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.prediction import ArmModel
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.update import Innovation

RECENT = 200  # innovations of a kind that count as recent


class Tracked(NamedTuple):
    """What is known after a measurement.

    Attributes:
        estimate: by the most probable hypothesis.
        hypothesis: its name.
        probabilities: of all of them.
        innovations: of the measurements that were added, also where they were late.
    """

    estimate: Estimate
    hypothesis: str
    probabilities: Mapping[str, float]
    innovations: tuple[Innovation, ...]


@dataclass
class Consistency:
    """Innovations of one kind of measurement.

    Attributes:
        accepted: how many measurements.
        refused: how many the gate refused.
        square: sum of the normalised squares of those accepted; chi-square of `size` where all
            is as told.
        size: of how many numbers.
        recent: square and size of the newest of them.
        refused_from: stamp of the first one refused [ns]; None of none.
        refused_to: of the last.
    """

    accepted: int = 0
    refused: int = 0
    square: float = 0.0
    size: int = 0
    recent: collections.deque[tuple[float, int]] = field(
        default_factory=lambda: collections.deque(maxlen=RECENT)
    )
    refused_from: int | None = None
    refused_to: int | None = None

    @property
    def mean(self) -> float:
        """Mean of the normalised squares per number, 1 where all is as told; NaN of none."""
        return self.square / self.size if self.size else math.nan

    def count(self, stamp_ns: int, one: Innovation) -> None:
        """Count an innovation."""
        if one.is_accepted:
            self.accepted += 1
            self.square += one.normalised_square
            self.size += one.value.size
            self.recent.append((one.normalised_square, one.value.size))
            return
        self.refused += 1
        if self.refused_from is None:
            self.refused_from = stamp_ns
        self.refused_to = stamp_ns


def count_innovations(
    consistency: dict[str, Consistency], stamp_ns: int, innovations: Sequence[Innovation]
) -> None:
    """Count ``innovations`` of one stamp [ns] in the ``consistency`` of their kinds."""
    for one in innovations:
        consistency.setdefault(one.name, Consistency()).count(stamp_ns, one)


class Tracker:
    """Follows one arm.

    Attributes:
        consistency: of each kind of measurement, by its name.
        late: how many measurements came too late.
        failed: at how many times the arm had no trustworthy shape.
        origin_ns: stamp that times count from [ns]; None before the first.
    """

    def __init__(
        self,
        models: Mapping[str, ArmModel],
        gate: float = GATE,
        window: float = 0.0,
        change_time: float = math.inf,
    ) -> None:
        """Of one or several ``models`` by name; see `Filter` and `Hypotheses` for the others.

        Several models take no late measurements, whatever the ``window``.

        Raises:
            MeasurementError: if a number is outside its range, or there is no model.
        """
        self._filter: Filter | None = None
        self._hypotheses: Hypotheses | None = None
        if len(models) == 1:
            (self._name,) = models
            self._filter = Filter(models[self._name], window, gate)
        else:
            self._hypotheses = Hypotheses(models, change_time, gate)
        self.consistency: dict[str, Consistency] = {}
        self.late = self.failed = 0
        self.origin_ns: int | None = None
        self._newest = -math.inf

    @classmethod
    def from_settings(
        cls, settings: EstimatorSettings, models: Mapping[str, ArmModel], window: float
    ) -> Tracker:
        """Of ``models`` of ``settings``, for measurements up to ``window`` [s] late."""
        return cls(models, settings.gate, window, settings.change_time)

    def add(self, stamp_ns: int, measurements: Sequence[Measurement]) -> Tracked:
        """Take ``measurements`` made at ``stamp_ns`` [ns].

        Where it fails nothing changes but the counts.

        Raises:
            MeasurementError: if they come too late, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape, or the estimate does not converge.
        """
        origin = stamp_ns if self.origin_ns is None else self.origin_ns
        time = 1e-9 * (stamp_ns - origin)
        try:
            tracked = self._add(time, measurements)
        except SolveError:
            self.failed += 1
            raise
        self.origin_ns, self._newest = origin, max(time, self._newest)
        count_innovations(self.consistency, stamp_ns, tracked.innovations)
        return tracked

    def _add(self, time: float, measurements: Sequence[Measurement]) -> Tracked:
        if self._filter is not None:
            try:
                estimate = self._filter.add(time, measurements)
            finally:
                self.late = self._filter.late
            one = self._filter.innovations
            return Tracked(estimate, self._name, {self._name: 1.0}, one)
        assert self._hypotheses is not None
        if time < self._newest:
            self.late += 1
            raise MeasurementError(
                f'measured {self._newest - time:.6g} s before the last, expected in order where '
                'the place of contact is unknown'
            )
        ranked = self._hypotheses.add(time, measurements)
        probabilities = {one.name: one.probability for one in ranked}
        best = next(one for one in ranked if one.estimate is not None)
        assert best.estimate is not None
        return Tracked(best.estimate, best.name, probabilities, best.estimate.innovations)
