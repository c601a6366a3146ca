"""The recursive estimator: one update for each time that something was measured."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.core.errors import MeasurementError
from octo_arm_model.estimation.belief import Belief
from octo_arm_model.estimation.estimate import Estimate, estimate_of
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.prediction import ArmModel
from octo_arm_model.estimation.update import Innovation, Updated, update

GATE = 0.9999
MAX_STEPS = 1000  # that a window holds


def prior(model: ArmModel) -> Belief:
    """What is known of ``model`` before anything is measured."""
    stddev = model.state.prior_stddev()
    return Belief(np.zeros(stddev.size), np.diag(stddev))


def predict(model: ArmModel, belief: Belief, elapsed: float) -> Belief:
    """``belief`` after ``elapsed`` [s]."""
    return belief.after(model.state.decay(elapsed), model.state.growth(elapsed))


@dataclass(frozen=True)
class Step:
    """One time, what was measured then and what came of it.

    Attributes:
        time: [s].
        measurements: made then.
        updated: belief and shape after.
    """

    time: float
    measurements: tuple[Measurement, ...]
    updated: Updated


def next_step(
    model: ArmModel,
    last: Step | None,
    time: float,
    measurements: tuple[Measurement, ...],
    gate: float,
) -> Step:
    """From the ``last`` one, or from nothing but the prior, to ``time`` [s]; see `update`."""
    if last is None:
        belief, updated = prior(model), None
    else:
        belief, updated = predict(model, last.updated.belief, time - last.time), last.updated
    return Step(time, measurements, update(model, belief, measurements, updated, gate))


class Filter:
    """Iterated extended Kalman filter of one arm.

    Measurements may come late, by at most the window: what followed is then done again.

    Attributes:
        model: the arm.
        refused: how many measurements the gate refused, by name.
        late: how many came later than the window.
        innovations: of the last that were added.
    """

    def __init__(self, model: ArmModel, window: float = 0.0, gate: float = GATE) -> None:
        """Of ``model``, for measurements up to ``window`` [s] late.

        A right measurement is accepted with the probability ``gate``.

        Raises:
            MeasurementError: if a number is outside its range.
        """
        if not 0.0 <= window < np.inf:
            raise MeasurementError(f'window is {window!r}, expected a finite number >= 0 [s]')
        if not 0.0 < gate < 1.0:
            raise MeasurementError(f'gate is {gate!r}, expected a probability in (0, 1)')
        self.model, self._window, self._gate = model, window, gate
        self.refused: dict[str, int] = {}
        self.late = 0
        self.innovations: tuple[Innovation, ...] = ()
        self._first: float | None = None
        self._steps: list[Step] = []

    @property
    def last(self) -> Step | None:
        """The newest step."""
        return self._steps[-1] if self._steps else None

    def add(self, time: float, measurements: Sequence[Measurement]) -> Estimate:
        """Take ``measurements`` made at ``time`` [s]; returns the newest estimate.

        Where it fails the filter is as it was.

        Raises:
            MeasurementError: if they come later than the window, or do not fit the arm.
            SolveError: if the arm has no trustworthy shape, or the estimate does not converge.
        """
        if not np.isfinite(time):
            raise MeasurementError(f'time is {time!r}, expected a finite number [s]')
        steps, taken = self._steps, tuple(measurements)
        index = bisect.bisect_right([step.time for step in steps], time)
        if steps and not index and self._first is not None:
            self.late += 1
            raise MeasurementError(
                f'measured at {time:.6g} s, before the window, which begins at '
                f'{steps[0].time:.6g} s'
            )
        first = time if self._first is None else self._first
        new = steps[:index]
        for at, made in [(time, taken), *((s.time, s.measurements) for s in steps[index:])]:
            new.append(next_step(self.model, new[-1] if new else None, at, made, self._gate))
        self._count(new[index].updated)
        newest = new[-1]
        since = bisect.bisect_left([step.time for step in new], newest.time - self._window)
        # The step before the window is what a late measurement begins from.
        self._steps = new[max(0, since - 1, len(new) - MAX_STEPS) :]
        self._first = first
        return self._estimate(newest)

    def _count(self, updated: Updated) -> None:
        self.innovations = updated.innovations
        for one in updated.innovations:
            if not one.is_accepted:
                self.refused[one.name] = self.refused.get(one.name, 0) + 1

    def _estimate(self, step: Step) -> Estimate:
        assert self._first is not None
        updated = step.updated
        prior_stddev = self.model.state.prior_stddev(step.time - self._first)
        return estimate_of(step.time, prior_stddev, updated)
