"""A posterior where what measurements predict is known to second order, and its mean by that."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import (
    Belief,
    Gain,
    gain,
    log_determinant,
    normalised_square,
    solve_lower,
)
from octo_arm_model.estimation.posterior_mean import shift_to_mean
from octo_arm_model.estimation.prediction import ArmModel

_MOST_OF_MODEL = 20  # steps within a local model
_LAST = 0.3  # step within it that is the last
_SHORTEST = 0.02  # part of such a step
_BENT = 0.8  # part of its stiffness that a direction may lose as measurements bend


class Local(NamedTuple):
    """What measurements predict about one state, to second order.

    Attributes:
        x: the state.
        left: measured less predicted there, (m,).
        jacobian: of what is predicted, (m, n).
        second: its second derivatives, (m, n, n).
    """

    x: FloatArray
    left: FloatArray
    jacobian: FloatArray
    second: FloatArray

    def about(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured less predicted in ``x``, and the Jacobian there."""
        change = x - self.x
        bent = self.second @ change
        return self.left - (self.jacobian + 0.5 * bent) @ change, self.jacobian + bent


class Step(NamedTuple):
    """A step of the iteration from ``start`` to ``x``, and what it follows from; see `Fit`.

    Attributes:
        size: in standard deviations a component.
        cost: what is least at the end, in squares of standard deviations.
    """

    start: FloatArray
    x: FloatArray
    size: float
    by: Gain
    innovation: FloatArray
    square: float
    cost: float


class Posterior:
    """What is known of a state after measurements."""

    def __init__(self, prior: Belief, noise: FloatArray, model: ArmModel, weight: float) -> None:
        """Of a ``prior`` and measurements of the root ``noise`` of their covariance.

        ``weight`` is that of the shift to the mean; 0 leads to the most probable state.
        """
        self._prior, self._noise, self._model, self._weight = prior, noise, model, weight

    def square(self, x: FloatArray, left: FloatArray) -> float:
        """Sum of squares of the change of the state and of the noise, in standard deviations."""
        change = normalised_square(x - self._prior.mean, self._prior.root)
        return change + normalised_square(left, self._noise)

    def mean(self, local: Local, step: Step) -> FloatArray:
        """The mean by a ``local`` model, from a ``step`` on."""
        for _ in range(_MOST_OF_MODEL):
            if step.size <= _LAST:
                break
            part, wanted = 1.0, step
            while True:
                step = self.step(local, wanted.start + part * (wanted.x - wanted.start))
                if step.cost <= wanted.cost or part < _SHORTEST:
                    break
                part *= 0.5
        return step.x

    def step(self, local: Local, x: FloatArray) -> Step:
        """Newton's step from ``x`` to the mean by a ``local`` model."""
        prior, noise = self._prior, self._noise
        left, jacobian = local.about(x)
        by = gain(prior.root, jacobian, noise)
        innovation = left + jacobian @ (x - prior.mean)
        white = solve_lower(by.innovation_root, innovation)
        square = float(white @ white)
        wanted = prior.mean + by.gain @ innovation
        wanted += self._weight * shift_to_mean(by, local.second)
        # That was the step of Gauss and Newton, who leave out how measurements bend.
        multiplier = solve_lower(by.innovation_root, white, is_transposed=True)
        count = x.size
        bent = (multiplier @ local.second.reshape(-1, count * count)).reshape(count, count)
        change = _stiffened(by.root.T @ bent @ by.root, solve_lower(by.root, wanted - x))
        wanted = x + by.root @ change
        new = nearest_possible(self._model, Belief(x, by.root), wanted)
        if new is not wanted:
            change = solve_lower(by.root, new - x)
            square += normalised_square(new - wanted, by.root)
        size = math.sqrt(float(change @ change) / count)
        cost = self.square(x, left) + self._weight * log_determinant(by.innovation_root)
        return Step(x, new, size, by, innovation, square, cost)


def _stiffened(bent: FloatArray, change: FloatArray) -> FloatArray:
    """A ``change`` (n,) divided by 1 - ``bent`` (n, n), of which no part is above `_BENT`."""
    stiffness = np.eye(change.size) - bent
    is_stiff = dpotrf(stiffness - (1.0 - _BENT) * np.eye(change.size), lower=1)[1] == 0
    if is_stiff:
        # By Cholesky: eigenvalues take longer, and much longer where threads of LAPACK wait.
        root = np.ascontiguousarray(dpotrf(stiffness, lower=1)[0])
        return solve_lower(root, solve_lower(root, change), is_transposed=True)
    parts, axes = np.linalg.eigh(bent)
    return np.asarray(axes @ ((axes.T @ change) / (1.0 - np.minimum(parts, _BENT))))


def nearest_possible(model: ArmModel, belief: Belief, mean: FloatArray) -> FloatArray:
    """The likeliest state about ``mean``, by the covariance of ``belief``, of tensions >= 0."""
    tension = model.state.tension
    slack = np.zeros(mean.size, dtype=bool)
    found = mean
    while (found[tension] < 0.0).any():
        slack[tension] |= found[tension] < 0.0
        rows = belief.root[slack]
        change = np.linalg.lstsq(rows, -mean[slack], rcond=None)[0]
        found = mean + belief.root @ change
        found[slack] = 0.0
    return found
