"""States more and more probable, from anywhere: slow, where `fit` finds no way.

Gauss-Newton iteration that never makes a state less probable, and ends where it gets no further.
Exact measurements leave a narrow curved valley of likely states that takes many steps to follow:
they are taken to be less exact at first, which widens it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief, gain, normalised_square
from octo_arm_model.estimation.beliefs.posterior import nearest_possible
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
)
from octo_arm_model.estimation.state.prediction import Prediction

_TOLERANCE = 0.1  # standard deviations a component, of the last step
_FROM_AFAR = (1000.0, 100.0, 10.0, 1.0)  # times the noise, one after another
_FROM_NEARBY = (1.0,)
_MOST = 20  # steps for each
_SHORTEST = 0.01  # part of a step
_CORRECTIONS = 2  # of a step that leaves the curve on which the measurements are met
_SLACK = 1e-3  # of a cost that is in squares of standard deviations, for rounding


def most_probable(
    prior: Belief,
    measurements: Sequence[Measurement],
    starts: Sequence[Prediction],
    enough: float,
    *,
    is_judged: bool = False,
) -> tuple[Prediction, float]:
    """The most probable state that is found from ``starts``, and how improbable it is.

    That is a sum of squares of the change of ``prior`` and of the noise, in standard deviations,
    infinite where no shape is found. One that is as good as ``enough`` ends the search. If
    ``is_judged`` nothing but whether it is as good counts: measurements that are not, even if
    they are less exact, are not looked into further.
    """
    noise = noise_root(measurements)
    best, least = starts[0], math.inf
    # What is less exact leads to the right valley, and nearby the way along it may be short.
    for factors, start in itertools.product((_FROM_AFAR, _FROM_NEARBY), starts):
        at, is_hopeless = start, False
        try:
            for factor in factors:
                at = _descend(prior, measurements, factor * noise, at)
                square = _cost(prior, measurements, factor * noise, at)
                is_hopeless = is_judged and factor > 1.0 and square > enough
                if is_hopeless:
                    break
        except SolveError:
            continue
        if square < least:
            best, least = at, square
        if least <= enough or is_hopeless:
            break
    return best, least


def _cost(
    prior: Belief, measurements: Sequence[Measurement], noise: FloatArray, at: Prediction
) -> float:
    """Sum of squares of the change of the state and of the noise, in standard deviations."""
    away = at.x - prior.mean
    left = residuals(measurements, at)
    return normalised_square(away, prior.root) + normalised_square(left, noise)


def _descend(
    prior: Belief, measurements: Sequence[Measurement], noise: FloatArray, at: Prediction
) -> Prediction:
    """`most_probable` for a ``noise``."""

    def cost(at: Prediction) -> float:
        return _cost(prior, measurements, noise, at)

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
        if size <= _TOLERANCE:
            break
        new = moved(step, cost(at) + _SLACK)
        if new is None:
            break
        at = new
    return at
