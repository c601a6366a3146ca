"""Faults that several sensors have in common.

No measurement distinguishes an arm that moved from a load cell and a camera with consistent
errors. So the state before a jump stays part of the covariance for some seconds. A jump is a
sudden change of the tip's motion, together with that of a tension or with a sensor newly unused.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gaussian import Gaussian
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.estimation.rules import Doubts

_SUDDEN = 4.0  # ratio of the difference of two changes to the usual one, from which it is a jump
_STILL = 1e-3  # fraction of the length by which the tip may always move
_LATELY, _FEWEST = 20, 2  # steps to average the usual difference over, and steps to know it
_WEIGHT = 0.1  # probability that a sensor is wrong if a load cell is
_LASTING, _LEAST = 5.0, 0.02  # [s] in which the probability falls by e; its least value


class CommonFault(NamedTuple):
    """The possibility of a fault that several sensors have in common."""

    #: the state before the jump, without measurements since then; None without a jump
    earlier: Gaussian | None = None
    weight: float = 0.0  #: probability of the fault
    #: change of all tensions [N] and of the tip's position [m] in the last step; None before the
    #: second step
    changes: FloatArray | None = None
    #: mean squares of the differences of these changes from the previous ones [N^2, m^2]
    usual: FloatArray = np.zeros(1)
    steps: int = 0  #: number of averaged steps
    unused: Doubts = frozenset()  #: sensors that were not used in the last step

    def after(
        self,
        elapsed: float,
        expected: Gaussian,
        prediction: Prediction,
        change: FloatArray,
        heard: Doubts,
        unused: Doubts,
    ) -> CommonFault:
        """Return the possibility ``elapsed`` [s] later, after a ``change`` (n,) of the state.

        The change is from the mean of the ``expected`` distribution, near the ``prediction``. The
        sensors ``heard`` are those other than load cells; those ``unused`` are of any kind.
        """
        state, earlier = prediction.model.state, None
        weight = math.exp(-elapsed / _LASTING) * self.weight
        if self.earlier is not None and weight >= _LEAST:
            earlier = state.later(self.earlier, elapsed)
        changes = np.concatenate([change[state.tension], prediction.change.tip[:3] @ change])
        fault = self._replace(earlier=earlier, weight=weight, changes=changes, unused=unused)
        if self.changes is None:
            return fault
        difference = changes - self.changes
        squares = np.append(difference[:-3] ** 2, difference[-3:] @ difference[-3:])
        steps = min(self.steps + 1, _LATELY)
        usual = self.usual + (squares - self.usual) / steps
        fault = fault._replace(usual=usual, steps=steps)
        is_sudden = squares > _SUDDEN**2 * self.usual
        is_sudden[-1] &= squares[-1] > (_STILL * prediction.model.arm.length) ** 2
        is_jump = is_sudden[-1] and (is_sudden[:-1].any() or unused - self.unused)
        if earlier is not None or steps <= _FEWEST or not heard or not is_jump:
            return fault
        return fault._replace(earlier=expected, weight=_WEIGHT ** max(1, len(heard - unused)))

    def mixture(self, known: Gaussian) -> Gaussian:
        """Return the ``known`` state, with a covariance that contains the state before."""
        if self.earlier is None:
            return known
        weight = np.array([1.0 - self.weight, self.weight])
        mean = np.stack([known.mean, self.earlier.mean])
        root = np.stack([known.root, self.earlier.root])
        return Gaussian.mixture(known.mean, weight, mean, root @ root.swapaxes(1, 2))
