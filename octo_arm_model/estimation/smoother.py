"""The batch estimator: the mean course of the state over a recording.

Gauss-Newton iteration on all times at once: each pass is a linear filter forward and a smoother
backward (Rauch, Tung and Striebel) about the last course, the iterated extended Kalman smoother
of Bell 1994. It begins from the recursive filter, whose refusals stand. Second derivatives lead
to the mean and not to the most probable course, see `posterior_mean`; they are those of the last
course, or of one nearby.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError, MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import (
    Belief,
    gain,
    log_determinant,
    lower_root,
    normalised_square,
    solve_lower,
)
from octo_arm_model.estimation.beliefs.posterior import nearest_possible
from octo_arm_model.estimation.course_curvature import Bent, bent_at, gradient_at, weight_of
from octo_arm_model.estimation.estimate import Estimate, estimate_of
from octo_arm_model.estimation.filter import GATE, Step, next_step, predict, prior
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
)
from octo_arm_model.estimation.state.prediction import ArmModel, Prediction

MAX_RECORDED = 100_000  # times
_MOST = 100  # passes
_TOLERANCE = 3e-2  # standard deviations a component, of a step that is the last
_LONGEST = 3.0  # standard deviations a component, of a step at any time
_SHORTEST = 1e-3  # part of a step
# Second derivatives of a course nearby lead not quite where the cost is least: so near to the mean
# course, in standard deviations a component, this part of the way left is progress all the same.
_NEAR = 0.3
_PROGRESS = 0.95
_SLACK = 1e-3  # of a cost that is in squares of standard deviations, for rounding


def smooth(
    model: ArmModel,
    recording: Iterable[tuple[float, Sequence[Measurement]]],
    gate: float = GATE,
    progress: Callable[[int], None] = lambda count: None,
) -> list[Estimate]:
    """Estimates of ``model`` at all times of a ``recording``, each from the whole of it.

    Args:
        model: the arm.
        recording: times [s] in ascending order and what was measured then.
        gate: as of `Filter`.
        progress: called with how many times the filter has done.

    Raises:
        MeasurementError: if the times are not in order or too many, or a measurement does not
            fit the arm.
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
    """
    return smooth_steps(model, _filtered(model, recording, gate, progress))


def smooth_steps(model: ArmModel, steps: Sequence[Step]) -> list[Estimate]:
    """Estimates at all ``steps`` of a filter of ``model``, each from what all of them accepted.

    Raises:
        SolveError: as `smooth`.
    """
    if not steps:
        return []
    with np.errstate(
        all='ignore'
    ):  # what is divided by zero is not finite, and no course leads there
        return _smooth_steps(model, steps)


def _smooth_steps(model: ArmModel, steps: Sequence[Step]) -> list[Estimate]:
    """`smooth_steps`; perhaps by numbers that are not finite."""
    points = [step.updated.at for step in steps]
    about = _Pass(model, steps, points, [None] * len(steps))
    for _ in range(_MOST):
        if about.size <= _TOLERANCE:
            return [
                estimate_of(
                    step.time,
                    step.time - steps[0].time,
                    step.updated._replace(
                        belief=Belief(at.x, belief.root), at=at, shape=at.solved
                    ),
                )
                for step, at, belief in zip(steps, about.points, about.course, strict=True)
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
        bent: how what is measured bends there; None of times without such a measurement.
    """

    def __init__(
        self,
        model: ArmModel,
        steps: Sequence[Step],
        points: Sequence[Prediction],
        bent: Sequence[Bent | None],
    ) -> None:
        """Of a model, its ``steps``, ``points``, and what is known of those nearby."""
        self.points = points
        nowhere = [np.zeros(model.state.size)] * len(steps)
        filtered, volume = _forward(model, steps, points, nowhere)
        known = _smoothed(model, steps, filtered)
        self.bent = [
            bent_at(step, at, belief, before)
            for step, at, belief, before in zip(steps, points, known, bent, strict=True)
        ]
        gradients = [
            gradient_at(step, at, belief, here)
            for step, at, belief, here in zip(steps, points, known, self.bent, strict=True)
        ]
        self.course = _smoothed(model, steps, _forward(model, steps, points, gradients)[0])
        self.size = max(
            float(np.linalg.norm(belief.whitened(belief.mean - at.x)))
            for at, belief in zip(points, self.course, strict=True)
        ) / np.sqrt(model.state.size)
        self.cost = volume + _improbability(model, steps, points)
        for at in points:
            at.forget()


