"""The state that measurements and what was known before them agree on, by iteration.

An iterated extended Kalman filter: what measurements predict is taken to second order about the
last state that was evaluated, where they tell (`Measurement.second`), and the next one is what
this local model leads to. Each evaluation is one shape and its derivatives.

Measurements much more exact than what was known before leave a thin curved sheet of likely
states, whose densest point is off to one side of its mean, at every step to the same: a filter
that remembers would sum that up. The way from one to the other follows from the determinant of the
information A, grad(ln det A) / 2 (Laplace's approximation; Tierney and Kadane 1986). Innovations
draw the most probable state to where it is; where they are smaller than expected, as of an arm
that nothing touches, it is hardly drawn, and the way back is weighted with how they compare.
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

_TOLERANCE = 0.1  # standard deviations a component, of a step that is the last
# Likewise where what is measured hardly bends on it: parts of the noise, of values and spread.
_STRAIGHT, _OFF, _TURNED = 3.0, 0.1, 0.3
_LOOSE = 0.3  # likewise of what is blurred
_BLURRED = (100.0, 10.0)  # times the noise, one after the other
_INNER = 8  # steps within a local model
_SLACK = 0.01  # of what should be least, a component, by which a step may be worse
_SHORTENED = 6  # times that a step is halved at most
_LONGEST = 0.2  # of the length of the arm, by which a station moves in a step
_LARGEST = 5.0  # standard deviations by which one agreement may be off
_FARTHEST = 1.0  # standard deviations, to the mean: beyond, its second derivatives do not hold
_LATELY = 1000  # updates over which agreements are averaged


class Work:
    """What one message may cost: evaluations of shapes, and iterations of the solver for them."""

    def __init__(self, evaluations: int, iterations: int, whole: Work | None = None) -> None:
        """Of so many of both; what is taken of it is taken of the ``whole`` too."""
        self.evaluations, self.iterations, self._whole = evaluations, iterations, whole

    def share(self, evaluations: int) -> Work:
        """A part of it, of so many evaluations at most."""
        return Work(min(evaluations, self.evaluations), self.iterations, self)

    @property
    def is_left(self) -> bool:
        """Whether another shape may be evaluated."""
        return self.evaluations > 0 and self.iterations > 0

    def take(self, iterations: int) -> None:
        """Note an evaluation."""
        self.evaluations -= 1
        self.iterations -= iterations
        if self._whole is not None:
            self._whole.take(iterations)


class Agreement(NamedTuple):
    """How much innovations draw the most probable state, in parts of what is expected of them.

    Attributes:
        value: 1 on average where what was known before and noise are as told.
        information: inverse of its variance where they are; 0 of none.
    """

    value: float = 0.0
    information: float = 0.0

    @property
    def weight(self) -> float:
        """Weight of the way to the mean, 0 to 1: the value, were it 1 +- 1 before all of them."""
        if not self.information:
            return 0.0
        return min(max(0.0, (1.0 + self.information * self.value) / (1.0 + self.information)), 1.0)

    def after(self, drawn: float, expected: float, stddev: float) -> Agreement:
        """With one more innovation, which has ``drawn`` as much of what was ``expected``."""
        if not expected > 0.0 or not stddev > 0.0:
            return self
        off = min(max((drawn - expected) / stddev, -_LARGEST), _LARGEST)
        own = (expected / stddev) ** 2
        information = self.information * (1.0 - 1.0 / _LATELY) + own
        value = self.value + own / information * (1.0 + off * stddev / expected - self.value)
        return Agreement(value, information)


class Fit(NamedTuple):
    """What is known after measurements.

    Attributes:
        known: after them.
        at: a prediction nearly of its mean, about which they were linearised.
        agreement: how the innovations so far draw the most probable state.
        is_converged: whether the state is one to which the last step was short.
    """

    known: Gaussian
    at: Prediction
    agreement: Agreement
    is_converged: bool


def agree(
    before: Gaussian,
    rows: Rows,
    agreement: Agreement,
    at: Prediction,
    work: Work,
    *,
    is_new: bool = False,
) -> Fit:
    """The mean of what was known ``before`` and measured ``rows``, from the prediction ``at`` on.

    Where it ``is_new``, or no step leads on, measurements are taken to be less exact at first,
    which widens the curved valley of likely states. Where no work is left before it has converged,
    the last step is added to the covariance.

    Raises:
        SolveError: if there is no trustworthy shape on the way.
    """
    if not len(rows):
        mean = nearest_possible(at.model, before)
        at = reached(at, mean, work)
        return Fit(Gaussian(mean, before.root), at, agreement, is_converged=True)
    if 'solved' not in vars(at):
        work.take(int(at.solved.iterations))
    if not is_new:
        try:
            if _is_nearer(before, rows, at):
                at = reached(at, nearest_possible(at.model, before), work)
            found = _fit(_Local(before, rows, agreement, at), work)
            if found.is_converged or not work.is_left:
                return found
            at = found.at
        except SolveError:
            pass  # on the way from here
    for factor in _BLURRED:
        blurred = rows.blurred(factor)
        at = _fit(_Local(before, blurred, agreement, at), work, _LOOSE).at
    return _fit(_Local(before, rows, agreement, at), work)


def _is_nearer(before: Gaussian, rows: Rows, at: Prediction) -> bool:
    """Whether the mean of what was known ``before`` is far from ``at``, and explains ``rows``."""
    if at.distance(before.mean) <= _LONGEST * at.model.arm.length:
        return False
    left = rows.left(at)
    there = left - rows.jacobian(at) @ (before.mean - at.x)
    return square_of(there, rows.noise_root) < square_of(left, rows.noise_root)


def reached(at: Prediction, x: FloatArray, work: Work) -> Prediction:
    """The prediction of a state ``x``, followed from ``at``, or from nothing if that is too far.

    Raises:
        SolveError: if there is no trustworthy shape.
    """
    found = at.moved_to(x)
    try:
        work.take(int(found.solved.iterations))
    except ContinuationError as error:
        work.take(error.iterations)
        if at.shape is None:
            raise
        found = Prediction(at.model, x, None)
        work.take(int(found.solved.iterations))
    return found


class _Step(NamedTuple):
    """A step from a state to ``x``: its size a component, and what is least at its start."""

    x: FloatArray
    size: float
    cost: float


class _Local:
    """What measurements predict about a state to second order, in standard deviations."""

    def __init__(
        self,
        before: Gaussian,
        rows: Rows,
        agreement: Agreement,
        at: Prediction,
        left: FloatArray | None = None,
    ) -> None:
        self.before, self.rows, self.agreement, self.at = before, rows, agreement, at
        if left is None:
            left = rows.left(at)
        jacobian, second = rows.jacobian(at) @ before.root, rows.second(at)
        white = solve_lower(rows.noise_root, np.column_stack([left, jacobian]))
        self.z, self.left, self.jacobian = self._away(at.x), white[:, 0], white[:, 1:]
        self.spread, self.slope = spread(self.jacobian), np.zeros(len(before.root))
        self.root = before.root @ self.spread  # of the covariance after them
        # All second derivatives that are known, and the gradient of the determinant.
        self.bent: tuple[FloatArray, FloatArray] | None = None
        # A step by some of the second derivatives is no better than one by none.
        self.second: FloatArray | None = None
        if second is not None:
            scaled = solve_lower(rows.noise_root, second.reshape(len(left), -1))
            second = before.root.T @ scaled.reshape(second.shape) @ before.root
            self.bent = second, gradient(self._gain(), second)
            self.second = second if rows.is_bend_known(at) else None
            self.slope = agreement.weight * self.bent[1]
            far = float(np.linalg.norm(self.spread.T @ self.slope))
            self.slope *= min(1.0, _FARTHEST / far) if far else 1.0

    def _away(self, x: FloatArray) -> FloatArray:
        return solve_lower(self.before.root, x - self.before.mean)

    def _gain(self) -> FloatArray:
        return np.asarray(self.spread @ (self.jacobian @ self.spread).T)

    def step(self, x: FloatArray | None = None) -> _Step:
        """The step of Gauss and Newton to the mean, from ``x`` or the state itself."""
        z, left, jacobian, root = self.z, self.left, self.jacobian, self.spread
        if x is None:
            x = self.at.x
        elif self.second is not None:
            z = self._away(x)
            bent = self.second @ (z - self.z)
            left = left - (jacobian + 0.5 * bent) @ (z - self.z)
            jacobian = jacobian + bent
            root = spread(jacobian)
        change = root.T @ (jacobian.T @ left - z - self.slope)
        wanted = Gaussian(x + self.before.root @ (root @ change), self.root)
        size = math.sqrt(float(change @ change) / z.size)
        return _Step(nearest_possible(self.at.model, wanted), size, self._cost(z, left))

    def _cost(self, z: FloatArray, left: FloatArray) -> float:
        return float(z @ z + left @ left + 2.0 * (self.slope @ (z - self.z)))

    def wanted(self, step: _Step) -> FloatArray:
        """The mean, from a ``step`` on."""
        if self.second is None:
            return step.x
        start = self.at.x
        for _ in range(_INNER):
            if step.size <= 1.0:
                break
            for halved in range(5):
                x = start + 0.5**halved * (step.x - start)
                new = self.step(x)
                if new.cost <= step.cost:
                    break
            else:
                return x
            start, step = x, new
        return step.x

    def moved(self, wanted: FloatArray, work: Work) -> _Local | None:
        """As far towards the state ``wanted`` as makes one more probable; None if nowhere."""
        at, before = self.at, self._cost(self.z, self.left)
        part = min(1.0, _LONGEST * at.model.arm.length / max(at.distance(wanted), 1e-300))
        for _ in range(_SHORTENED):
            if not work.is_left:
                break
            new = at.moved_to(at.x + part * (wanted - at.x))
            try:
                left = self.rows.left(new)
                work.take(int(new.solved.iterations))
                cost = self._cost(self._away(new.x), solve_lower(self.rows.noise_root, left))
                if cost <= before + _SLACK * wanted.size:
                    return _Local(self.before, self.rows, self.agreement, new, left)
            except SolveError as error:
                work.take(error.iterations if isinstance(error, ConvergenceError) else 1)
            part *= 0.5
        return None

    def is_last(self, step: _Step, tolerance: float) -> bool:
        """Whether a ``step`` is short, or leads where little bends on the way."""
        if step.size <= tolerance:
            return True
        is_straight = self.at.model.state.is_geometric and step.size <= _STRAIGHT
        if self.second is None or not is_straight:
            return False
        change = self._away(step.x) - self.z
        bent = self.second @ change
        off = 0.5 * float(np.linalg.norm(bent @ change))
        return off <= _OFF and float(np.linalg.norm(bent @ self.spread)) <= _TURNED

    def agreed(self) -> Agreement:
        """The agreement with what these measurements brought."""
        if self.bent is None:
            return self.agreement
        second, slope = self.bent
        root = lower_root(np.column_stack([self.jacobian, np.eye(len(self.left))]))
        white = solve_lower(root, self.left + self.jacobian @ self.z)
        shift = self.spread.T @ slope
        # What it draws is a quadratic form of the innovation, whitened: of variance 2 |form|^2.
        form = solve_lower(root, (second @ (self.spread @ shift)) @ self._gain() @ root)
        form = 0.5 * (form + form.T)
        stddev = math.sqrt(2.0) * float(np.linalg.norm(form))
        return self.agreement.after(float(white @ form @ white), float(shift @ shift), stddev)


def _fit(local: _Local, work: Work, tolerance: float = _TOLERANCE) -> Fit:
    """The mean, from a ``local`` model on; SolveError if there is no trustworthy shape there."""
    step, is_converged = local.step(), True
    while is_converged and not local.is_last(step, tolerance):
        if (moved := local.moved(local.wanted(step), work)) is None:
            is_converged = False
        else:
            local, step = moved, moved.step()
    root = local.root
    if not is_converged:
        root = lower_root(np.column_stack([root, step.x - local.at.x]))
    return Fit(Gaussian(step.x, root), local.at, local.agreed(), is_converged)


def gradient(gain: FloatArray, second: FloatArray) -> FloatArray:
    """Gradient of ln(det A) / 2 by the state, (n,), for a ``gain`` (n, m): tr(P+ J' R^-1 dJ)."""
    return np.asarray(gain.T.ravel() @ second.reshape(gain.size, -1))


def nearest_possible(model: ArmModel, known: Gaussian) -> FloatArray:
    """The likeliest state of tensions >= 0 of what is ``known``, (n,)."""
    tension, found = model.state.tension, known.mean
    slack = np.zeros(found.size, dtype=bool)
    while (found[tension] < 0.0).any():
        slack[tension] |= found[tension] < 0.0
        change = np.linalg.lstsq(known.root[slack], -known.mean[slack], rcond=None)[0]
        found = known.mean + known.root @ change
        found[slack] = 0.0
    return found
