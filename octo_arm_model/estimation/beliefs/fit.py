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

from octo_arm_model.arm.errors import ContinuationError, ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief, gain, normalised_square
from octo_arm_model.estimation.beliefs.compiled_posterior import posterior_of
from octo_arm_model.estimation.beliefs.curvature import (
    Curvature,
    renewed,
    renewed_along,
    stddev_of,
)
from octo_arm_model.estimation.beliefs.posterior_mean import Agreement
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
    seconds,
)
from octo_arm_model.estimation.state.prediction import Prediction

_TOLERANCE = 0.1  # standard deviations a component, of a step that is the last
# Likewise where it is straight by second derivatives that measurements themselves give: those
# that are learnt may be wrong.
_STRAIGHT = 3.0
_MOST = 12  # evaluations
_RENEWALS = 3  # of second derivatives: where no more foretell a step there is no end of it
# Part of what given second derivatives changed by since the last fit began, that they are taken to
# be ahead of themselves at first: a third makes what is predicted right to third order where the
# state goes on as it went, and it never quite does.
_AHEAD = 0.25
_GROWTH = 3.0  # of a step from one evaluation to the next, that ends the iteration
_WORSE, _SHORTENED = 2.0, 6  # growth of what should be least that shortens a step, and how often
_SAFE = 0.8  # of the part of a step up to which the arm could be followed
# By how much what should be least may be more at the end than at the start: by more where the
# posterior is flat along a curve, off which the mean by a local model lies.
_RISE = 1.0


class Fit(NamedTuple):
    """A belief after measurements.

    Attributes:
        belief: after them.
        at: a prediction nearly of its mean, about which they were linearised: a tenth of a
            standard deviation off at most, or as far as they bend little, `Bend.is_little`.
        innovation: measured less predicted before, by that linearisation, (m,).
        innovation_root: of its covariance, (m, m).
        square: least sum of squares of noise and change of the state that explains them.
        curvature: of what they predict, if that was asked for.
    """

    belief: Belief
    at: Prediction
    innovation: FloatArray
    innovation_root: FloatArray
    square: float
    curvature: Curvature | None


def fit(
    prior: Belief,
    measurements: Sequence[Measurement],
    last: Prediction,
    known: Curvature | None,
    *,
    is_new: bool = False,
) -> Fit:
    """The mean of the posterior of ``prior``, from the ``last`` prediction on.

    Second derivatives that measurements do not give are those ``known`` if they are of states
    nearby, and found anew if ``is_new``.

    Raises:
        SolveError: if there is no trustworthy shape on the way, or no convergence.
    """
    at, shape, noise = last, last.shape, noise_root(measurements)
    stddev = stddev_of(prior)
    scale = np.where(at.model.state.shapes, stddev, np.inf)
    left, jacobian = residuals(measurements, at), jacobians(measurements, at)
    given, is_given = seconds(measurements, at)
    agreed = Agreement() if known is None else known.agreed
    is_learnt = not (is_given and at.model.state.is_geometric)
    begun, ahead = given, 0.0 * given
    if not (is_learnt or is_new or known is None or known.begun is None):
        ahead = _AHEAD * (given - known.begun)
    if is_learnt and known is not None and not is_new and known.is_near(jacobian, stddev):
        known = known._replace(jacobian=jacobian).moved(given)
    else:
        known = Curvature(given, jacobian, given, agreed)
        if not is_given:
            by = gain(prior.root, jacobian, noise)
            known = renewed(known, measurements, at, stddev_of(Belief(at.x, by.root)))
    posterior = posterior_of(prior, noise, at.model, known.agreed.weight)
    local = posterior.local(at.x, left, jacobian, known.second + ahead)
    step = posterior.step(local, local.x)
    size, first = math.inf, step.cost
    evaluations = renewals = 0
    while evaluations < _MOST:
        evaluations += 1
        before, wanted = at, posterior.mean(local, step)
        most = _WORSE * local.square + wanted.size
        part = 1.0
        for _ in range(_SHORTENED):
            # Farther from the last state than its local model is good for it may get worse.
            at = Prediction(at.model, before.x + part * (wanted - before.x), shape)
            shorter = 0.5
            try:
                left = residuals(measurements, at)
                if posterior.square(at.x, left) <= most:
                    break
            except ContinuationError as error:
                if error.part > 0.0:  # a limit point is near where the arm was followed to
                    shorter = min(shorter, _SAFE * error.part)
            part *= shorter
        shape = at.solved
        jacobian = jacobians(measurements, at)
        given, _ = seconds(measurements, at)
        if not is_learnt:
            known = known.of_given(jacobian, given)
        else:
            change, known = at.x - before.x, known.halfway(given)
            is_right = known.foretells(change, jacobian, stddev)
            known = known.after(change, jacobian, scale).moved(given)
            if not is_right:
                if renewals == _RENEWALS:
                    break
                renewals += 1
                by = gain(prior.root, jacobian, noise)
                after = stddev_of(Belief(at.x, by.root))
                known = renewed_along(by, known, measurements, at, after, scale)
        local = posterior.local(at.x, left, jacobian, known.second)
        step = posterior.step(local, at.x)
        is_last = step.size <= _TOLERANCE or (
            is_given and step.size <= _STRAIGHT and posterior.bend(local, step.x).is_little
        )
        if is_last and step.cost <= first + _RISE:
            by, told = local.by, posterior.conclude(local, left, jacobian, known.second)
            belief = Belief(step.x, by.root, told.scatter)
            known = known._replace(
                agreed=known.agreed.after(told.agreed), share=told.share, begun=begun
            )
            square = told.square + step.beyond
            return Fit(belief, at, told.innovation, by.innovation_root, square, known)
        if step.size > _GROWTH * size:
            break
        size = step.size
    raise ConvergenceError('the estimate', step.size, evaluations)


def fit_at_mode(prior: Belief, measurements: Sequence[Measurement], at: Prediction) -> Fit:
    """The `Fit` ``at`` the most probable state, which is near the mean or all that is known of it.

    Raises:
        SolveError: if the arm has no trustworthy shape there.
    """
    left, jacobian = residuals(measurements, at), jacobians(measurements, at)
    by = gain(prior.root, jacobian, noise_root(measurements))
    innovation = left + jacobian @ (at.x - prior.mean)
    square = normalised_square(innovation, by.innovation_root)
    belief = prior.corrected(at.x, by, jacobian)
    return Fit(belief, at, innovation, by.innovation_root, square, None)
