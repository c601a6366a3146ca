"""The state that measurements and a belief before them agree on, by iteration.

What measurements predict is taken to second order about the last state that was evaluated. The
mean of the posterior by this local model costs no shape, and is where it is evaluated next
(iterated extended Kalman filter, Bell and Cathey 1993, with Newton's steps).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf

from octo_arm_model.core.errors import ContinuationError, ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import (
    Belief,
    Gain,
    gain,
    log_determinant,
    normalised_square,
    solve_lower,
)
from octo_arm_model.estimation.curvature import Curvature, renewed, stddev_of, turned
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
)
from octo_arm_model.estimation.posterior_mean import agreement, shift_to_mean
from octo_arm_model.estimation.prediction import ArmModel, Prediction

# Where the next step is shorter than this part of a standard deviation there is none.
TOLERANCE = 3e-2
_MOST = 12  # evaluations
_NEAR = 0.3  # step within which derivatives are still good enough
_PROGRESS = 0.5  # what an evaluation without derivatives must leave less than of the step
_GROWTH = 3.0  # likewise one with derivatives
_MOST_OF_MODEL = 20  # steps within a local model
_LAST = 0.3  # step within it that is the last
_SHORTEST = 0.02  # part of such a step
_WORSE, _HALVED = 2.0, 6  # growth of what should be least that shortens a step, and how often
_RISE = 1.0  # of what should be least, from the start to the end
_BENT = 0.8  # part of its stiffness that a direction may lose as measurements bend


class Fit(NamedTuple):
    """A belief after measurements.

    Attributes:
        belief: after them.
        at: the prediction of its mean, about which they were linearised.
        innovation: measured less predicted before, by that linearisation, (m,).
        innovation_root: of its covariance, (m, m).
        square: least sum of squares of noise and change of the state that explains them.
        curvature: of what they predict.
    """

    belief: Belief
    at: Prediction
    innovation: FloatArray
    innovation_root: FloatArray
    square: float
    curvature: Curvature


def fit(
    prior: Belief,
    measurements: Sequence[Measurement],
    last: Prediction,
    known: Curvature | None,
    *,
    to_mode: bool = False,
) -> Fit:
    """The mean of the posterior of ``prior``, from the ``last`` prediction on.

    Its most probable state if ``to_mode``, which even a posterior has that is far from normal.

    Raises:
        SolveError: if there is no trustworthy shape on the way, or no convergence.
    """
    at, shape, noise = last.linearised, last.shape, noise_root(measurements)
    stddev = stddev_of(prior)
    scale = np.where(at.model.state.shapes, stddev, np.inf)
    left, jacobian = residuals(measurements, at), jacobians(measurements, at)
    turns = known is not None and known.is_near(jacobian, stddev)
    if known is None or not turns:
        after = gain(prior.root, jacobian, noise).root
        known = known or Curvature(np.zeros((*jacobian.shape, at.x.size)), jacobian)
        known = known._replace(jacobian=jacobian)
        known = renewed(known, measurements, at, stddev_of(Belief(at.x, after)))
    known = known._replace(jacobian=jacobian)
    local, size, is_near = Local(at.x, left, jacobian, known.second), math.inf, False
    posterior = _Posterior(prior, noise, at.model, 0.0 if to_mode else known.weight)
    step = posterior.step(local, local.x)
    first = step.cost
    for _ in range(_MOST):
        wanted = posterior.mean(local, step)
        most = _WORSE * posterior.square(local.x, local.left) + wanted.size
        for halved in range(_HALVED):
            # Farther from the last state than its local model is good for it may get worse.
            x = local.x + 0.5**halved * (wanted - local.x)
            new = Prediction(at.model, x, shape, at if is_near else None)
            try:
                left = residuals(measurements, new)
            except ContinuationError:
                continue
            if posterior.square(x, left) <= most:
                break
        shape = new.solved
        if is_near:
            # The derivatives are known well enough: what is predicted is all that is new.
            moved = Local(x, left, local.about(x)[1], local.second)
            step = posterior.step(moved, x)
            if step.size <= TOLERANCE and step.cost <= first + _RISE:
                return _fit(step, new, known)
            if step.size <= _PROGRESS * size:
                local, size = moved, step.size
                continue
        before, at = at, new.differentiated()
        jacobian = jacobians(measurements, at)
        is_right = known.foretells(x - before.x, jacobian, stddev)
        known = known.after(x - before.x, jacobian, scale)
        if turns or not is_right:
            after = stddev_of(Belief(x, gain(prior.root, jacobian, noise).root))
            learn = turned if is_right else renewed
            known, turns = learn(known, measurements, at, after), False
        local = Local(x, left, jacobian, known.second)
        step = posterior.step(local, x)
        if step.size <= TOLERANCE and step.cost <= first + _RISE:
            return _fit(step, at, known)
        if step.size > _GROWTH * size:
            break
        size, is_near = step.size, step.size <= _NEAR
    raise ConvergenceError('the estimate', step.size, _MOST)


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


class _Step(NamedTuple):
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


def _fit(step: _Step, at: Prediction, known: Curvature) -> Fit:
    """The `Fit` ``at`` a state from which a ``step`` leads nowhere."""
    by = step.by
    known = known.agreeing(agreement(by, step.innovation, known.second))
    return Fit(Belief(at.x, by.root), at, step.innovation, by.innovation_root, step.square, known)


class _Posterior:
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

    def mean(self, local: Local, step: _Step) -> FloatArray:
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

    def step(self, local: Local, x: FloatArray) -> _Step:
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
        return _Step(x, new, size, by, innovation, square, cost)


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
