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

from octo_arm_model.arm.errors import ContinuationError, ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.gaussian import Gaussian, lower_root, solve_lower, spread, square_of
from octo_arm_model.estimation.measurement import Rows
from octo_arm_model.estimation.model import ArmModel, Prediction

_TOLERANCE = 0.3  # last step, in standard deviations per component
# The same if second order changes values and derivatives by less, over the noise.
_STRAIGHT, _OFF, _TURNED = 3.0, 0.1, 0.3
_NOISE_FACTORS = (100.0, 10.0)  # factors on the noise, one after the other
_INNER_STEPS = 8  # largest number of steps within a local model
_SLACK = 0.01  # allowed rise of the cost by a step, per component
_MOST_HALVINGS = 6  # largest number of halvings of a step
_LONGEST = 0.2  # largest displacement of a station by a step, over the length of the arm
_FARTHEST_OFF = 5.0  # largest difference of an agreement, in standard deviations
_FARTHEST = 1.0  # standard deviations to the mean up to which second derivatives hold
_LATELY = 1000  # number of updates over which agreements are averaged


class Work:
    """The budget of one message: evaluations of shapes, and iterations of the solver."""

    def __init__(self, evaluations: int, iterations: int, whole: Work | None = None) -> None:
        """Begin with these numbers; what is taken of this is taken of a ``whole`` budget too."""
        self.evaluations, self.iterations, self._whole = evaluations, iterations, whole

    def share(self, evaluations: int) -> Work:
        """Return a part of this budget with at most so many ``evaluations``."""
        return Work(min(evaluations, self.evaluations), self.iterations, self)

    @property
    def is_left(self) -> bool:
        """Whether another shape may be evaluated."""
        return self.evaluations > 0 and self.iterations > 0

    def take(self, iterations: int) -> None:
        """Subtract one evaluation and its ``iterations``."""
        self.evaluations -= 1
        self.iterations -= iterations
        if self._whole is not None:
            self._whole.take(iterations)


class Agreement(NamedTuple):
    """The ratio of the bias that innovations caused in the mode to the expected bias.

    Attributes:
        value: the averaged ratio; about 1 if prior and noise are right.
        information: inverse of the variance of the value; 0 before any innovation.
    """

    value: float = 0.0
    information: float = 0.0

    @property
    def weight(self) -> float:
        """Weight of the correction from mode to mean, 0 to 1: the value with a prior of 1 +- 1."""
        if not self.information:
            return 0.0
        return min(max(0.0, (1.0 + self.information * self.value) / (1.0 + self.information)), 1.0)

    def after(self, drawn: float, expected: float, stddev: float) -> Agreement:
        """Return the ratio with one more innovation, whose bias is ``drawn``, not ``expected``."""
        if not expected > 0.0 or not stddev > 0.0:
            return self
        off = min(max((drawn - expected) / stddev, -_FARTHEST_OFF), _FARTHEST_OFF)
        added = (expected / stddev) ** 2
        information = self.information * (1.0 - 1.0 / _LATELY) + added
        value = self.value + added / information * (1.0 + off * stddev / expected - self.value)
        return Agreement(value, information)


class Fit(NamedTuple):
    """The state after measurements.

    Attributes:
        known: the distribution after them.
        prediction: a prediction near its mean, about which they were linearised.
        agreement: the agreement after them.
        is_converged: whether the last step to the mean was short.
    """

    known: Gaussian
    prediction: Prediction
    agreement: Agreement
    is_converged: bool


