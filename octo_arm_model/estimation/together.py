"""Sensors that lie together: what was known before they moved the arm is held for a while.

A load cell and a camera that are wrong by what goes together cannot be told from an arm that
moved, by nothing that is measured. So where the tip moves on in another way than it has lately,
while a tension does too or a sensor begins to contradict it, the covariance holds for some seconds
where the arm was, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gaussian import Gaussian
from octo_arm_model.estimation.measurements import LOAD_CELL
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.rules import Innovation

_SUDDEN = 4.0  # times what changes differed by lately, of tensions and of the tip that jump
_LATELY, _FEWEST = 20, 2  # steps over which that is averaged, and from which on it is known
_WEIGHT = 0.1  # probability of a sensor to lie where a load cell does
_LASTING, _LEAST = 5.0, 0.02  # [s] in which it falls by e, and where it is forgotten


class Together(NamedTuple):
    """What may be so where sensors lie together.

    Attributes:
        before: what was known before they jumped, without all since; None where they did not.
        weight: its probability.
        expected: of what is known now, from the last step; None before the second.
        moved: change of all tensions [N] and the tip's position [m] in the last step; None before
            the second.
        usual: mean squares of how much more these and the tip changed than before [N^2, m^2].
        steps: how many.
    """

    before: Gaussian | None = None
    weight: float = 0.0
    expected: Gaussian | None = None
    moved: FloatArray | None = None
    usual: FloatArray = np.zeros(1)
    steps: int = 0

    def after(self, model: ArmModel, known: Gaussian, elapsed: float) -> Together:
        """The same ``elapsed`` [s] after a step at which a state was ``known``."""
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        weight, before = math.exp(-elapsed / _LASTING) * self.weight, None
        if self.before is not None and weight >= _LEAST:
            before = self.before.after(decay, growth)
        return self._replace(before=before, weight=weight, expected=known.after(decay, growth))

    def with_jump(
        self, known: Gaussian, at: Prediction, last: Sequence[Innovation],
        new: Sequence[Innovation],
    ) -> Together:  # fmt: skip
        """With what is ``known`` now, ``at`` a prediction of it, after ``new`` innovations.

        Of those before the ``last`` were.
        """
        assert self.expected is not None
        change, state = known.mean - self.expected.mean, at.model.state
        moved = np.concatenate([change[state.tension], at.change.tip[:3] @ change])
        if self.moved is None:
            return self._replace(moved=moved)
        sudden = moved - self.moved
        squares = np.append(sudden[:-3] ** 2, sudden[-3:] @ sudden[-3:])
        steps = min(self.steps + 1, _LATELY)
        usual = self.usual + (squares - self.usual) / steps
        found = self._replace(moved=moved, usual=usual, steps=steps)
        others = [one for one in new if not one.name.startswith(('tensions', LOAD_CELL))]
        if self.before is not None or steps <= _FEWEST or not others:
            return found
        refused = {one.name for one in new if not one.is_accepted}
        refused -= {one.name for one in last if not one.is_accepted}
        is_sudden = squares > _SUDDEN**2 * self.usual
        if not (is_sudden[-1] and (is_sudden[:-1].any() or refused)):
            return found
        agree = sum(one.is_accepted for one in others)
        return found._replace(before=self.expected, weight=_WEIGHT ** max(1, agree))

    def held(self, known: Gaussian) -> Gaussian:
        """What is ``known``, with a covariance that holds what was before."""
        if self.before is None:
            return known
        away = self.before.mean - known.mean
        each = [(1.0 - self.weight, known.root), (self.weight, self.before.root)]
        covariance = sum(weight * root @ root.T for weight, root in each)
        return Gaussian.of(known.mean, covariance + self.weight * np.outer(away, away))


NOTHING = Together()
