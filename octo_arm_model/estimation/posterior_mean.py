"""From the most probable state to the mean of the posterior, to first order in the curvature.

Measurements much more exact than the belief leave a thin curved sheet of likely states. It is
thin where the measurements depend strongly on the state, so that its densest point is off to that
side of its mean: to the same side at every step. A filter that remembers would sum that up. The
distance follows from the determinant of the covariance of the innovation, S = J P J' + R, which
the mode leaves out (Laplace's approximation; Tierney and Kadane 1986): -P+ grad(ln det S) / 2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import Belief, Gain
from octo_arm_model.estimation.measurements import Measurement, jacobians
from octo_arm_model.estimation.prediction import Prediction

_STEP = 0.1  # standard deviations, of finite differences of the Jacobian
_LEAST = 0.03  # part of a standard deviation of an innovation that a direction must explain


def shift_to_mean(
    prior: Belief, measurements: Sequence[Measurement], at: Prediction, by: Gain
) -> FloatArray:
    """Mean of the posterior less its mode ``at``, (n,).

    ``by`` is what ``measurements`` linearised there make of the ``prior``.

    Raises:
        SolveError: if the arm has no trustworthy shape nearby.
    """
    jacobian, tension = jacobians(measurements, at), at.model.state.tension
    explained = np.linalg.solve(by.innovation_root, jacobian @ prior.root)
    rows, parts, directions = np.linalg.svd(explained, full_matrices=False)
    weights = np.linalg.solve(by.innovation_root.T, rows)
    gradient = np.zeros(at.x.size)
    for part, weight, direction in zip(parts, weights.T, directions, strict=True):
        if part < _LEAST:
            break
        move = _STEP * (prior.root @ direction)
        # A slack tendon cannot pull less.
        move[tension] = np.maximum(move[tension], -at.x[tension])
        moved = jacobians(measurements, Prediction(at.model, at.x + move, at.shape))
        gradient += part * (weight @ (moved - jacobian)) / _STEP
    return -by.root @ (by.root.T @ gradient)
