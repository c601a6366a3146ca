"""From the most probable state to the mean of the posterior, to first order in the curvature.

Measurements much more exact than the belief leave a thin curved sheet of likely states. It is
thin where the measurements depend strongly on the state, so that its densest point is off to that
side of its mean: to the same side at every step. A filter that remembers would sum that up. The
distance follows from the determinant of the covariance of the innovation, S = J P J' + R, which
the mode leaves out (Laplace's approximation; Tierney and Kadane 1986): -P+ grad(ln det S) / 2.

The innovation w draws the mode by w' S^-1 (dS / 2) S^-1 w, whose expected value is that gradient.
Where what happens is less than its prior allows, as of tendons that hold still, innovations are
smaller at every step and the mode is hardly drawn: the whole shift would sum up to the other side.
How they compare is their agreement, and the shift is weighted with the mean of it: no less than
chance may have taken off that mean, since a weight that is often too small sums up too. The first
update leads to the mode, as nothing is known of it then.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import Gain, solve_lower

_LARGEST = 5.0  # agreement of one update that counts
_LATELY = 1000  # updates over which agreements are averaged
_CHANCE = 1.0  # standard deviation of one, about, where all is as told


class Agreement(NamedTuple):
    """How much innovations drew the mode over many updates, in parts of what is expected.

    Attributes:
        mean: of `agreement`, 0 of none.
        updates: that it is the mean of, at most `_LATELY`.
    """

    mean: float = 0.0
    updates: int = 0

    @property
    def weight(self) -> float:
        """Weight of the shift from mode to mean, 0 to 1: the mean and its standard deviation.

        Innovations larger than told do not add to it.
        """
        if not self.updates:
            return 0.0
        return min(max(0.0, self.mean + _CHANCE / math.sqrt(self.updates)), 1.0)

    def after(self, now: float) -> Agreement:
        """The same with one of ``now``."""
        updates = min(self.updates + 1, _LATELY)
        return Agreement(self.mean + (now - self.mean) / updates, updates)


def shift_to_mean(by: Gain, second: FloatArray) -> FloatArray:
    """Mean of the posterior less its mode, (n,).

    ``by`` is what linearised measurements make of the prior, ``second`` (m, n, n) their second
    derivatives there.
    """
    return -by.root @ (by.root.T @ gradient(by.gain, second))


def gradient(gain: FloatArray, second: FloatArray) -> FloatArray:
    """Gradient of ln(det S) / 2 by the state, (n,), at a ``gain`` (n, m): tr(P+ J' R^-1 dJ)."""
    return np.asarray(gain.T.ravel() @ second.reshape(gain.size, -1))


def agreement(by: Gain, innovation: FloatArray, second: FloatArray) -> float:
    """How much an ``innovation`` (m,) draws the mode, in parts of what is expected of it.

    Along the shift, within [-5, 5]; 1 on average where prior and noise are as told.
    """
    white = solve_lower(by.innovation_root, innovation)
    multiplier = solve_lower(by.innovation_root, white, is_transposed=True)
    drawn = np.tensordot(multiplier, second, axes=1) @ (by.gain @ innovation)
    expected = by.root.T @ gradient(by.gain, second)
    square = float(expected @ expected)
    if not square:
        return 1.0
    found = float(expected @ (by.root.T @ drawn)) / square
    return min(max(found, -_LARGEST), _LARGEST)
