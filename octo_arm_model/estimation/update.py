"""What measurements of one time make of a belief: the step of the filter and of the smoother.

Linear measurements are exact and cost no shape, so they come first; the others by Gauss-Newton
iteration from there (iterated extended Kalman filter, Bell and Cathey 1993) to the most probable
state, and on to the mean, which `posterior_mean` tells apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.errors import ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.estimation.belief import (
    Belief,
    chi_square_limit,
    gain,
    normalised_square,
)
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
)
from octo_arm_model.estimation.posterior_mean import shift_to_mean
from octo_arm_model.estimation.prediction import ArmModel, Prediction

# Where the next step is shorter than this part of a standard deviation there is none.
TOLERANCE = 3e-2
_MOST = 50  # steps
_SHORTEST = 1e-4  # part of a step
_CORRECTIONS = 2  # of a step that leaves the curve on which the measurements are met
_SLACK = 1e-3  # of a cost that is in squares of standard deviations, for rounding


class Innovation(NamedTuple):
    """What one measurement brought.

    Attributes:
        name: of the measurement.
        value: measured less predicted before it, (m,).
        covariance: expected of that, to first order, (m, m).
        normalised_square: of the value by the covariance; where the first order would refuse it,
            the least sum of squares of noise and change of the state that explains it, which is
            the same of a linear measurement. Chi-square of m where all is as told.
        is_accepted: whether it is within the gate.
    """

    name: str
    value: FloatArray
    covariance: FloatArray
    normalised_square: float
    is_accepted: bool


class Updated(NamedTuple):
    """A belief after measurements.

    Attributes:
        belief: after them.
        at: the prediction of its mean, about which it was linearised.
        shape: in its mean, of the arm as described.
        innovations: of every measurement, in their order.
        accepted: the measurements that were used.
        normalised_square: of all that were accepted together, and of how many numbers.
        log_likelihood: of all measurements; of a refused one as if it were at the gate.
    """

    belief: Belief
    at: Prediction
    shape: Backbone
    innovations: tuple[Innovation, ...]
    accepted: tuple[Measurement, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float


def update(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    start: Backbone | None,
    gate: float,
) -> Updated:
    """``belief`` after ``measurements``, shapes being followed from ``start``.

    ``gate`` is the probability of a right measurement to be accepted.

    Raises:
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
        MeasurementError: if a measurement does not fit the arm.
    """
    found: dict[int, Innovation] = {}
    square, size, log_likelihood = 0.0, 0, 0.0
    for is_linear in (True, False):
        at = Prediction(model, belief.mean, start)
        used = []
        for one in measurements:
            if one.is_linear == is_linear:
                found[id(one)] = innovation = _judged(one, at, belief, gate)
                if innovation.is_accepted:
                    used.append(one)
                else:
                    limit = chi_square_limit(gate, one.value.size)
                    root = np.asarray(np.linalg.cholesky(innovation.covariance), np.float64)
                    log_likelihood -= 0.5 * (limit + _volume(root))
        if used:
            before = belief
            belief, at, best = _most_probable(before, used, at)
            if not is_linear:
                belief, at = _about_mean(before, used, at)
            square, size = square + best.square, size + best.size
            log_likelihood -= 0.5 * (best.square + best.volume)
    innovations = tuple(found[id(one)] for one in measurements)
    accepted = tuple(one for one in measurements if found[id(one)].is_accepted)
    return Updated(belief, at, at.solved, innovations, accepted, (square, size), log_likelihood)


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


def _judged(one: Measurement, at: Prediction, belief: Belief, gate: float) -> Innovation:
    """The innovation of ``one`` measurement, judged by the ``gate``."""
    value = one.innovation(at)
    root = gain(belief.root, one.jacobian(at), one.noise_root).innovation_root
    square = normalised_square(value, root)
    limit = chi_square_limit(gate, value.size)
    if square > limit and not one.is_linear:
        try:
            square = _most_probable(belief, [one], at)[2].square
        except SolveError:
            square = np.inf
    return Innovation(one.name, value, root @ root.T, square, square <= limit)


def _about_mean(
    prior: Belief, measurements: Sequence[Measurement], at: Prediction
) -> tuple[Belief, Prediction]:
    """The posterior of a ``prior`` whose mode is ``at``: of its mean, linearised about that."""
    noise, left = noise_root(measurements), residuals(measurements, at)
    by = gain(prior.root, jacobians(measurements, at), noise)
    posterior = Belief(at.x, by.root)
    shift = shift_to_mean(prior, measurements, at, by)
    new = Prediction(at.model, nearest_possible(at.model, posterior, at.x + shift), at.shape)
    # Back to where the measurements are met as well as before.
    x = new.x + by.gain @ (residuals(measurements, new) - left)
    new = Prediction(at.model, nearest_possible(at.model, posterior, x), new.shape)
    return Belief(new.x, gain(prior.root, jacobians(measurements, new), noise).root), new


class _Fit(NamedTuple):
    """How well a most probable state explains measurements."""

    square: float
    size: int
    volume: float


def _volume(root: FloatArray) -> float:
    """Twice the logarithm of the normal density's denominator, for a covariance of ``root``."""
    return 2.0 * float(np.log(np.diag(root)).sum()) + len(root) * math.log(2.0 * math.pi)


def _most_probable(
    prior: Belief, measurements: Sequence[Measurement], at: Prediction
) -> tuple[Belief, Prediction, _Fit]:
    """The posterior of a ``prior``, from ``at`` on: of its mean, and linearised about that.

    Raises:
        SolveError: if there is no trustworthy shape on the way, or no convergence.
    """
    noise, size = noise_root(measurements), np.inf

    def cost(at: Prediction) -> float:
        """Sum of squares of the change of the state and of the noise, in standard deviations."""
        away = np.linalg.solve(prior.root, at.x - prior.mean)
        left = residuals(measurements, at)
        return float(away @ away) + normalised_square(left, noise)

    def moved(step: FloatArray, most: float) -> Prediction | None:
        """As much of a ``step`` from ``at`` as leads to a cost of at ``most`` that much.

        A step along the tangent leaves the curve on which exact measurements are met: the
        derivatives there lead back to it (second-order correction, Nocedal and Wright 18.3).
        """
        left = residuals(measurements, at)
        part = 1.0
        while part >= _SHORTEST:
            x = at.x + part * step
            wanted = left - part * (jacobian @ step)
            try:
                for _ in range(_CORRECTIONS + 1):
                    new = Prediction(at.model, x, at.shape)
                    if cost(new) <= most:
                        return new
                    x = x + by.gain @ (residuals(measurements, new) - wanted)
                    if (x[at.model.state.tension] < 0.0).any():
                        break
            except SolveError:
                pass
            part *= 0.5
        return None

    for _ in range(_MOST):
        jacobian = jacobians(measurements, at)
        by = gain(prior.root, jacobian, noise)
        posterior = Belief(at.x, by.root)
        left = residuals(measurements, at) + jacobian @ (at.x - prior.mean)
        wanted = prior.mean + by.gain @ left
        step = nearest_possible(at.model, posterior, wanted) - at.x
        size = float(np.linalg.norm(posterior.whitened(step))) / math.sqrt(step.size)
        if size <= TOLERANCE:
            fit = _Fit(cost(at), left.size, _volume(by.innovation_root))
            return posterior, at, fit
        new = moved(step, cost(at) + _SLACK)
        if new is None:
            break
        at = new
    raise ConvergenceError('the estimate', size, _MOST)
