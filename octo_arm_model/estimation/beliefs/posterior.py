"""A posterior where what measurements predict is known to second order, and its mean by that.

States, residuals and derivatives are in standard deviations: of the belief before the
measurements, and of their noise.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgeqrf, dposv, dpotrf

from octo_arm_model.core.compiled.kernel_compiler import entry_point
from octo_arm_model.core.compiled.models.arm_tables import own
from octo_arm_model.core.compiled.numba_build import second_order_step, whiten_residuals
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief, Gain, solve_lower
from octo_arm_model.estimation.beliefs.posterior_mean import gain_of_part, gradient
from octo_arm_model.estimation.state.prediction import ArmModel

_MOST_OF_MODEL = 8  # steps within a local model
_OFF, _TURNED = 0.1, 0.3  # parts of the noise, of what is straight: its values, its spread
_LAST = 1.0  # step within it that is the last
_HALVED = 5  # times that such a step is halved
_BENT = 0.8  # part of its stiffness that a direction may lose as measurements bend
_MOST_BENT = 50  # halvings of what it loses


class Local(NamedTuple):
    """What measurements predict about one state, to second order, in standard deviations.

    Attributes:
        x: the state, in its own units.
        z: its distance from the mean before, (n,).
        left: measured less predicted there, (m,).
        jacobian: of what is predicted, (m, n).
        second: its second derivatives, (m, n, n).
        slope: gradient of what is least, by which the mean is not the most probable state, (n,).
    """

    x: FloatArray
    z: FloatArray
    left: FloatArray
    jacobian: FloatArray
    second: FloatArray
    slope: FloatArray

    @property
    def square(self) -> float:
        """Sum of squares of the change of the state and of the noise."""
        return float(self.z @ self.z) + float(self.left @ self.left)

    def about(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measured less predicted in ``z``, and the Jacobian there."""
        change = z - self.z
        bent = self.second @ change
        return self.left - (self.jacobian + 0.5 * bent) @ change, self.jacobian + bent


class Step(NamedTuple):
    """A step of the iteration from ``start`` to ``x``.

    Attributes:
        size: in standard deviations a component.
        beyond: square of how far the mean is beyond the possible states.
        cost: what is least at the end, in squares of standard deviations, but for a constant.
    """

    start: FloatArray
    x: FloatArray
    size: float
    beyond: float
    cost: float


class Posterior:
    """What is known of a state after measurements."""

    def __init__(self, prior: Belief, noise: FloatArray, model: ArmModel, weight: float) -> None:
        """Of a ``prior`` and measurements of the root ``noise`` of their covariance.

        ``weight`` is that of the shift to the mean; 0 leads to the most probable state.
        """
        self._prior, self._model, self._weight = prior, model, weight
        self._per_noise = solve_lower(noise, np.eye(len(noise)))
        self._is_compiled = model.solver.is_compiled
        if self._is_compiled:
            self._whiten, self._step = (
                entry_point(kernel()) for kernel in (whiten_residuals, second_order_step)
            )
            self._known = own(prior.mean), own(prior.root)
            self._per_noise = own(self._per_noise)

    def local(
        self, x: FloatArray, left: FloatArray, jacobian: FloatArray, second: FloatArray, by: Gain
    ) -> Local:
        """Of derivatives in their own units, see `Local`, and what they make ``by`` themselves.

        Raises:
            ValueError: if residuals and derivatives are not of the same measurements and state.
        """
        root, (m, n) = self._prior.root, jacobian.shape
        shapes = len(root), len(self._per_noise), left.shape, second.shape
        if shapes != (n, m, (m,), (m, n, n)):
            # Machine code does not check them.
            raise ValueError(f'{shapes} do not go with a Jacobian of shape {(m, n)}')
        slope = np.zeros(n)
        if self._weight:
            part = gain_of_part(self._prior.scattered, jacobian, by)
            slope = self._weight * (gradient(part, second) @ root)
        if self._is_compiled:
            local = Local(
                x, np.empty(n), np.empty(m), np.empty((m, n)), np.empty((m, n, n)), slope
            )
            self._whiten(
                *self._known, self._per_noise,
                *(np.array(given, np.float64, order='C') for given in (x, left, jacobian, second)),
                np.empty((n, n)), np.empty((n, n)), *local[1:5],
            )  # fmt: skip
            return local
        # By products: with this many columns BLAS's dtrsm lets threads wait for each other.
        bent = (self._per_noise @ second.reshape(m, n * n)).reshape(m, n, n)
        return Local(
            x,
            self._away(x),
            self._per_noise @ left,
            self._per_noise @ jacobian @ root,
            root.T @ bent @ root,
            slope,
        )

    def is_straight(self, local: Local, x: FloatArray, by: Gain) -> bool:
        """Whether measurements bend little from the state of a ``local`` model to ``x``.

        Neither what they predict there nor its spread, by what they make of the belief ``by``
        themselves, is off by more than a part of the noise.
        """
        bent = local.second @ (self._away(x) - local.z)
        off = 0.5 * (bent @ (self._away(x) - local.z))
        turned = bent @ solve_lower(self._prior.root, by.root)
        return bool(np.linalg.norm(off) <= _OFF and np.linalg.norm(turned) <= _TURNED)

    def square(self, x: FloatArray, left: FloatArray) -> float:
        """`Local.square` in a state ``x``, where so much is ``left``."""
        z, left = self._away(x), self._per_noise @ left
        return float(z @ z) + float(left @ left)

    def _away(self, x: FloatArray) -> FloatArray:
        return solve_lower(self._prior.root, x - self._prior.mean)

    def mean(self, local: Local, step: Step) -> FloatArray:
        """The mean by a ``local`` model, from a ``step`` on."""
        for _ in range(_MOST_OF_MODEL):
            if step.size <= _LAST:
                break
            for halved in range(_HALVED):
                new = self.step(local, step.start + 0.5**halved * (step.x - step.start))
                if new.cost <= step.cost:
                    break
            else:
                return new.start
            step = new
        return step.x

    def step(self, local: Local, x: FloatArray) -> Step:
        """Newton's step from ``x`` to the mean by a ``local`` model."""
        if self._is_compiled:
            wanted = np.empty(x.size)
            size, cost = self._step(
                *self._known, own(x), local.z, local.left, local.jacobian, local.second,
                local.slope, _BENT, _MOST_BENT, wanted,
            )  # fmt: skip
            # Where a tension would be below zero what is nearest is looked for below.
            if not wanted[self._model.state.tension].min() < 0.0:
                return Step(x, wanted, size, 0.0, cost)
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
    """A ``change`` (n,) divided by 1 - ``bent`` (n, n), of which no part is above `_BENT`.

    Where one is, all of them are halved until none is.
    """
    one = _identity(change.size)
    # By Cholesky alone: eigenvalues take longer, and much longer where threads of LAPACK wait.
    for _ in range(_MOST_BENT):
        every = bent.ravel()
        # No part is above the root of the sum of all squares.
        if every @ every <= _BENT * _BENT or dpotrf(_BENT * one - bent, lower=1)[1] == 0:
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
