"""From the most probable state to the mean of the posterior, to first order in the curvature.

Measurements much more exact than the belief leave a thin curved sheet of likely states. It is
thin where the measurements depend strongly on the state, so that its densest point is off to that
side of its mean: to the same side at every step. A filter that remembers would sum that up. The
distance follows from the determinant of the covariance of the innovation, S = J P J' + R, which
the mode leaves out (Laplace's approximation; Tierney and Kadane 1986): -P+ grad(ln det S) / 2,
which is -P+ tr(P J' S^-1 dJ).

That is so where the state is random about the mean of the prior. Where the mean of the prior is
random about the state, as errors of sensors make it, the mode is right on average: to first order
its error does not depend on its residuals. Where the state scatters about a known mean with a
covariance A and estimates scatter about the state with the rest, P - A, the distance on average is
-P+ tr(A J' S^-1 dJ), but for a term along the gain that is smaller than the noise. What comes of
random walks is counted with the rest: their rates are bounds that tendons seldom make use of.

The innovation w draws the mode by w' S^-1 (dS / 2) S^-1 w, whose expected value is that gradient.
Where what happens is less than its prior allows, as of an arm that nothing touches, innovations
are smaller at every step and the mode is hardly drawn: the shift would sum up to the other side.
How they compare is their agreement, and the shift is weighted with the mean of it: no less than
chance may have taken off that mean, since a weight that is often too small sums up too, and where
innovations tell little of it prior and noise are believed. The first update leads to the mode.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Gain, solve_lower

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


def gain_of_part(part: FloatArray, jacobian: FloatArray, by: Gain) -> FloatArray:
    """The gain A J' S^-1 (n, m) of the ``part`` A (n, n) of a covariance alone.

    ``by`` is what linear measurements of ``jacobian`` (m, n) make of all of it.
    """
    white = solve_lower(by.innovation_root, jacobian @ part)
    return solve_lower(by.innovation_root, white, is_transposed=True).T


def share_of(part: FloatArray, whole: FloatArray, by: Gain) -> float:
    """What the gradient of a ``part`` is of that of the ``whole``, along the shift of this."""
    along, all_along = by.root.T @ part, by.root.T @ whole
    square = float(all_along @ all_along)
    return min(max(0.0, float(along @ all_along) / square), 1.0) if square else 0.0


def gradient(gain: FloatArray, second: FloatArray) -> FloatArray:
    """Gradient of ln(det S) / 2 by the state, (n,): tr(P+ J' R^-1 dJ).

    ``gain`` (n, m) is that of linearised measurements, ``second`` (m, n, n) their second
    derivatives.
    """
    return np.asarray(gain.T.ravel() @ second.reshape(gain.size, -1))


def agreement(
    by: Gain, slope: FloatArray, innovation: FloatArray, second: FloatArray
) -> Agreement:
    """That of one ``innovation`` (m,), by how it draws the mode along the shift of a ``slope``."""
    root = by.innovation_root
    shift = by.root.T @ slope
    expected = float(shift @ by.root.T @ gradient(by.gain, second))
    # What it draws is a quadratic form of the innovation, whitened: of variance 2 |form|^2.
    form = solve_lower(root, (second @ (by.root @ shift)) @ by.gain @ root)
    form = 0.5 * (form + form.T)
    stddev = math.sqrt(2.0) * float(np.linalg.norm(form))
    white = solve_lower(root, innovation)
    return agreement_by(float(white @ form @ white), expected, stddev)


def agreement_by(drawn: float, expected: float, stddev: float) -> Agreement:
    """That of an innovation which has ``drawn`` the mode by so much of what was ``expected``."""
    if not expected > 0.0 or not stddev:
        return Agreement()
    off = min(max((drawn - expected) / stddev, -_LARGEST), _LARGEST)
    return Agreement(1.0 + off * stddev / expected, (expected / stddev) ** 2)
