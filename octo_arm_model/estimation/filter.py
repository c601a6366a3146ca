"""The recursive estimator: one update for each time that something was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.estimation.beliefs.belief import Belief
from octo_arm_model.estimation.estimate import Estimate, estimate_of
from octo_arm_model.estimation.gating.update import update
from octo_arm_model.estimation.gating.updated import Innovation, Updated
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.window import Window

GATE = 0.9999


def prior(model: ArmModel) -> Belief:
    """What is known of ``model`` before anything is measured."""
    stddev = model.state.prior_stddev()
    scatter = np.diag(model.state.scatters * stddev**2)
    return Belief(np.zeros(stddev.size), np.diag(stddev), scatter)


def predict(model: ArmModel, belief: Belief, elapsed: float) -> Belief:
    """``belief`` after ``elapsed`` [s]."""
    state = model.state
    return belief.after(state.decay(elapsed), state.growth(elapsed), state.scatters)


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

    def estimate(self, first: float) -> Estimate:
        """What is known then; the ``first`` step of all was at that time [s]."""
        return estimate_of(self.time, self.time - first, self.updated)


def next_step(
    model: ArmModel,
    last: Step | None,
    time: float,
    measurements: tuple[Measurement, ...],
    gate: float,
    near: Step | None = None,
) -> Step:
    """From the ``last`` one, or from nothing but the prior, to ``time`` [s]; see `update`.

    The state is looked for from that of the last one; where there is none, of a step ``near``.
    """
    if last is None:
        belief, refused = prior(model), frozenset[str]()
    else:
        belief = predict(model, last.updated.belief, time - last.time)
        refused = last.updated.refused
    start = last or near
    found = None if start is None else start.updated._replace(refused=refused)
    return Step(time, measurements, update(model, belief, measurements, found, gate))


class Filter:
    """Iterated extended Kalman filter of one arm.

    Measurements may come late, by at most the window: what followed is then done again.

    Attributes:
        model: the arm.
        refused: how many measurements the gate refused, by name.
        innovations: of the last that were added.
    """

    def __init__(self, model: ArmModel, window: float = 0.0, gate: float = GATE) -> None:
        """Of ``model``, for measurements up to ``window`` [s] late.

        A right measurement is accepted with the probability ``gate``.

        Raises:
            MeasurementError: if a number is outside its range.
        """
        check_gate(gate)
        self.model = model
        self.refused: dict[str, int] = {}
        self.innovations: tuple[Innovation, ...] = ()
        self._window: Window[Step] = Window(
            lambda last, time, made, near: next_step(model, last, time, made, gate, near), window
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
            SolveError: if the arm has no trustworthy shape, or the estimate does not converge.
        """
        step, before, newest = self._window.add(time, measurements)
        self.innovations = step.updated.innovations_after(
            *((), None) if before is None else (before.measurements, before.updated)
        )
        for one in self.innovations:
            if not one.is_accepted:
                self.refused[one.name] = self.refused.get(one.name, 0) + 1
        return newest.estimate(self._window.first)


def check_gate(gate: float) -> None:
    """Check the probability of a right measurement to be accepted.

    Raises:
        MeasurementError: if it is none.
    """
    if not 0.0 < gate < 1.0:
        raise MeasurementError(f'gate is {gate}, expected a probability in (0, 1)')
