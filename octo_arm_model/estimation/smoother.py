"""The batch estimator: the most probable course of the state over a recording.

Gauss-Newton iteration on all times at once: each pass is a linear filter forward and a smoother
backward (Rauch, Tung and Striebel) about the last course, the iterated extended Kalman smoother
of Bell 1994. It begins from the recursive filter, whose refusals stand.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from octo_arm_model.core.errors import ConvergenceError, MeasurementError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.belief import Belief, gain, lower_root
from octo_arm_model.estimation.estimate import Estimate, estimate_of
from octo_arm_model.estimation.filter import GATE, Step, first_step, next_step, predict, prior
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
)
from octo_arm_model.estimation.prediction import ArmModel, Prediction
from octo_arm_model.estimation.update import TOLERANCE, nearest_possible

MAX_RECORDED = 100_000  # times
_MOST = 20  # passes


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
    steps = _filtered(model, recording, gate, progress)
    if not steps:
        return []
    course = _smoothed(model, steps, [step.updated.belief for step in steps])
    shapes = [step.updated.shape for step in steps]
    size = np.inf
    for _ in range(_MOST):
        points = [
            Prediction(model, belief.mean, shape)
            for belief, shape in zip(course, shapes, strict=True)
        ]
        shapes = [at.solved for at in points]
        new = _smoothed(model, steps, _forward(model, steps, points))
        size = max(
            float(np.linalg.norm(after.whitened(after.mean - before.mean)))
            for before, after in zip(course, new, strict=True)
        ) / np.sqrt(model.state.size)
        if size <= TOLERANCE:
            return [
                estimate_of(
                    step.time,
                    model.state.prior_stddev(step.time - steps[0].time),
                    step.updated._replace(
                        belief=Belief(at.x, belief.root), at=at, shape=at.solved
                    ),
                )
                for step, at, belief in zip(steps, points, new, strict=True)
            ]
        course = new
    raise ConvergenceError('the smoother', size, _MOST)


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
                f'time {time!r} s comes after {steps[-1].time!r} s, expected them in order'
            )
        if len(steps) == MAX_RECORDED:
            raise MeasurementError(f'more than {MAX_RECORDED} times, which is the most')
        made = tuple(measurements)
        step = next_step(model, steps[-1], time, made, gate) if steps else None
        steps.append(step or first_step(model, time, made, gate))
        steps[-1].updated.at.forget()
        progress(len(steps))
    return steps


def _forward(model: ArmModel, steps: Sequence[Step], points: Sequence[Prediction]) -> list[Belief]:
    """The filter with measurements linearised about ``points``."""
    beliefs: list[Belief] = []
    for number, (step, at) in enumerate(zip(steps, points, strict=True)):
        belief = prior(model)
        if number:
            belief = predict(model, beliefs[-1], step.time - steps[number - 1].time)
        accepted = step.updated.accepted
        if accepted:
            jacobian = jacobians(accepted, at)
            by = gain(belief.root, jacobian, noise_root(accepted))
            left = residuals(accepted, at) + jacobian @ (at.x - belief.mean)
            belief = Belief(belief.mean + by.gain @ left, by.root)
            at.forget()
        beliefs.append(belief)
    return beliefs


def _smoothed(model: ArmModel, steps: Sequence[Step], filtered: list[Belief]) -> list[Belief]:
    """``filtered`` beliefs, each with what came later."""
    smoothed = [filtered[-1]]
    for (step, following), belief in zip(
        reversed(list(itertools.pairwise(steps))), filtered[-2::-1], strict=True
    ):
        elapsed = following.time - step.time
        decay, growth = model.state.decay(elapsed), model.state.growth(elapsed)
        predicted, after = belief.after(decay, growth), smoothed[-1]
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
    half = np.linalg.solve(predicted.root, across)
    return np.linalg.solve(predicted.root.T, half).T
