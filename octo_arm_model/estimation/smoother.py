"""The batch estimator: a whole recording at once, each time with what came before and after.

Gauss-Newton iteration over the course of the state, each step by the forward and backward
recursions of Rauch, Tung and Striebel (iterated extended Kalman smoother, Bell 1994). It begins
from the recursive estimator, whose refusals stand. As there the mean is looked for and not the
most probable course, where measurements tell their second derivatives; see `posterior`.
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

MAX_RECORDED = 100_000  # times
_MOST = 100  # passes
_TOLERANCE = 3e-2  # standard deviations a component, of a step that is the last
_LONGEST = 3.0  # standard deviations a component, of a step at any time
_SHORTEST = 1e-3  # part of a step
# Second derivatives of a course nearby lead not quite where the cost is least: so near to the mean
# course, in standard deviations a component, this part of the way left is progress all the same.
_NEAR, _PROGRESS = 0.3, 0.95
_SLACK = 1e-3  # of a cost that is in squares of standard deviations, for rounding


def smooth(
    model: ArmModel,
    recording: Iterable[tuple[float, Sequence[Measurement]]],
    rules: Rules = Rules(),
    progress: Callable[[int], None] = lambda count: None,
) -> list[Estimate]:
    """Estimates of ``model`` at all times of a ``recording``, each from the whole of it.

    Args:
        model: the arm.
        recording: times [s] in ascending order and what was measured then.
        rules: of what is believed.
        progress: called with how many times the filter has done.

    Raises:
        MeasurementError: if the times are not in order or too many, or a measurement does not
            fit the arm.
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
    """
    check_class('model', model, ArmModel)
    steps: list[Estimate] = []
    for time, measurements in recording:
        before = steps[-1].time if steps else -math.inf
        if not before <= time < math.inf:
            raise MeasurementError(f'time {time} s comes after {before} s, expected them in order')
        check_count(len(steps) + 1)
        last = steps[-1] if steps else None
        steps.append(next_estimate(model, last, time, tuple(measurements), rules))
        steps[-1].at.forget()
        progress(len(steps))
    return smooth_steps(steps)


def check_count(times: int) -> None:
    """Check that so many ``times`` are no more than are smoothed together.

    Raises:
        MeasurementError: if they are.
    """
    if times > MAX_RECORDED:
        raise MeasurementError(f'more than {MAX_RECORDED} times, which is the most')


def smooth_steps(steps: Sequence[Estimate]) -> list[Estimate]:
    """Estimates at all ``steps`` of a filter, each from what all of them accepted.

    Raises:
        SolveError: as `smooth`.
    """
    if not steps:
        return []
    # What is divided by zero is not finite, and no course leads there.
    with np.errstate(all='ignore'):
        about = _Pass(steps, [step.at for step in steps])
        for _ in range(_MOST):
            if about.size <= _TOLERANCE:
                return [
                    dataclasses.replace(step, known=Gaussian(at.x, known.root), at=at)
                    for step, at, known in zip(steps, about.points, about.course, strict=True)
                ]
            about = about.next()
    raise ConvergenceError('the smoother', about.size, _MOST)


class _Pass:
    """Measurements linearised about ``points``, and the course that follows.

    Attributes:
        points: predictions of the states about which they are.
        course: mean course by this linearisation.
        size: of the longest way to it, in standard deviations a component.
        cost: what is least along the mean course, in squares of standard deviations.
    """

    def __init__(self, steps: Sequence[Estimate], points: Sequence[Prediction]) -> None:
        self._steps, self.points, self._state = steps, points, points[0].model.state
        none = [np.zeros(self._state.size)] * len(steps)
        filtered, volume = self._forward(none)
        known = self._smoothed(filtered)
        slopes = [
            sum((_slope(step, rows, at, one) for rows in step.accepted), none[0])
            for step, at, one in zip(steps, points, known, strict=True)
        ]
        self.course = self._smoothed(self._forward(slopes)[0])
        self.size = max(
            float(np.linalg.norm(solve_lower(one.root, one.mean - at.x)))
            for at, one in zip(points, self.course, strict=True)
        ) / np.sqrt(self._state.size)
        self.cost = volume + self._improbability()
        for at in points:
            at.forget()

    def next(self) -> _Pass:
        """As far towards the course as makes one more probable; SolveError if there is none."""
        part = min(1.0, _LONGEST / self.size)
        while True:
            points = [
                Prediction(at.model, at.x + part * (one.mean - at.x), at.shape)
                for at, one in zip(self.points, self.course, strict=True)
            ]
            try:
                new = _Pass(self._steps, points)
                if new.cost <= self.cost + _SLACK or new.size <= _PROGRESS * self.size <= _NEAR:
                    return new
            except SolveError:
                if part < _SHORTEST:
                    raise
            if part < _SHORTEST:
                raise ConvergenceError('the smoother', self.size, _MOST)
            part *= 0.5

    def _improbability(self) -> float:
        """Sum of squares of all changes of the state and all noise, in standard deviations."""
        steps, points, state = self._steps, self.points, self._state
        total = square_of(points[0].x, state.prior.root)
        for (step, at), (following, after) in itertools.pairwise(zip(steps, points)):
            elapsed = following.time - step.time
            growth = state.growth(elapsed)
            changes = growth > 0.0
            change = (after.x - state.decay(elapsed) * at.x)[changes] / growth[changes]
            total += float(change @ change)
        for step, at in zip(steps, points):
            total += sum(square_of(rows.left(at), rows.noise_root) for rows in step.accepted)
        return total

    def _forward(self, slopes: Sequence[FloatArray]) -> tuple[list[Gaussian], float]:
        """The filter, and ln(det A) but a constant; that of its half has ``slopes``."""
        found: list[Gaussian] = []
        volume, known, last = 0.0, self._state.prior, self._steps[0].time
        for step, at, slope in zip(self._steps, self.points, slopes):
            known, last = self._state.later(known, step.time - last), step.time
            for rows in step.accepted:
                jacobian = rows.jacobian(at)
                left = rows.left(at) + jacobian @ (at.x - known.mean)
                told = np.column_stack([left, jacobian @ known.root])
                white = solve_lower(rows.noise_root, told)
                after = spread(white[:, 1:])
                change = after @ (after.T @ (white[:, 1:].T @ white[:, 0]))
                mean = known.mean + known.root @ change
                known = Gaussian(mean, lower_root(known.root @ after))
                if rows.second(at) is not None:
                    volumes = -2.0 * np.log(np.abs(after.diagonal()))
                    volume += step.bank.agreement.weight * float(volumes.sum())
            known = known._replace(mean=known.mean - known.root @ (known.root.T @ slope))
            found.append(known)
        return found, volume

    def _smoothed(self, filtered: Sequence[Gaussian]) -> list[Gaussian]:
        """``filtered`` distributions, each with what came later."""
        smoothed, pairs = [filtered[-1]], list(itertools.pairwise(self._steps))
        for (step, following), known in zip(reversed(pairs), filtered[-2::-1], strict=True):
            elapsed = following.time - step.time
            decay, growth = self._state.decay(elapsed), self._state.growth(elapsed)
            predicted, after = self._state.later(known, elapsed), smoothed[-1]
            decayed = decay[:, np.newaxis] * known.root
            half = solve_lower(predicted.root, decayed @ known.root.T)
            back = solve_lower(predicted.root, half, is_transposed=True).T
            mean = known.mean + back @ (after.mean - predicted.mean)
            kept = known.root - back @ decayed
            root = lower_root(np.concatenate([kept, back * growth, back @ after.root], axis=1))
            smoothed.append(Gaussian(mean, root))
        model = self.points[0].model
        return [one._replace(mean=nearest_possible(model, one)) for one in reversed(smoothed)]


def _slope(step: Estimate, rows: Rows, at: Prediction, known: Gaussian) -> FloatArray:
    """Gradient of ln(det A) / 2 by the state at one time, (n,), with its weight."""
    second = rows.second(at)
    if second is None:
        return np.zeros(at.x.size)
    white = solve_lower(rows.noise_root, rows.jacobian(at))
    own = solve_lower(rows.noise_root, white @ known.root @ known.root.T, is_transposed=True)
    return step.bank.agreement.weight * gradient(own.T, second)
