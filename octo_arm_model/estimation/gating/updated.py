"""What measurements of one time brought: their innovations, and the belief after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief
from octo_arm_model.estimation.beliefs.curvature import Curvature
from octo_arm_model.estimation.gating.taken import Kinds
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.rod.backbone import Backbone


class Innovation(NamedTuple):
    """What one measurement brought.

    Attributes:
        name: of the measurement.
        value: measured less predicted before it, linearised about the estimate, (m,).
        covariance: expected of that, likewise, (m, m).
        normalised_square: of the value by the covariance, which is the least sum of squares of
            noise and change of the state that explain it. Chi-square of m where all is as told.
            Of one that the others contradict, of what it is off from these. Of one that is refused
            it may be smaller, and linearised about the state before.
        is_accepted: whether it is within the gate.
    """

    name: str
    value: FloatArray
    covariance: FloatArray
    normalised_square: float
    is_accepted: bool

    def is_whole(self, measurement: Measurement) -> bool:
        """Whether every number of the ``measurement`` that it is of is used."""
        return self.is_accepted and self.value.size == measurement.value.size


class Updated(NamedTuple):
    """A belief after measurements.

    Attributes:
        belief: after them.
        at: the prediction of its mean, or nearly, about which it was linearised; see `Fit`.
        shape: that of this prediction, of the arm as described.
        innovations: of every measurement, in their order; of a load cell that is refused by itself
            after these, and no number among its kind.
        accepted: the measurements that were used.
        normalised_square: of all that were accepted together, and of how many numbers.
        log_likelihood: of all measurements; of a refused one as if it were at the gate.
        curvatures: of what is measured together, by `Measurement.kind` of each.
        refused: names of measurements of which the newest was refused.
    """

    belief: Belief
    at: Prediction
    shape: Backbone
    innovations: tuple[Innovation, ...]
    accepted: tuple[Measurement, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float
    curvatures: Mapping[Kinds, Curvature]
    refused: frozenset[str]

    def innovations_after(
        self, measured: Sequence[Measurement], before: Updated | None
    ) -> tuple[Innovation, ...]:
        """Of what is new after what was ``measured``, which was this ``before`` if it had a shape.

        What was accepted then and is refused now is new too.
        """
        earlier = () if before is None else before.innovations
        known = {one.name for one in measured} | {one.name for one in earlier}
        accepted = {one.name for one in earlier if one.is_accepted}
        return tuple(
            one
            for one in self.innovations
            if one.name not in known or (one.name in accepted and not one.is_accepted)
        )
