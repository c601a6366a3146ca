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
chance may have taken off that mean, since a weight that is often too small sums up too, and where
innovations tell little of it prior and noise are believed. The first update leads to the mode.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import Gain, solve_lower

_LARGEST = 5.0  # standard deviations by which one agreement may be off
_LATELY = 1000  # updates over which agreements are averaged


class Agreement(NamedTuple):
    """How much innovations draw the mode along the shift, in parts of what is expected of them.

    Of one update or, weighted with their information, of many.

    Attributes:
        value: 1 on average where prior and noise are as told.
        information: inverse of its variance where they are; 0 of none.
    """

    value: float = 0.0
    information: float = 0.0

    @property
    def weight(self) -> float:
        """Weight of the shift from mode to mean, 0 to 1: the value and its standard deviation.

        Innovations larger than told do not add to it.
        """
        if not self.information:
            return 0.0
        return min(max(0.0, self.value + 1.0 / math.sqrt(self.information)), 1.0)

    def after(self, now: Agreement) -> Agreement:
        """The same with that of one more update."""
        information = self.information * (1.0 - 1.0 / _LATELY) + now.information
        if not information:
            return self
        change = now.information / information * (now.value - self.value)
        return Agreement(self.value + change, information)


def gradient(gain: FloatArray, second: FloatArray) -> FloatArray:
    """Gradient of ln(det S) / 2 by the state, (n,): tr(P+ J' R^-1 dJ).

    ``gain`` (n, m) is that of linearised measurements, ``second`` (m, n, n) their second
    derivatives.
    """
    return np.asarray(gain.T.ravel() @ second.reshape(gain.size, -1))


def agreement(by: Gain, innovation: FloatArray, second: FloatArray) -> Agreement:
    """That of one ``innovation`` (m,), by how it draws the mode along the shift."""
    root = by.innovation_root
    expected = by.root.T @ gradient(by.gain, second)
    square = float(expected @ expected)
    # What it draws is a quadratic form of the innovation, whitened: of variance 2 |form|^2.
    form = solve_lower(root, (second @ (by.root @ expected)) @ by.gain @ root)
    form = 0.5 * (form + form.T)
    stddev = math.sqrt(2.0) * float(np.linalg.norm(form))
    if not square or not stddev:
        return Agreement()
    white = solve_lower(root, innovation)
    off = (float(white @ form @ white) - square) / stddev
    off = min(max(off, -_LARGEST), _LARGEST)
    return Agreement(1.0 + off * stddev / square, (square / stddev) ** 2)
