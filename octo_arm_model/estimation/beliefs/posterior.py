"""A posterior where what measurements predict is known to second order, and its mean by that.

States, residuals and derivatives are in standard deviations: of the belief before the
measurements, and of their noise.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from scipy.linalg.lapack import dgeqrf, dposv, dpotrf

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import (
    Belief,
    gain,
    normalised_square,
    solve_lower,
)
from octo_arm_model.estimation.beliefs.local import Bend, Conclusion, Local, Step
from octo_arm_model.estimation.beliefs.posterior_mean import (
    agreement,
    gain_of_part,
    gradient,
    share_of,
)
from octo_arm_model.estimation.state.prediction import ArmModel

MOST_OF_MODEL = 8  # steps within a local model
LAST = 1.0  # step within it that is the last
HALVED = 5  # times that such a step is halved
BENT = 0.8  # part of its stiffness that a direction may lose as measurements bend
MOST_BENT = 50  # halvings of what it loses


class Posterior:
    """What is known of a state after measurements."""

    def __init__(self, prior: Belief, noise: FloatArray, model: ArmModel, weight: float) -> None:
        """Of a ``prior`` and measurements of the root ``noise`` of their covariance.

        ``weight`` is that of the shift to the mean; 0 leads to the most probable state.
        """
        self._prior, self._model, self._noise, self._weight = prior, model, noise, weight
        self._per_noise = solve_lower(noise, np.eye(len(noise)))

    def local(
        self, x: FloatArray, left: FloatArray, jacobian: FloatArray, second: FloatArray
    ) -> Local:
        """Of derivatives in their own units, see `Local`.

        Raises:
            ValueError: if residuals and derivatives are not of the same measurements and state.
        """
        root, (m, n) = self._prior.root, jacobian.shape
        shapes = len(root), len(self._per_noise), left.shape, second.shape
        if shapes != (n, m, (m,), (m, n, n)):
            # Machine code does not check them.
            raise ValueError(f'{shapes} do not go with a Jacobian of shape {(m, n)}')
        return self._local(x, left, jacobian, second)

    def _local(
        self, x: FloatArray, left: FloatArray, jacobian: FloatArray, second: FloatArray
    ) -> Local:
        root, (m, n) = self._prior.root, jacobian.shape
        by, slope = gain(root, jacobian, self._noise), np.zeros(n)
        if self._weight:
            part = gain_of_part(self._prior.scattered, jacobian, by)
            slope = self._weight * (gradient(part, second) @ root)
        # By products: with this many columns BLAS's dtrsm lets threads wait for each other.
        bent = (self._per_noise @ second.reshape(m, n * n)).reshape(m, n, n)
        return Local(
            x,
            by,
            self._away(x),
            self._per_noise @ left,
            self._per_noise @ jacobian @ root,
            root.T @ bent @ root,
            slope,
        )

    def bend(self, local: Local, x: FloatArray) -> Bend:
        """How measurements bend from the state of a ``local`` model to ``x``."""
        bent = local.second @ (self._away(x) - local.z)
        off = 0.5 * (bent @ (self._away(x) - local.z))
        turned = bent @ solve_lower(self._prior.root, local.by.root)
        return Bend(float(np.linalg.norm(off)), float(np.linalg.norm(turned)))

    def conclude(
        self, local: Local, left: FloatArray, jacobian: FloatArray, second: FloatArray
    ) -> Conclusion:
        """What measurements tell by a ``local`` model, of these derivatives in their own units."""
        prior, by = self._prior, local.by
        innovation = left + jacobian @ (local.x - prior.mean)
        whole = gradient(by.gain, second)
        part = gradient(gain_of_part(prior.scattered, jacobian, by), second)
        scatter = prior.corrected(local.x, by, jacobian).scattered
        return Conclusion(
            innovation,
            normalised_square(innovation, by.innovation_root),
            scatter,
            agreement(by, part, innovation, second),
            share_of(part, whole, by),
        )

    def square(self, x: FloatArray, left: FloatArray) -> float:
        """`Local.square` in a state ``x``, where so much is ``left``."""
        z, left = self._away(x), self._per_noise @ left
        return float(z @ z) + float(left @ left)

    def _away(self, x: FloatArray) -> FloatArray:
        return solve_lower(self._prior.root, x - self._prior.mean)

    def mean(self, local: Local, step: Step) -> FloatArray:
        """The mean by a ``local`` model, from a ``step`` on."""
        for _ in range(MOST_OF_MODEL):
            if step.size <= LAST:
                break
            for halved in range(HALVED):
                new = self.step(local, step.start + 0.5**halved * (step.x - step.start))
                if new.cost <= step.cost:
                    break
            else:
                return new.start
            step = new
        return step.x

    def step(self, local: Local, x: FloatArray) -> Step:
        """Newton's step from ``x`` to the mean by a ``local`` model."""
        m, n = local.jacobian.shape
        z, left, jacobian = local.z, local.left, local.jacobian
        if x is not local.x:
            z = self._away(x)
            left, jacobian = local.about(z)
        root, change = _least_squares(jacobian, left, z)
        multiplier = left - jacobian @ solve_lower(root, change, is_transposed=True)
        # What Gauss and Newton leave out: how measurements bend.
        bent = (multiplier @ local.second.reshape(m, n * n)).reshape(n, n)
        bent = solve_lower(root, solve_lower(root, bent).T)
        if self._weight:
            change = change - solve_lower(root, local.slope)
        change = _stiffened(bent, change)
        wanted = x + self._prior.root @ solve_lower(root, change, is_transposed=True)
        new, beyond = wanted, 0.0
        if wanted[self._model.state.tension].min() < 0.0:
            after = solve_lower(root, self._prior.root.T).T
            new = nearest_possible(self._model, Belief(x, after), wanted)
            to_white = np.tril(root).T
            change, off = (to_white @ (self._away(new) - self._away(one)) for one in (x, wanted))
            beyond = float(off @ off)
        size = math.sqrt(float(change @ change) / n)
        cost = float(z @ z + left @ left + 2.0 * (local.slope @ (z - local.z)))
        return Step(x, new, size, beyond, cost)


def _least_squares(
    jacobian: FloatArray, left: FloatArray, z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The step d of Gauss and Newton that makes |left - jacobian d|^2 + |z + d|^2 least.

    Returns the root of the inverse of the covariance, 1 + J' J, of which the triangle on and below
    the diagonal counts, and the step times the transpose of that, (n,). By orthogonal factors,
    exact where measurements are a million times better known.
    """
    m, n = jacobian.shape
    array = np.empty((m + n, n + 1), order='F')
    array[:m, :n], array[:m, n] = jacobian, left
    array[m:, :n], array[m:, n] = _identity(n), -z
    array = dgeqrf(array, overwrite_a=1)[0]
    return array[:n, :n].T.copy(), array[:n, n]


def _stiffened(bent: FloatArray, change: FloatArray) -> FloatArray:
    """A ``change`` (n,) divided by 1 - ``bent`` (n, n), of which no part is above `BENT`.

    Where one is, all of them are halved until none is.
    """
    one = _identity(change.size)
    # By Cholesky alone: eigenvalues take longer, and much longer where threads of LAPACK wait.
    for _ in range(MOST_BENT):
        every = bent.ravel()
        # No part is above the root of the sum of all squares.
        if every @ every <= BENT * BENT or dpotrf(BENT * one - bent, lower=1)[1] == 0:
            return np.asarray(dposv(one - bent, change, lower=1)[1])
        bent = 0.5 * bent
    return change


@functools.lru_cache(maxsize=64)
def _identity(count: int) -> FloatArray:
    return np.eye(count)


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