def _next(model: ArmModel, steps: Sequence[Step], last: _Pass) -> _Pass:
    """As far towards the course of the ``last`` pass as makes one more probable.

    Raises:
        SolveError: if there is none.
    """
    part = min(1.0, _LONGEST / last.size)
    while True:
        points = [
            Prediction(model, at.x + part * (belief.mean - at.x), at.shape)
            for at, belief in zip(last.points, last.course, strict=True)
        ]
        try:
            found = _Pass(model, steps, points, last.bent)
            if found.cost <= last.cost + _SLACK or found.size <= _PROGRESS * last.size <= _NEAR:
                return found
        except SolveError:
            if part < _SHORTEST:
                raise
        if part < _SHORTEST:
            raise ConvergenceError('the smoother', last.size, _MOST)
        part *= 0.5


def _improbability(model: ArmModel, steps: Sequence[Step], points: Sequence[Prediction]) -> float:
    """Sum of squares of all changes of the state and all noise, in standard deviations."""
    total = normalised_square(points[0].x, prior(model).root)
    for (step, at), (following, after) in itertools.pairwise(zip(steps, points, strict=True)):
        elapsed = following.time - step.time
        growth = model.state.growth(elapsed)
        changes = growth > 0.0
        change = (after.x - model.state.decay(elapsed) * at.x)[changes] / growth[changes]
        total += float(change @ change)
    for step, at in zip(steps, points, strict=True):
        if step.updated.accepted:
            left = residuals(step.updated.accepted, at)
            total += normalised_square(left, noise_root(step.updated.accepted))
    return total


def _filtered(
    model: ArmModel,
    recording: Iterable[tuple[float, Sequence[Measurement]]],
    gate: float,
    progress: Callable[[int], None],
) -> list[Step]:
    """The steps of the recursive filter."""
    steps: list[Step] = []
    for time, measurements in recording:
        if steps and not time >= steps[-1].time:
            raise MeasurementError(
                f'time {time} s comes after {steps[-1].time} s, expected them in order'
            )
        check_count(len(steps) + 1)
        made = tuple(measurements)
        steps.append(next_step(model, steps[-1] if steps else None, time, made, gate))
        steps[-1].updated.at.forget()
        progress(len(steps))
    return steps


def check_count(times: int) -> None:
    """Check that so many ``times`` are no more than are smoothed together.

    Raises:
        MeasurementError: if they are.
    """
    if times > MAX_RECORDED:
        raise MeasurementError(f'more than {MAX_RECORDED} times, which is the most')


def _forward(
    model: ArmModel,
    steps: Sequence[Step],
    points: Sequence[Prediction],
    gradients: Sequence[FloatArray],
) -> tuple[list[Belief], float]:
    """The filter with measurements linearised about ``points``, and ln(det A) but a constant.

    ``gradients`` are those of its half, see `gradient_at`; every step of it has its weight.
    """
    beliefs: list[Belief] = []
    volume = 0.0
    for number, (step, at, gradient) in enumerate(zip(steps, points, gradients, strict=True)):
        if number:
            belief = predict(model, beliefs[-1], step.time - steps[number - 1].time)
        else:
            belief = prior(model)
        accepted = step.updated.accepted
        if accepted:
            jacobian = jacobians(accepted, at)
            by = gain(belief.root, jacobian, noise_root(accepted))
            left = residuals(accepted, at) + jacobian @ (at.x - belief.mean)
            shift = by.root @ (by.root.T @ gradient)
            belief = Belief(belief.mean + by.gain @ left - shift, by.root)
            volume += weight_of(step) * log_determinant(by.innovation_root)
        beliefs.append(belief)
    return beliefs, volume


def _smoothed(model: ArmModel, steps: Sequence[Step], filtered: list[Belief]) -> list[Belief]:
    """``filtered`` beliefs, each with what came later."""
    smoothed = [filtered[-1]]
    for (step, following), belief in zip(
        reversed(list(itertools.pairwise(steps))), filtered[-2::-1], strict=True
    ):
        elapsed = following.time - step.time
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        predicted, after = predict(model, belief, elapsed), smoothed[-1]
        back = _back(belief, decay, predicted)
        mean = belief.mean + back @ (after.mean - predicted.mean)
        kept = belief.root - back @ (decay[:, np.newaxis] * belief.root)
        smoothed.append(Belief(mean, lower_root([kept, back * growth, back @ after.root])))
    return [
        Belief(nearest_possible(model, belief, belief.mean), belief.root)
        for belief in reversed(smoothed)
    ]


def _back(belief: Belief, decay: FloatArray, predicted: Belief) -> FloatArray:
    """Gain of the smoother: how a state follows from the one ``predicted`` from it."""
    across = (decay[:, np.newaxis] * belief.root) @ belief.root.T
    half = solve_lower(predicted.root, across)
    return solve_lower(predicted.root, half, is_transposed=True).T
