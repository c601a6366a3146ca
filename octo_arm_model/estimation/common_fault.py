"""What may be so where sensors lie together.

A load cell and a camera that are wrong by what goes together cannot be told from an arm that
moved, by nothing that is measured. So where the motion of the tip changes more than it has
lately, and that of a tension does too or a sensor begins not to be used, the covariance holds for
some seconds where the arm was, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gaussian import Gaussian
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.estimation.rules import Doubts

_SUDDEN = 4.0  # times the usual difference of two changes, of tensions and of the tip that jump
_STILL = 1e-3  # of the length, by which the tip may always move
_LATELY, _FEWEST = 20, 2  # steps over which that is averaged, and from which on it is known
_WEIGHT = 0.1  # probability of a sensor to lie where a load cell does
_LASTING, _LEAST = 5.0, 0.02  # [s] in which it falls by e, and where it is forgotten


class CommonFault(NamedTuple):
    """A fault that several sensors may have in common.

    Attributes:
        before: what was known before they jumped, without all since; None where they did not.
        weight: its probability.
        moved: change of all tensions [N] and the tip's position [m] in the last step; None before
            the second.
        usual: mean squares of what these changes differ by from those before [N^2, m^2].
        steps: how many.
        unused: sensors that were not used in the last step.
    """

    before: Gaussian | None = None
    weight: float = 0.0
    moved: FloatArray | None = None
    usual: FloatArray = np.zeros(1)
    steps: int = 0
    unused: Doubts = frozenset()

    def after(
        self,
        elapsed: float,
        expected: Gaussian,
        at: Prediction,
        change: FloatArray,
        heard: Doubts,
        unused: Doubts,
    ) -> CommonFault:
        """The same ``elapsed`` [s] later, with a ``change`` from what was ``expected``.

        That of the state, ``at`` a prediction of it; sensors other than load cells were ``heard``,
        and some sensors ``unused``.
        """
        state, weight, before = at.model.state, math.exp(-elapsed / _LASTING) * self.weight, None
        if self.before is not None and weight >= _LEAST:
            before = state.later(self.before, elapsed)
        moved = np.concatenate([change[state.tension], at.change.tip[:3] @ change])
        found = self._replace(before=before, weight=weight, moved=moved, unused=unused)
        if self.moved is None:
            return found
        sudden = moved - self.moved
        squares = np.append(sudden[:-3] ** 2, sudden[-3:] @ sudden[-3:])
        steps = min(self.steps + 1, _LATELY)
        usual = self.usual + (squares - self.usual) / steps
        found = found._replace(usual=usual, steps=steps)
        is_sudden = squares > _SUDDEN**2 * self.usual
        is_sudden[-1] &= squares[-1] > (_STILL * at.model.arm.length) ** 2
        is_jump = is_sudden[-1] and (is_sudden[:-1].any() or unused - self.unused)
        if before is not None or steps <= _FEWEST or not heard or not is_jump:
            return found
        return found._replace(before=expected, weight=_WEIGHT ** max(1, len(heard - unused)))

    def held(self, known: Gaussian) -> Gaussian:
        """What is ``known``, with a covariance that holds what was before."""
        if self.before is None:
            return known
        away = self.before.mean - known.mean
        each = [(1.0 - self.weight, known.root), (self.weight, self.before.root)]
        covariance = sum(weight * root @ root.T for weight, root in each)
        return Gaussian.of(known.mean, covariance + self.weight * np.outer(away, away))
