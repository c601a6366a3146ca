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
from octo_arm_model.estimation.gaussian import (
    Gaussian,
    gain,
    lower_root,
    solve_lower,
    square_of,
    volume_of,
)
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
    return smooth_steps(model, steps)


def check_count(times: int) -> None:
    """Check that so many ``times`` are no more than are smoothed together.

    Raises:
        MeasurementError: if they are.
    """
    if times > MAX_RECORDED:
        raise MeasurementError(f'more than {MAX_RECORDED} times, which is the most')


def smooth_steps(model: ArmModel, steps: Sequence[Estimate]) -> list[Estimate]:
    """Estimates at all ``steps`` of a filter of ``model``, each from what all of them accepted.

    Raises:
        SolveError: as `smooth`.
    """
    if not steps:
        return []
    # What is divided by zero is not finite, and no course leads there.
    with np.errstate(all='ignore'):
        about = _Pass(model, steps, [step.at for step in steps])
        for _ in range(_MOST):
            if about.size <= _TOLERANCE:
                return [
                    dataclasses.replace(step, known=Gaussian(at.x, known.root), at=at)
                    for step, at, known in zip(steps, about.points, about.course, strict=True)
                ]
            about = _next(model, steps, about)
    raise ConvergenceError('the smoother', about.size, _MOST)


class _Pass:
    """Measurements linearised about ``points``, and the course that follows.

    Attributes:
        points: predictions of the states about which they are.
        course: mean course by this linearisation.
        size: of the longest way to it, in standard deviations a component.
        cost: what is least along the mean course, in squares of standard deviations.
    """

    def __init__(
        self, model: ArmModel, steps: Sequence[Estimate], points: Sequence[Prediction]
    ) -> None:
        self.points, none = points, [np.zeros(model.state.size)] * len(steps)
        filtered, volume = _forward(model, steps, points, none)
        known = _smoothed(model, steps, filtered)
        slopes = [
            sum((_slope(step, rows, at, one) for rows in step.accepted), none[0])
            for step, at, one in zip(steps, points, known, strict=True)
        ]
        self.course = _smoothed(model, steps, _forward(model, steps, points, slopes)[0])
        self.size = max(
            float(np.linalg.norm(solve_lower(one.root, one.mean - at.x)))
            for at, one in zip(points, self.course, strict=True)
        ) / np.sqrt(model.state.size)
        self.cost = volume + _improbability(model, steps, points)
        for at in points:
            at.forget()


def _slope(step: Estimate, rows: Rows, at: Prediction, known: Gaussian) -> FloatArray:
    """Gradient of ln(det A) / 2 by the state at one time, (n,), with its weight."""
    second = rows.second(at)
    if second is None:
        return np.zeros(at.x.size)
    white = solve_lower(rows.noise_root, rows.jacobian(at))
    own = solve_lower(rows.noise_root, white @ known.root @ known.root.T, is_transposed=True)
    return step.bank.agreement.weight * gradient(own.T, second)


def _next(model: ArmModel, steps: Sequence[Estimate], last: _Pass) -> _Pass:
    """As far towards the course of the ``last`` pass as makes one more probable.

    Raises:
        SolveError: if there is none.
    """
    part = min(1.0, _LONGEST / last.size)
    while True:
        points = [
            Prediction(model, at.x + part * (one.mean - at.x), at.shape)
            for at, one in zip(last.points, last.course, strict=True)
        ]
        try:
            found = _Pass(model, steps, points)
            if found.cost <= last.cost + _SLACK or found.size <= _PROGRESS * last.size <= _NEAR:
                return found
        except SolveError:
            if part < _SHORTEST:
                raise
        if part < _SHORTEST:
            raise ConvergenceError('the smoother', last.size, _MOST)
        part *= 0.5


def _improbability(
    model: ArmModel, steps: Sequence[Estimate], points: Sequence[Prediction]
) -> float:
    """Sum of squares of all changes of the state and all noise, in standard deviations."""
    total = square_of(points[0].x, model.state.prior.root)
    for (step, at), (following, after) in itertools.pairwise(zip(steps, points, strict=True)):
        elapsed = following.time - step.time
        growth = model.state.growth(elapsed)
        changes = growth > 0.0
        change = (after.x - model.state.decay(elapsed) * at.x)[changes] / growth[changes]
        total += float(change @ change)
    for step, at in zip(steps, points, strict=True):
        total += sum(square_of(rows.left(at), rows.noise_root) for rows in step.accepted)
    return total


def _forward(
    model: ArmModel,
    steps: Sequence[Estimate],
    points: Sequence[Prediction],
    slopes: Sequence[FloatArray],
) -> tuple[list[Gaussian], float]:
    """The filter with measurements linearised about ``points``, and ln(det A) but a constant.

    ``slopes`` are those of its half, see `_slope`; every step of it has its weight.
    """
    found: list[Gaussian] = []
    volume = 0.0
    for number, (step, at, slope) in enumerate(zip(steps, points, slopes, strict=True)):
        known = model.state.prior
        if number:
            known = model.state.later(found[-1], step.time - steps[number - 1].time)
        for rows in step.accepted:
            jacobian = rows.jacobian(at)
            by = gain(known.root, jacobian, rows.noise_root)
            left = rows.left(at) + jacobian @ (at.x - known.mean)
            known = Gaussian(known.mean + by.gain @ left, by.root)
            if rows.second(at) is not None:
                volume += step.bank.agreement.weight * volume_of(by.innovation_root)
        found.append(known._replace(mean=known.mean - known.root @ (known.root.T @ slope)))
    return found, volume


def _smoothed(
    model: ArmModel, steps: Sequence[Estimate], filtered: list[Gaussian]
) -> list[Gaussian]:
    """``filtered`` distributions, each with what came later."""
    smoothed = [filtered[-1]]
    for (step, following), known in zip(
        reversed(list(itertools.pairwise(steps))), filtered[-2::-1], strict=True
    ):
        elapsed = following.time - step.time
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        predicted, after = model.state.later(known, elapsed), smoothed[-1]
        across = (decay[:, np.newaxis] * known.root) @ known.root.T
        half = solve_lower(predicted.root, across)
        back = solve_lower(predicted.root, half, is_transposed=True).T
        mean = known.mean + back @ (after.mean - predicted.mean)
        kept = known.root - back @ (decay[:, np.newaxis] * known.root)
        root = lower_root(np.concatenate([kept, back * growth, back @ after.root], axis=1))
        smoothed.append(Gaussian(mean, root))
    return [one._replace(mean=nearest_possible(model, one)) for one in reversed(smoothed)]
