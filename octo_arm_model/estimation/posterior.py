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
from octo_arm_model.estimation.gaussian import (
    Gain,
    Gaussian,
    gain,
    lower_root,
    solve_lower,
    square_of,
)
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


class _Local(NamedTuple):
    """What measurements predict about a state to second order, in standard deviations.

    ``bent`` are the second derivatives that are known, and the gradient of the determinant.
    """

    at: Prediction
    by: Gain
    z: FloatArray
    left: FloatArray
    jacobian: FloatArray
    second: FloatArray | None
    slope: FloatArray
    bent: tuple[FloatArray, FloatArray] | None


class _Step(NamedTuple):
    """A step from a state to ``x``: its size a component, and what is least at its start."""

    x: FloatArray
    size: float
    cost: float


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
    if not is_new:
        try:
            if _is_nearer(before, rows, at):
                at = reached(at, nearest_possible(at.model, before), work)
            found = Posterior(before, rows, agreement).fit(at, work)
            if found.is_converged or not work.is_left:
                return found
            at = found.at
        except SolveError:
            pass  # on the way from here
    for factor in _BLURRED:
        at = Posterior(before, rows.blurred(factor), agreement).fit(at, work, _LOOSE).at
    return Posterior(before, rows, agreement).fit(at, work)


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


class Posterior:
    """What is known after measurements, of what was known before."""

    def __init__(self, before: Gaussian, rows: Rows, agreement: Agreement) -> None:
        """Of what was known ``before`` and measured ``rows``."""
        self._before, self._rows, self._agreement = before, rows, agreement

    def fit(self, at: Prediction, work: Work, tolerance: float = _TOLERANCE) -> Fit:
        """The mean, from the prediction ``at`` on, as `agree`.

        Raises:
            SolveError: if there is no trustworthy shape on the way.
        """
        if 'solved' not in vars(at):
            work.take(int(at.solved.iterations))
        local = self._local(at, self._rows.left(at))
        step = self._step(local, at.x)
        while not self._is_last(local, step, tolerance):
            found = self._moved(local, self._wanted(local, step), work)
            if found is None:
                return self._concluded(local, step, is_converged=False)
            local = self._local(*found)
            step = self._step(local, local.at.x)
        return self._concluded(local, step, is_converged=True)

    def _away(self, x: FloatArray) -> FloatArray:
        return solve_lower(self._before.root, x - self._before.mean)

    def _local(self, at: Prediction, left: FloatArray) -> _Local:
        rows, root = self._rows, self._before.root
        jacobian, second = rows.jacobian(at), rows.second(at)
        by = gain(root, jacobian, rows.noise_root)
        white = solve_lower(rows.noise_root, np.column_stack([left, jacobian @ root]))
        slope, bent = np.zeros(len(root)), None
        if second is not None:
            bent = second, gradient(by.gain, second)
            if self._agreement.weight:
                slope = self._agreement.weight * (bent[1] @ root)
                away = float(np.linalg.norm(solve_lower(root, by.root).T @ slope))
                slope *= min(1.0, _FARTHEST / away) if away else 1.0
            # A step by some of the second derivatives is no better than one by none.
            if rows.is_bend_known(at):
                scaled = solve_lower(rows.noise_root, second.reshape(len(left), -1))
                second = root.T @ scaled.reshape(second.shape) @ root
            else:
                second = None
        return _Local(at, by, self._away(at.x), white[:, 0], white[:, 1:], second, slope, bent)

    def _step(self, local: _Local, x: FloatArray) -> _Step:
        """The step of Gauss and Newton from ``x`` to the mean by a ``local`` model."""
        z, left, jacobian = local.z, local.left, local.jacobian
        n = z.size
        if x is not local.at.x and local.second is not None:
            z = self._away(x)
            bent = local.second @ (z - local.z)
            left = left - (jacobian + 0.5 * bent) @ (z - local.z)
            jacobian = jacobian + bent
        root = lower_root(np.concatenate([jacobian.T, np.eye(n)], axis=1))
        change = solve_lower(root, jacobian.T @ left - z - local.slope)
        wanted = x + self._before.root @ solve_lower(root, change, is_transposed=True)
        size = math.sqrt(float(change @ change) / n)
        cost = float(z @ z + left @ left + 2.0 * (local.slope @ (z - local.z)))
        return _Step(nearest_possible(local.at.model, Gaussian(wanted, local.by.root)), size, cost)

    def _wanted(self, local: _Local, step: _Step) -> FloatArray:
        """The mean by a ``local`` model, from a ``step`` on."""
        if local.second is None:
            return step.x
        start = local.at.x
        for _ in range(_INNER):
            if step.size <= 1.0:
                break
            for halved in range(5):
                x = start + 0.5**halved * (step.x - start)
                new = self._step(local, x)
                if new.cost <= step.cost:
                    break
            else:
                return x
            start, step = x, new
        return step.x

    def _moved(
        self, local: _Local, wanted: FloatArray, work: Work
    ) -> tuple[Prediction, FloatArray] | None:
        """As far towards the state ``wanted`` as makes one more probable; None if nowhere."""
        at, before = local.at, float(local.z @ local.z + local.left @ local.left)
        part = min(1.0, _LONGEST * at.model.arm.length / max(at.distance(wanted), 1e-300))
        for _ in range(_SHORTENED):
            if not work.is_left:
                break
            new = at.moved_to(at.x + part * (wanted - at.x))
            try:
                left = self._rows.left(new)
                work.take(int(new.solved.iterations))
                z, white = self._away(new.x), solve_lower(self._rows.noise_root, left)
                cost = float(z @ z + white @ white + 2.0 * (local.slope @ (z - local.z)))
                if cost <= before + _SLACK * wanted.size:
                    return new, left
            except SolveError as error:
                work.take(error.iterations if isinstance(error, ConvergenceError) else 1)
            part *= 0.5
        return None

    def _is_last(self, local: _Local, step: _Step, tolerance: float) -> bool:
        if step.size <= tolerance:
            return True
        is_straight = local.at.model.state.is_geometric and step.size <= _STRAIGHT
        if local.second is None or not is_straight:
            return False
        change = self._away(step.x) - local.z
        bent = local.second @ change
        turned = bent @ solve_lower(self._before.root, local.by.root)
        off = 0.5 * float(np.linalg.norm(bent @ change))
        return off <= _OFF and float(np.linalg.norm(turned)) <= _TURNED

    def _concluded(self, local: _Local, step: _Step, *, is_converged: bool) -> Fit:
        root, at = local.by.root, local.at
        if not is_converged:
            root = lower_root(np.column_stack([root, step.x - at.x]))
        return Fit(Gaussian(step.x, root), at, self._agreed(local), is_converged)

    def _agreed(self, local: _Local) -> Agreement:
        if local.bent is None:
            return self._agreement
        by, at, (second, slope) = local.by, local.at, local.bent
        innovation = self._rows.left(at) + self._rows.jacobian(at) @ (at.x - self._before.mean)
        white, shift = solve_lower(by.innovation_root, innovation), by.root.T @ slope
        # What it draws is a quadratic form of the innovation, whitened: of variance 2 |form|^2.
        form = solve_lower(
            by.innovation_root, (second @ (by.root @ shift)) @ by.gain @ by.innovation_root
        )
        form = 0.5 * (form + form.T)
        stddev = math.sqrt(2.0) * float(np.linalg.norm(form))
        return self._agreement.after(float(white @ form @ white), float(shift @ shift), stddev)


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
