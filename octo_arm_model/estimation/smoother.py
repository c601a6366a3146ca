"""The batch estimator: every time of a recording is estimated from all of its measurements.

It is a Gauss-Newton iteration for the course of the state. Each step takes the forward and
backward recursions of Rauch, Tung and Striebel (iterated extended Kalman smoother, Bell 1994).
The iteration begins at the recursive estimates, and leaves out the measurements that these refuse.
If measurements state second derivatives it finds the mean course, not the mode; see `posterior`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError, MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import check_class
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.gaussian import Gaussian, lower_root, solve_lower, spread, square_of
from octo_arm_model.estimation.measurement import Measurement, Rows
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.posterior import gradient, nearest_possible
from octo_arm_model.estimation.rules import Rules
from octo_arm_model.estimation.step import next_estimate

MAX_RECORDED = 100_000  # largest number of times
_MOST_PASSES = 100
_TOLERANCE = 3e-2  # last step, in standard deviations per component
_LONGEST = 3.0  # longest step at any time, in standard deviations per component
_SHORTEST = 1e-3  # least fraction of a step
# Second derivatives of a course nearby lead not exactly to the least cost. So near to the mean
# course, in standard deviations per component, steps that shorten by this factor are progress too.
_NEAR, _PROGRESS = 0.3, 0.95
_ZERO = 1e-4  # change of a constant that is rounding, in standard deviations
_SLACK = 1e-3  # allowed rise of the cost by rounding, in squares of standard deviations


def smooth(
    model: ArmModel,
    recording: Iterable[tuple[float, Sequence[Measurement]]],
    rules: Rules = Rules(),
    progress: Callable[[int], None] = lambda count: None,
) -> list[Estimate]:
    """Return the estimates at all times of a ``recording``, each from the whole of it.

    Args:
        model: the model of the arm.
        recording: times [s] in ascending order, and the measurements at each.
        rules: the assumptions about sensors.
        progress: is called with the number of times that the filter has processed.

    Raises:
        MeasurementError: if the times are not in order or too many, or a measurement does not
            fit the arm.
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
    """
    check_class('model', model, ArmModel)
    steps: list[Estimate] = []
    for time, measurements in recording:
        start = steps[-1].time if steps else -math.inf
        if not start <= time < math.inf:
            raise MeasurementError(f'time {time} s comes after {start} s, expected them in order')
        check_count(len(steps) + 1)
        previous = steps[-1] if steps else None
        steps.append(next_estimate(model, previous, time, tuple(measurements), rules))
        steps[-1].prediction.forget()
        progress(len(steps))
    return smooth_steps(steps)


def check_count(times: int) -> None:
    """Check the number of ``times`` to smooth together.

    Raises:
        MeasurementError: if it is larger than `MAX_RECORDED`.
    """
    if times > MAX_RECORDED:
        raise MeasurementError(f'more than {MAX_RECORDED} times, which is the most')


def smooth_steps(steps: Sequence[Estimate]) -> list[Estimate]:
    """Return the estimates at all ``steps`` of a filter, each from all accepted measurements.

    Where the filter began anew the smoother does too, as earlier measurements belong to another
    state.

    Raises:
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
    """
    parts = itertools.groupby(steps, key=lambda step: step.first)
    return [estimate for _, part in parts for estimate in _smooth_part(list(part))]


def _smooth_part(steps: Sequence[Estimate]) -> list[Estimate]:
    """Return the estimates at ``steps`` that have one prior."""
    # A division by zero gives a cost that is not finite, which no step accepts.
    with np.errstate(all='ignore'):
        current = _Pass(steps, [step.prediction for step in steps])
        for _ in range(_MOST_PASSES):
            if current.size <= _TOLERANCE:
                return [
                    dataclasses.replace(step, known=Gaussian(point.x, new.root), prediction=point)
                    for step, point, new in zip(steps, current.points, current.course, strict=True)
                ]
            current = current.next()
    raise ConvergenceError('the smoother', current.size, _MOST_PASSES)


class _Pass:
    """One pass of the smoother, whose measurements are linearised about ``points``.

    Attributes:
        points: predictions of the states of linearisation.
        course: mean course by this linearisation.
        size: largest step to the course at any time, in standard deviations per component.
        cost: cost of the points, which the mean course minimises [squared deviations].
    """

    def __init__(self, steps: Sequence[Estimate], points: Sequence[Prediction]) -> None:
        self._steps, self.points, self._state = steps, points, points[0].model.state
        zeros = [np.zeros(self._state.size)] * len(steps)
        filtered, volume = self._forward(zeros)
        known = self._smoothed(filtered)
        slopes = [
            sum((_slope(step, rows, prediction, distribution) for rows in step.accepted), zeros[0])
            for step, prediction, distribution in zip(steps, points, known, strict=True)
        ]
        self.course = self._smoothed(self._forward(slopes)[0])
        self.size = max(
            float(np.linalg.norm(solve_lower(distribution.root, distribution.mean - prediction.x)))
            for prediction, distribution in zip(points, self.course, strict=True)
        ) / np.sqrt(self._state.size)
        self.cost = volume + self._improbability()
        for prediction in points:
            prediction.forget()

    def next(self) -> _Pass:
        """Return the pass at a more probable course; raise SolveError if there is none."""
        fraction = min(1.0, _LONGEST / self.size)
        while True:
            points = [
                Prediction(point.model, point.x + fraction * (known.mean - point.x), point.shape)
                for point, known in zip(self.points, self.course, strict=True)
            ]
            try:
                new = _Pass(self._steps, points)
                if new.cost <= self.cost + _SLACK or new.size <= _PROGRESS * self.size <= _NEAR:
                    return new
            except SolveError:
                if fraction < _SHORTEST:
                    raise
            if fraction < _SHORTEST:
                raise ConvergenceError('the smoother', self.size, _MOST_PASSES)
            fraction *= 0.5

    def _improbability(self) -> float:
        """Return the squares of changes and noise; infinite if a constant has several values."""
        total, state = square_of(self.points[0].x, self._state.prior.root), self._state
        pairs = itertools.pairwise(zip(self._steps, self.points, self.course))
        for (step, point, known), (following, after, _) in pairs:
            growth, decay = (f(following.time - step.time) for f in (state.growth, state.decay))
            change, moves = after.x - decay * point.x, growth > 0.0
            if (np.abs(change) > _ZERO * np.linalg.norm(known.root, axis=1))[~moves].any():
                return math.inf
            total += float(((change[moves] / growth[moves]) ** 2).sum())
        for step, point in zip(self._steps, self.points):
            for rows in step.accepted:
                total += square_of(rows.innovation(point), rows.noise_root)
        return total

    def _forward(self, slopes: Sequence[FloatArray]) -> tuple[list[Gaussian], float]:
        """Return the filtered states, and ln(det A) less a constant; half of it has ``slopes``."""
        filtered: list[Gaussian] = []
        volume, known, last = 0.0, self._state.prior, self._steps[0].time
        for step, prediction, slope in zip(self._steps, self.points, slopes):
            known, last = self._state.later(known, step.time - last), step.time
            for rows in step.accepted:
                jacobian = rows.jacobian(prediction)
                innovation = rows.innovation(prediction) + jacobian @ (prediction.x - known.mean)
                columns = np.column_stack([innovation, jacobian @ known.root])
                white = solve_lower(rows.noise_root, columns)
                factor = spread(white[:, 1:])
                change = factor @ (factor.T @ (white[:, 1:].T @ white[:, 0]))
                known = Gaussian(known.mean + known.root @ change, lower_root(known.root @ factor))
                if rows.second(prediction) is not None:
                    volumes = -2.0 * np.log(np.abs(factor.diagonal()))
                    volume += step.bank.agreement.weight * float(volumes.sum())
            known = known._replace(mean=known.mean - known.root @ (known.root.T @ slope))
            filtered.append(known)
        return filtered, volume

    def _smoothed(self, filtered: Sequence[Gaussian]) -> list[Gaussian]:
        """Return the ``filtered`` distributions updated by the measurements after each."""
        smoothed, pairs = [filtered[-1]], list(itertools.pairwise(self._steps))
        for (step, following), state in zip(reversed(pairs), filtered[-2::-1], strict=True):
            elapsed = following.time - step.time
            decay, growth = self._state.decay(elapsed), self._state.growth(elapsed)
            predicted, after = self._state.later(state, elapsed), smoothed[-1]
            decayed = decay[:, np.newaxis] * state.root
            half = solve_lower(predicted.root, decayed @ state.root.T)
            back = solve_lower(predicted.root, half, is_transposed=True).T
            mean = state.mean + back @ (after.mean - predicted.mean)
            rest = state.root - back @ decayed
            root = lower_root(np.concatenate([rest, back * growth, back @ after.root], axis=1))
            smoothed.append(Gaussian(mean, root))
        model, varies = self.points[0].model, self._state.growth(1.0) > 0.0
        varies[self._state.tension] = True
        return [
            state._replace(mean=np.where(varies, nearest_possible(model, state), state.mean))
            for state in reversed(smoothed)
        ]


def _slope(step: Estimate, rows: Rows, prediction: Prediction, known: Gaussian) -> FloatArray:
    """Return the weighted gradient of ln(det A) / 2 by the state at one time, (n,)."""
    second = rows.second(prediction)
    if second is None:
        return np.zeros(prediction.x.size)
    white = solve_lower(rows.noise_root, rows.jacobian(prediction))
    gain = solve_lower(rows.noise_root, white @ known.root @ known.root.T, is_transposed=True)
    return step.bank.agreement.weight * gradient(gain.T, second)