def agree(
    prior: Gaussian,
    rows: Rows,
    agreement: Agreement,
    prediction: Prediction,
    work: Work,
    *,
    is_new: bool = False,
) -> Fit:
    """Return the state after measured ``rows``, given a ``prior``; begin from ``prediction``.

    If it ``is_new``, or no step lowers the cost, the noise is raised at first, which widens the
    valley of likely states. If the ``work`` ends before, the covariance contains the last step.

    Raises:
        SolveError: if there is no trustworthy shape on the way.
    """
    if not len(rows):
        mean = nearest_possible(prediction.model, prior)
        prediction = evaluated(prediction, mean, work)
        return Fit(Gaussian(mean, prior.root), prediction, agreement, is_converged=True)
    if 'solved' not in vars(prediction):
        work.take(int(prediction.solved.iterations))
    if not is_new:
        try:
            is_far = prediction.distance(prior.mean) > _LONGEST * prediction.model.arm.length
            # Innovations are not linear over such a distance. A step needs one more evaluation.
            if is_far and work.evaluations > 1:
                new = evaluated(prediction, nearest_possible(prediction.model, prior), work)
                prediction = min(prediction, new, key=lambda point: _cost(prior, rows, point))
            fit = _fit(_Local(prior, rows, agreement, prediction), work)
            if fit.is_converged or not work.is_left:
                return fit
            prediction = fit.prediction
        except SolveError:
            pass  # on the way from here
    for factor in _NOISE_FACTORS:
        blurred = rows.blurred(factor)
        prediction = _fit(_Local(prior, blurred, agreement, prediction), work).prediction
    return _fit(_Local(prior, rows, agreement, prediction), work)


def _cost(prior: Gaussian, rows: Rows, prediction: Prediction) -> float:
    of_prior = square_of(prediction.x - prior.mean, prior.root)
    return of_prior + square_of(rows.innovation(prediction), rows.noise_root)


def evaluated(prediction: Prediction, x: FloatArray, work: Work) -> Prediction:
    """Return the evaluated prediction of ``x``, continued from another one, or else from nothing.

    Raises:
        SolveError: if there is no trustworthy shape.
    """
    new_prediction = prediction.moved_to(x)
    try:
        work.take(int(new_prediction.solved.iterations))
    except ContinuationError as error:
        work.take(error.iterations)
        if prediction.shape is None:
            raise
        new_prediction = Prediction(prediction.model, x, None)
        work.take(int(new_prediction.solved.iterations))
    return new_prediction


class _Step(NamedTuple):
    """A step to a state ``x``, its size per component, and the cost at its start."""

    x: FloatArray
    size: float
    cost: float


