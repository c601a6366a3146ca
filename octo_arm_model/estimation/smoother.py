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
from octo_arm_model.estimation.estimate import Estimate, next_estimate
from octo_arm_model.estimation.gaussian import Gaussian, lower_root, solve_lower, spread
from octo_arm_model.estimation.measurement import Measurement, Rows
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.posterior import gradient
from octo_arm_model.estimation.rules import Rules

MAX_RECORDED = 100_000  # largest number of times
_MOST_PASSES = 100
_TOLERANCE = 3e-2  # last step, in standard deviations per component
_LONGEST = 3.0  # longest step at any time, in standard deviations per component
_SHORTEST = 1e-3  # least fraction of a step
_HELD = 1e-3  # deviation at which a tension is held at zero, over that by all measurements
_PROGRESS = 0.1  # least shortening of the next step, as part of what a linear course has


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
    # A division by zero gives a step that is not finite, which is no progress.
    with np.errstate(all='ignore'):
        points, fraction = [step.prediction for step in steps], 1.0
        course, size = _course(steps, points)
        for _ in range(_MOST_PASSES):
            if size <= _TOLERANCE:
                return [
                    dataclasses.replace(
                        step, known=Gaussian(point.x, known.root), prediction=point
                    )
                    for step, point, known in zip(steps, points, course, strict=True)
                ]
            fraction = min(fraction, _LONGEST / size)
            moved = [
                Prediction(point.model, point.x + fraction * (known.mean - point.x), point.shape)
                for point, known in zip(points, course, strict=True)
            ]
            try:
                new_course, new_size = _course(steps, moved)
            except SolveError:
                if fraction < _SHORTEST:
                    raise
                new_size = math.inf
            if new_size <= (1.0 - _PROGRESS * fraction) * size:
                points, course, size = moved, new_course, new_size
                fraction = min(1.0, 2.0 * fraction)
            elif fraction < _SHORTEST:
                break
            else:
                fraction *= 0.5
    raise ConvergenceError('the smoother', size, _MOST_PASSES)


def _course(
    steps: Sequence[Estimate], points: Sequence[Prediction]
) -> tuple[list[Gaussian], float]:
    """Return the mean course by measurements that are linearised about ``points``.

    No tension is negative in it; its covariances do not know that. The second result is the
    largest step to it at any time, in standard deviations per component.
    """
    zero, tension = np.zeros(points[0].x.size), points[0].model.state.tension
    taut = np.full((len(steps), tension.stop), np.inf)
    known = _updated(steps, points, [zero] * len(steps), taut)
    slopes = [
        sum((_slope(step, rows, prediction, distribution) for rows in step.accepted), zero)
        for step, prediction, distribution in zip(steps, points, known, strict=True)
    ]
    # A tendon is slack if its tension is negative, be it free or held at zero by a stiff bound,
    # which it pushes against (primal-dual active set method; Hintermueller et al. 2003).
    deviation = np.array([_HELD * np.linalg.norm(one.root[tension], axis=1) for one in known])
    is_slack = np.array([prediction.x[tension] == 0.0 for prediction in points])
    for _ in range(_MOST_PASSES):
        course = _updated(steps, points, slopes, np.where(is_slack, deviation, taut))
        was_slack, is_slack = is_slack, np.array([one.mean[tension] < 0.0 for one in course])
        if (is_slack == was_slack).all():
            break
    for one in course:
        one.mean[tension] = np.maximum(0.0, one.mean[tension])
    course = [Gaussian(one.mean, each.root) for one, each in zip(course, known, strict=True)]
    sizes = [
        np.linalg.norm(solve_lower(distribution.root, distribution.mean - prediction.x))
        for prediction, distribution in zip(points, course, strict=True)
    ]
    for prediction in points:
        prediction.forget()
    return course, float(max(sizes)) / math.sqrt(zero.size)


def _updated(
    steps: Sequence[Estimate],
    points: Sequence[Prediction],
    slopes: Sequence[FloatArray],
    held: FloatArray,
) -> list[Gaussian]:
    """Return the states after all measurements, with ``slopes`` of ln(det A) / 2 at all times.

    Tensions are held at zero with the standard deviations ``held`` (times, tendons), if finite.
    """
    state = points[0].model.state
    filtered: list[Gaussian] = []
    known, last = state.prior, steps[0].time
    for step, prediction, slope, deviation in zip(steps, points, slopes, held, strict=True):
        known, last = state.later(known, step.time - last), step.time
        for rows in step.accepted:
            jacobian = rows.jacobian(prediction)
            innovation = rows.innovation(prediction) + jacobian @ (prediction.x - known.mean)
            columns = np.column_stack([innovation, jacobian @ known.root])
            known = _measured(known, solve_lower(rows.noise_root, columns))
        known = known._replace(mean=known.mean - known.root @ (known.root.T @ slope))
        if (number := np.flatnonzero(np.isfinite(deviation))).size:
            columns = np.column_stack([-known.mean[number], known.root[number]])
            known = _measured(known, columns / deviation[number, np.newaxis])
        filtered.append(known)
    smoothed, pairs = [known], list(itertools.pairwise(steps))
    for (step, following), before in zip(reversed(pairs), filtered[-2::-1], strict=True):
        elapsed = following.time - step.time
        decay, growth = state.decay(elapsed), state.growth(elapsed)
        predicted, after = state.later(before, elapsed), smoothed[-1]
        decayed = decay[:, np.newaxis] * before.root
        half = solve_lower(predicted.root, decayed @ before.root.T)
        back = solve_lower(predicted.root, half, is_transposed=True).T
        mean = before.mean + back @ (after.mean - predicted.mean)
        rest = before.root - back @ decayed
        root = lower_root(np.concatenate([rest, back * growth, back @ after.root], axis=1))
        smoothed.append(Gaussian(mean, root))
    return smoothed[::-1]


def _measured(known: Gaussian, white: FloatArray) -> Gaussian:
    """Return the state after innovations (m,), ``white`` beside their Jacobian times the root."""
    factor = spread(white[:, 1:])
    change = factor @ (factor.T @ (white[:, 1:].T @ white[:, 0]))
    return Gaussian(known.mean + known.root @ change, lower_root(known.root @ factor))


def _slope(step: Estimate, rows: Rows, prediction: Prediction, known: Gaussian) -> FloatArray:
    """Return the weighted gradient of ln(det A) / 2 by the state at one time, (n,)."""
    second = rows.second(prediction)
    if second is None:
        return np.zeros(prediction.x.size)
    white = solve_lower(rows.noise_root, rows.jacobian(prediction))
    gain = solve_lower(rows.noise_root, white @ known.root @ known.root.T, is_transposed=True)
    return step.bank.shift_weight * gradient(gain.T, second)
