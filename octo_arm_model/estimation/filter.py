"""The recursive estimator: one update for each time that something was measured."""

from __future__ import annotations

from collections.abc import Sequence

from octo_arm_model.estimation.estimate import Estimate, estimate_of
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import Innovation, Rules
from octo_arm_model.estimation.step import Step, next_step
from octo_arm_model.estimation.window import Window


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
