"""The mean of a state after measurements, by an iterated extended Kalman filter.

Each iteration evaluates one shape and its derivatives. It models the measurements about that state
to second order, if they state second derivatives (`Measurement.second`). The next state is the
mean by this local model.

Measurements that are much more exact than the prior leave a thin curved sheet of likely states.
The mode of this sheet is on one side of its mean, at every step on the same side, so a filter that
took the mode would add up this bias. The difference follows from the gradient of the determinant
of the information A, grad(ln det A) / 2 (Laplace's approximation; Tierney and Kadane 1986). The
innovations cause the bias. If they are smaller than expected, as for an arm that nothing touches,
the bias is small too. So the correction is weighted by the ratio of the actual to the expected.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gaussian import Gaussian, lower_root, solve_lower, spread, square_of
from octo_arm_model.estimation.measurement import Rows
from octo_arm_model.estimation.model import ArmModel, Prediction

_TOLERANCE = 0.3  # last step, in standard deviations per component
_NOISE_FACTORS = (100.0, 10.0)  # factors on the noise, one after the other
_INNER_STEPS = 8  # largest number of steps within a local model
_SLACK = 0.01  # allowed rise of the cost by a step, per component
_MOST_HALVINGS = 6  # largest number of halvings of a step
_FARTHEST_OFF = 5.0  # largest difference of a ratio of biases, in standard deviations
_FARTHEST = 1.0  # standard deviations to the mean up to which second derivatives hold


class Fit(NamedTuple):
    """The state after measurements."""

    known: Gaussian  #: the distribution after them
    prediction: Prediction  #: a prediction near its mean, about which they were linearised
    is_converged: bool = True  #: whether the last step to the mean was short
    #: ratio of the bias that the innovation caused in the mode to the expected one, and the
    #: inverse of its variance, which is 0 without second derivatives
    ratio: tuple[float, float] = 1.0, 0.0


def agree(
    prior: Gaussian,
    rows: Rows,
    weight: float,
    prediction: Prediction,
    spared: int = 0,
    *,
    is_new: bool = False,
) -> Fit:
    """Return the state after measured ``rows``, given a ``prior``; begin from ``prediction``.

    The correction from mode to mean has a ``weight`` of 0 to 1.
    If it ``is_new``, or no step lowers the cost, the noise is raised at first, which widens the
    valley of likely states. If no more work is left than the ``spared`` evaluations, the
    covariance contains the last step.

    Raises:
        SolveError: if there is no trustworthy shape on the way.
    """
    if not len(rows):
        mean = nearest_possible(prediction.model, prior)
        prediction = prediction.solved_at(mean)
        return Fit(Gaussian(mean, prior.root), prediction)
    if not is_new:
        try:
            is_far = prediction.linear_part(prior.mean) < 1.0
            if is_far and prediction.work.is_left(spared + 1):  # a step needs one more evaluation
                new = prediction.solved_at(nearest_possible(prediction.model, prior))
                prediction = min(prediction, new, key=lambda point: _cost(prior, rows, point))
            fit = _fit(_Local(prior, rows, weight, prediction), spared)
            if fit.is_converged or not prediction.work.is_left(spared):
                return fit
            prediction = fit.prediction
        except SolveError:
            pass  # on the way from here
    for factor in _NOISE_FACTORS:
        blurred = rows.blurred(factor)
        prediction = _fit(_Local(prior, blurred, weight, prediction), spared).prediction
    return _fit(_Local(prior, rows, weight, prediction), spared)


def _cost(prior: Gaussian, rows: Rows, prediction: Prediction) -> float:
    of_prior = square_of(prediction.x - prior.mean, prior.root)
    return of_prior + square_of(rows.innovation(prediction), rows.noise_root)


class _Local:
    """A model of the measurements about a state to second order, in standard deviations."""

    def __init__(
        self,
        prior: Gaussian,
        rows: Rows,
        weight: float,
        prediction: Prediction,
        innovation: FloatArray | None = None,
    ) -> None:
        self.prior, self.rows, self.weight, self.prediction = prior, rows, weight, prediction
        if innovation is None:
            innovation = rows.innovation(prediction)
        jacobian, second = rows.jacobian(prediction) @ prior.root, rows.second(prediction)
        white = solve_lower(rows.noise_root, np.column_stack([innovation, jacobian]))
        self.z = self._white(prediction.x)
        self.innovation, self.jacobian = white[:, 0], white[:, 1:]
        self.spread, self.slope = spread(self.jacobian), np.zeros(len(prior.root))
        self.root = prior.root @ self.spread  # of the covariance after them
        # All known second derivatives, and the gradient of half the log determinant.
        self.curvature: tuple[FloatArray, FloatArray] | None = None
        # A step by only some of the second derivatives is no better than one without them.
        self.second: FloatArray | None = None
        if second is not None:
            scaled = solve_lower(rows.noise_root, second.reshape(len(innovation), -1))
            second = prior.root.T @ scaled.reshape(second.shape) @ prior.root
            self.second = second if rows.has_second(prediction) else None
            self.curvature = second, gradient(self._gain(), second)
            self.slope = weight * self.curvature[1]
            far = float(np.linalg.norm(self.spread.T @ self.slope))
            self.slope *= min(1.0, _FARTHEST / far) if far else 1.0

    def _white(self, x: FloatArray) -> FloatArray:
        return solve_lower(self.prior.root, x - self.prior.mean)

    def _gain(self) -> FloatArray:
        return np.asarray(self.spread @ (self.jacobian @ self.spread).T)

    def step(self, x: FloatArray | None = None) -> tuple[FloatArray, float]:
        """Return the state after a Gauss-Newton step to the mean, and the step per component.

        It begins at ``x``, or at the state of the model.
        """
        z, innovation, jacobian, root = self.z, self.innovation, self.jacobian, self.spread
        if x is None:
            x = self.prediction.x
        elif self.second is not None:
            z = self._white(x)
            jacobian_change = self.second @ (z - self.z)
            innovation = innovation - (jacobian + 0.5 * jacobian_change) @ (z - self.z)
            jacobian = jacobian + jacobian_change
            root = spread(jacobian)
        change = root.T @ (jacobian.T @ innovation - z - self.slope)
        target = Gaussian(x + self.prior.root @ (root @ change), self.root)
        size = math.sqrt(float(change @ change) / z.size)
        return nearest_possible(self.prediction.model, target), size

    def target_mean(self, x: FloatArray, size: float) -> FloatArray:
        """Return the mean by this model, by iteration after a first step to ``x``."""
        for _ in range(_INNER_STEPS):
            if self.second is None or size <= 1.0:
                break
            x, size = self.step(x)
        return x

    def cost(self, x: FloatArray, innovation: FloatArray) -> float:
        """Return the squares of a state ``x`` with its white ``innovation``, with the slope."""
        z = self._white(x)
        return float(z @ z + innovation @ innovation + 2.0 * (self.slope @ (z - self.z)))

    def moved_towards(self, target: FloatArray, spared: int) -> _Local | None:
        """Return the model at a more probable state towards ``target``; None if there is none."""
        start = self.prediction
        most = self.cost(start.x, self.innovation) + _SLACK * target.size
        scale = start.linear_part(target)
        for _ in range(_MOST_HALVINGS):
            if not start.work.is_left(spared):
                break
            new = start.moved_to(start.x + scale * (target - start.x))
            try:
                innovation = self.rows.innovation(new)
                if self.cost(new.x, solve_lower(self.rows.noise_root, innovation)) <= most:
                    return _Local(self.prior, self.rows, self.weight, new, innovation)
            except SolveError:
                pass  # a shorter step is tried
            scale *= 0.5
        return None

    def ratio(self) -> tuple[float, float]:
        """Return the ratio of biases by the innovation, and its inverse variance; see `Fit`."""
        if self.curvature is None:
            return 1.0, 0.0
        second, slope = self.curvature
        root = lower_root(np.column_stack([self.jacobian, np.eye(len(self.innovation))]))
        white = solve_lower(root, self.innovation + self.jacobian @ self.z)
        shift = self.spread.T @ slope
        # The bias is a quadratic form of the whitened innovation, of variance 2 |form|^2.
        form = solve_lower(root, (second @ (self.spread @ shift)) @ self._gain() @ root)
        form = 0.5 * (form + form.T)
        expected, stddev = float(shift @ shift), math.sqrt(2.0) * float(np.linalg.norm(form))
        if not expected > 0.0 or not stddev > 0.0:
            return 1.0, 0.0
        off = np.clip((white @ form @ white - expected) / stddev, -_FARTHEST_OFF, _FARTHEST_OFF)
        return 1.0 + float(off) * stddev / expected, (expected / stddev) ** 2


def _fit(local: _Local, spared: int) -> Fit:
    """Return the mean, by iteration from a ``local`` model."""
    step, is_converged = local.step(), True
    while is_converged and step[1] > _TOLERANCE:
        if (new_local := local.moved_towards(local.target_mean(*step), spared)) is None:
            is_converged = False
        else:
            local, step = new_local, new_local.step()
    mean, root = step[0], local.root
    if not is_converged:
        root = lower_root(np.column_stack([root, mean - local.prediction.x]))
    return Fit(Gaussian(mean, root), local.prediction, is_converged, local.ratio())


def gradient(gain: FloatArray, second: FloatArray) -> FloatArray:
    """Return the gradient tr(P+ J' R^-1 dJ) of ln(det A) / 2, (n,), for a ``gain`` (n, m)."""
    return np.asarray(gain.T.ravel() @ second.reshape(gain.size, -1))


def nearest_possible(model: ArmModel, known: Gaussian) -> FloatArray:
    """Return the most probable state with tensions >= 0 of a ``known`` distribution, (n,)."""
    tension, mean = model.state.tension, known.mean
    is_slack = np.zeros(mean.size, dtype=bool)
    while (mean[tension] < 0.0).any():
        is_slack[tension] |= mean[tension] < 0.0
        change = np.linalg.lstsq(known.root[is_slack], -known.mean[is_slack], rcond=None)[0]
        mean = known.mean + known.root @ change
        mean[is_slack] = 0.0
    return mean
