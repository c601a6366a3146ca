"""From the most probable state to the mean of the posterior, to first order in the curvature.

Measurements much more exact than the belief leave a thin curved sheet of likely states. It is
thin where the measurements depend strongly on the state, so that its densest point is off to that
side of its mean: to the same side at every step. A filter that remembers would sum that up. The
distance follows from the determinant of the covariance of the innovation, S = J P J' + R, which
the mode leaves out (Laplace's approximation; Tierney and Kadane 1986): -P+ grad(ln det S) / 2.

That is so where the state is random about the mean of the prior. Where the mean of the prior is
random about the state, as errors of sensors make it, the mode is right on average: to first order
its error does not depend on its residuals. Where the state scatters about a known mean with a
covariance A and estimates scatter about the state with the rest, P - A, the distance on average is
P+ tr(A J' S^-1 dJ), but for a term along the gain that is smaller than the noise. What comes of
random walks is counted with the rest: their rates are bounds, of which a tendon that holds still
makes no use, and a force beside it would drift; one that moves is soon drawn to another side.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import Gain, solve_lower


def share_of(scatter: FloatArray, jacobian: FloatArray, by: Gain) -> FloatArray:
    """The gain A J' S^-1 (n, m) of the part ``scatter`` A (n, n) of a covariance alone.

    ``by`` is what linear measurements of ``jacobian`` (m, n) make of all of it.
    """
    white = solve_lower(by.innovation_root, jacobian @ scatter)
    return solve_lower(by.innovation_root, white, is_transposed=True).T


def shift_to_mean(by: Gain, share: FloatArray, second: FloatArray) -> FloatArray:
    """Mean of the posterior less its mode, (n,).

    ``by`` is what linearised measurements make of the prior, ``share`` that of its `scatter`, and
    ``second`` (m, n, n) their second derivatives there.
    """
    return -by.root @ (by.root.T @ gradient(share, second))


def gradient(gain: FloatArray, second: FloatArray) -> FloatArray:
    """Gradient of ln(det S) / 2 by the state, (n,), at a ``gain`` (n, m): tr(P+ J' R^-1 dJ)."""
    return np.asarray(gain.T.ravel() @ second.reshape(gain.size, -1))


def weight_of(shift: FloatArray, by: Gain, second: FloatArray) -> float:
    """Part of the whole shift, that of a prior which scatters with all of its covariance, 0 to 1.

    That of ``shift``, along it.
    """
    whole = by.root.T @ gradient(by.gain, second)
    square = float(whole @ whole)
    if not square:
        return 0.0
    return min(max(0.0, -float(solve_lower(by.root, shift) @ whole) / square), 1.0)
