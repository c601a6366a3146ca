"""Estimates from measurements with stamps as they come, and how well they agree with each other.

The one loop of the node and of the bag tool: a filter, or several where the place of a contact is
unknown, what they refused, their normalised innovations, and a new beginning where these show that
the arm is lost.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.filter import GATE, Step
from octo_arm_model.estimation.gating.consistency import Consistency, count_innovations
from octo_arm_model.estimation.gating.contradiction import Contradiction, Reading
from octo_arm_model.estimation.gating.updated import Innovation
from octo_arm_model.estimation.hypotheses import Hypotheses
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.state.prediction import ArmModel

ITERATIONS = 20_000  # of Newton's method, of each model in all trials of a new beginning


class Beginning(NamedTuple):
    """A new beginning from the prior alone.

    Attributes:
        since: time of the first measurement that it holds [s].
        left_out: names of measurements of which it holds none but those of its own time.
    """

    since: float
    left_out: frozenset[str]


class Tracked(NamedTuple):
    """What is known after a measurement.

    Attributes:
        estimate: by the most probable hypothesis.
        step: the newest one of its filter.
        hypothesis: its name.
        probabilities: of all of them.
        innovations: of the measurements that were added, also where they were late.
        beginning: where it is of the newest measurements and the prior alone; None where it goes
            on.
    """

    estimate: Estimate
    step: Step
    hypothesis: str
    probabilities: Mapping[str, float]
    innovations: tuple[Innovation, ...]
    beginning: Beginning | None = None

    @property
    def begins_anew(self) -> bool:
        """Whether what was known before was given up."""
        return self.beginning is not None


class Tracker:
    """Follows one arm.

    Where sensors contradict the estimate for long and agree with each other it begins anew from
    the prior, with the newest readings of each.

    Attributes:
        consistency: of each kind of measurement, by its name.
        late: how many measurements came too late.
        failed: at how many times the arm had no trustworthy shape.
        restarts: how often it began anew.
        origin_ns: stamp that times count from [ns]; None before the first.
    """

    def __init__(
        self,
        models: Mapping[str, ArmModel],
        gate: float = GATE,
        window: float = 0.0,
        change_time: float = math.inf,
        recover_after: float = 0.0,
    ) -> None:
        """Of one or several ``models`` by name; see `Hypotheses` for the others.

        It begins anew where a sensor is refused for ``recover_after`` [s]; never if that is 0.

        Raises:
            MeasurementError: if a number is outside its range, or there is no model.
        """
        if not 0.0 <= recover_after < math.inf:
            raise MeasurementError(
                f'recover_after is {recover_after}, expected a finite number >= 0 [s]'
            )
        self._models = models.values()
        self._begin = lambda: Hypotheses(models, change_time, gate, window)
        self._bank, self._late = self._begin(), 0
        self._contradiction = Contradiction(recover_after)
        self.consistency: dict[str, Consistency] = {}
        self.failed = self.restarts = 0
        self.origin_ns: int | None = None
        self._newest = -math.inf

    @classmethod
    def from_settings(
        cls, settings: EstimatorSettings, models: Mapping[str, ArmModel], window: float
    ) -> Tracker:
        """Of ``models`` of ``settings``, for measurements up to ``window`` [s] late."""
        return cls(models, settings.gate, window, settings.change_time, settings.recover_after)

    @property
    def late(self) -> int:
        """How many measurements came too late."""
        return self._late + self._bank.late

    def add(
        self,
        stamp_ns: int,
        measurements: Sequence[Measurement],
        pause: Callable[[], None] | None = None,
    ) -> Tracked:
        """Take ``measurements`` made at ``stamp_ns`` [ns].

        Where it fails nothing changes but the counts. ``pause`` is called before every solve.

        Raises:
            MeasurementError: if they come too late, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape, or the estimate does not converge.
        """
        with self._within(math.inf, pause):
            return self._add(stamp_ns, measurements)

    @contextlib.contextmanager
    def _within(
        self, iterations: float, pause: Callable[[], None] | None = None
    ) -> Iterator[None]:
        """Each model solves as `ArmModel.within`."""
        with contextlib.ExitStack() as stack:
            for model in self._models:
                stack.enter_context(model.within(iterations, pause))
            yield

    def _add(self, stamp_ns: int, measurements: Sequence[Measurement]) -> Tracked:
        """As `add`."""
        origin = stamp_ns if self.origin_ns is None else self.origin_ns
        time = 1e-9 * (stamp_ns - origin)
        try:
            tracked = _add(self._bank, time, measurements)
        except SolveError:
            self.failed += 1
            if self.origin_ns is None:
                raise
            self._contradiction.add([Reading(time, one, False) for one in measurements])
            found = self._found_anew(time)
            if found is None:
                raise
            tracked = found
        else:
            innovations = {one.name: one for one in tracked.innovations}
            self._contradiction.add(
                [
                    Reading(time, one, innovations[one.name].is_whole(one))
                    for one in measurements
                    if one.name in innovations
                ]
            )
            others = innovations.keys() - {one.name for one in measurements}
            self._contradiction.refuse(time, others)
            tracked = self._found_anew(time) or tracked
        self.origin_ns, self._newest = origin, max(time, self._newest)
        count_innovations(self.consistency, stamp_ns, tracked.innovations)
        return tracked

    def _found_anew(self, time: float) -> Tracked | None:
        """What the newest readings of all sensors tell without what was known before.

        None while nothing is refused for long, and where no more sensors agree than with what was
        known: then some of them are wrong. One sensor alone has to agree with itself: what is
        against it is only how fast the tensions and forces are told to change.
        """
        readings = self._contradiction.readings() if time >= self._newest else []
        if not readings:
            return None
        with self._within(ITERATIONS):
            trials = [_Trial(self._begin(), readings)]
            if refused := trials[0].refused:
                # Of sensors that contradict each other the first is believed: let the others be.
                others = [
                    one
                    for one in readings
                    if one.measurement.is_linear
                    or one.measurement.name in refused
                    or one.time == time
                ]
                trials.append(_Trial(self._begin(), others))
        best = max(trials, key=lambda one: one.agreement)
        believed = {one.measurement.name for one in readings if one.is_accepted}
        is_vain = best.tracked is None or best.agreement[0] <= len(believed)
        self._contradiction.begin(is_vain=is_vain)
        if best.tracked is None or is_vain:
            return None
        self._late, self._bank = self.late, best.bank
        self.restarts += 1
        heard = {one.measurement.name for one in best.readings if one.time < time}
        left_out = frozenset(one.measurement.name for one in readings) - heard
        return best.tracked._replace(beginning=Beginning(best.readings[0].time, left_out))


class _Trial:
    """A new beginning.

    Attributes:
        bank: what was begun.
        readings: what it holds, by time.
        tracked: what it knows after all readings; None where the arm had no trustworthy shape.
        refused: names of sensors that do not agree with all before them.
        agreement: how many sensors do, and how many numbers they measured.
    """

    def __init__(self, bank: Hypotheses, readings: Sequence[Reading]) -> None:
        self.bank, self.readings = bank, readings
        self.refused, self.agreement = set[str](), (0, 0)
        self.tracked: Tracked | None = None
        sizes: dict[str, int] = {}
        for time, group in itertools.groupby(readings, lambda one: one.time):
            measurements = [one.measurement for one in group]
            sizes |= {one.name: one.value.size for one in measurements}
            try:
                self.tracked = _add(bank, time, measurements)
            except SolveError:
                self.tracked = None
                return
            self.refused |= {
                measurement.name
                for measurement, one in zip(measurements, self.tracked.innovations, strict=False)
                if not one.is_whole(measurement)
            }
        agreed = [size for name, size in sizes.items() if name not in self.refused]
        self.agreement = len(agreed), sum(agreed)


def _add(bank: Hypotheses, time: float, measurements: Sequence[Measurement]) -> Tracked:
    """What the most probable hypothesis makes of ``measurements`` made at ``time`` [s].

    Raises:
        OctoArmError: as `Hypotheses.add`.
    """
    ranked = bank.add(time, measurements)
    best = next(one for one in ranked if one.estimate is not None)
    assert best.estimate is not None and best.step is not None
    probabilities = {one.name: one.probability for one in ranked}
    return Tracked(best.estimate, best.step, best.name, probabilities, best.innovations)