class _Local:
    """A model of the measurements about a state to second order, in standard deviations."""

    def __init__(
        self,
        prior: Gaussian,
        rows: Rows,
        agreement: Agreement,
        prediction: Prediction,
        innovation: FloatArray | None = None,
    ) -> None:
        self.prior, self.rows, self.agreement, self.prediction = prior, rows, agreement, prediction
        if innovation is None:
            innovation = rows.innovation(prediction)
        jacobian, second = rows.jacobian(prediction) @ prior.root, rows.second(prediction)
        white = solve_lower(rows.noise_root, np.column_stack([innovation, jacobian]))
        self.z = self._white(prediction.x)
        self.innovation, self.jacobian = white[:, 0], white[:, 1:]
        self.spread, self.slope = spread(self.jacobian), np.zeros(len(prior.root))
        self.root = prior.root @ self.spread  # of the covariance after them
        # The known second derivatives, and the gradient of half the log determinant.
        self.curvature: tuple[FloatArray, FloatArray] | None = None
        # A step by only some of the second derivatives is no better than one without them.
        self.second: FloatArray | None = None
        if second is not None:
            scaled = solve_lower(rows.noise_root, second.reshape(len(innovation), -1))
            second = prior.root.T @ scaled.reshape(second.shape) @ prior.root
            self.curvature = second, gradient(self._gain(), second)
            self.second = second if rows.has_second(prediction) else None
            self.slope = agreement.weight * self.curvature[1]
            far = float(np.linalg.norm(self.spread.T @ self.slope))
            self.slope *= min(1.0, _FARTHEST / far) if far else 1.0

    def _white(self, x: FloatArray) -> FloatArray:
        return solve_lower(self.prior.root, x - self.prior.mean)

    def _gain(self) -> FloatArray:
        return np.asarray(self.spread @ (self.jacobian @ self.spread).T)

    def step(self, x: FloatArray | None = None) -> _Step:
        """Return the Gauss-Newton step to the mean from ``x``, or from the state of the model."""
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
        size, cost = math.sqrt(float(change @ change) / z.size), self._cost(z, innovation)
        return _Step(nearest_possible(self.prediction.model, target), size, cost)

    def _cost(self, z: FloatArray, residual: FloatArray) -> float:
        return float(z @ z + residual @ residual + 2.0 * (self.slope @ (z - self.z)))

    def target_mean(self, step: _Step) -> FloatArray:
        """Return the mean by this model, by iteration from a first ``step``."""
        if self.second is None:
            return step.x
        start = self.prediction.x
        for _ in range(_INNER_STEPS):
            if step.size <= 1.0:
                break
            for halvings in range(5):
                x = start + 0.5**halvings * (step.x - start)
                new = self.step(x)
                if new.cost <= step.cost:
                    break
            else:
                return x
            start, step = x, new
        return step.x

    def moved_towards(self, target: FloatArray, work: Work) -> _Local | None:
        """Return the model at a more probable state towards ``target``; None if there is none."""
        start, cost_before = self.prediction, self._cost(self.z, self.innovation)
        scale = min(1.0, _LONGEST * start.model.arm.length / max(start.distance(target), 1e-300))
        for _ in range(_MOST_HALVINGS):
            if not work.is_left:
                break
            new = start.moved_to(start.x + scale * (target - start.x))
            try:
                innovation = self.rows.innovation(new)
                work.take(int(new.solved.iterations))
                residual = solve_lower(self.rows.noise_root, innovation)
                cost = self._cost(self._white(new.x), residual)
                if cost <= cost_before + _SLACK * target.size:
                    return _Local(self.prior, self.rows, self.agreement, new, innovation)
            except SolveError as error:
                work.take(error.iterations if isinstance(error, ConvergenceError) else 1)
            scale *= 0.5
        return None

    def is_converged(self, step: _Step) -> bool:
        """Return whether a ``step`` is short, or measurements are nearly linear along it."""
        if step.size <= _TOLERANCE:
            return True
        is_straight = self.prediction.model.state.is_geometric and step.size <= _STRAIGHT
        if self.second is None or not is_straight:
            return False
        change = self._white(step.x) - self.z
        jacobian_change = self.second @ change
        off, turned = 0.5 * jacobian_change @ change, jacobian_change @ self.spread
        return bool(np.linalg.norm(off) <= _OFF and np.linalg.norm(turned) <= _TURNED)

    def new_agreement(self) -> Agreement:
        """Return the agreement after these measurements."""
        if self.curvature is None:
            return self.agreement
        second, slope = self.curvature
        root = lower_root(np.column_stack([self.jacobian, np.eye(len(self.innovation))]))
        white = solve_lower(root, self.innovation + self.jacobian @ self.z)
        shift = self.spread.T @ slope
        # The bias is a quadratic form of the whitened innovation, of variance 2 |form|^2.
        form = solve_lower(root, (second @ (self.spread @ shift)) @ self._gain() @ root)
        form = 0.5 * (form + form.T)
        stddev = math.sqrt(2.0) * float(np.linalg.norm(form))
        return self.agreement.after(float(white @ form @ white), float(shift @ shift), stddev)


def _fit(local: _Local, work: Work) -> Fit:
    """Return the mean, by iteration from a ``local`` model."""
    step, is_converged = local.step(), True
    while is_converged and not local.is_converged(step):
        if (new_local := local.moved_towards(local.target_mean(step), work)) is None:
            is_converged = False
        else:
            local, step = new_local, new_local.step()
    root = local.root
    if not is_converged:
        root = lower_root(np.column_stack([root, step.x - local.prediction.x]))
    return Fit(Gaussian(step.x, root), local.prediction, local.new_agreement(), is_converged)


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
