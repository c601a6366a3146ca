"""Which single load cell is refused, where all but that agree: what is near is looked at first."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import (
    Belief,
    lower_root,
    normalised_square,
    solve_lower,
)
from octo_arm_model.estimation.gating.judgement import Judged, agreeing
from octo_arm_model.estimation.gating.taken import Nearby, Taken, take_linear, take_together
from octo_arm_model.estimation.gating.updated import Updated
from octo_arm_model.estimation.measurements import (
    Measurement,
    jacobians,
    noise_root,
    residuals,
)
from octo_arm_model.estimation.state.prediction import ArmModel, Prediction
from octo_arm_model.rod.sensitivity import chi_square_limit


def nearby(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    near: Nearby,
) -> Judged | None:
    """All ``measurements``, or all but one load cell, where they agree near the ``last`` state.

    A load cell that was refused at the last time is left out as long as it contradicts the others;
    where there are none it has to agree with what was known then, however fast its tension may
    change. Otherwise it is that which explains the most of what all leave, linearised about the
    last state. None where nothing near that tells: further off it is searched slowly, by `judge`.
    """
    if last is None:
        return None
    gate = near.gate
    others = [one for one in measurements if not one.is_linear]

    def take(linear: Taken) -> Taken | None:
        return near.take(linear, others)

    at = Prediction(model, belief.mean, last.shape)
    apart = functools.cache(lambda: _each_apart(measurements, at))  # usually nobody asks
    if last.refused:
        doubted = [one for one in apart() if one.single.name in last.refused]
        if not others:
            return _still_refused(belief, measurements, doubted, at, last, gate)
        if found := _without_one(belief, measurements, doubted, at, take, gate):
            return found
    if not others:
        return None
    if whole := agreeing(belief, measurements, at, take, gate):
        return whole
    if len(others) < 2 or not apart():
        return None
    explained = _explained(belief, measurements, last.at)
    worst = max(apart(), key=lambda one: explained[one.place])
    return _without_one(belief, measurements, [worst], at, take, gate)


def without_one(
    model: ArmModel, belief: Belief, judged: Judged, last: Updated | None, near: Nearby
) -> Judged | None:
    """All measurements but one load cell, where all but that agree; None where there is none.

    Looked for from afar: what a load cell lies by may have led anywhere.

    A force explains whatever a single sensor of the shape says beside load cells that lie: if no
    load cells are refused there have to be two of them to contradict one.
    """
    others = [one for one in judged.measurements if not one.is_linear]
    if last is not None and all(one.name in last.refused for one in judged.refused):
        return None  # as at the last time, when there was none either
    if last is None:
        near = Nearby(judged.found.at, {}, near.gate)  # not far from what that cell shows

    def take(linear: Taken) -> Taken | None:
        return take_together(linear, others, near, is_far=True)

    at = Prediction(model, belief.mean, last and last.shape)
    apart = _each_apart(judged.refused if len(others) < 2 else judged.measurements, at)
    return _without_one(belief, judged.measurements, apart, at, take, near.gate)


class _Apart(NamedTuple):
    """A measurement that is several load cells' without one of them.

    Attributes:
        whole: the measurement.
        rest: of all others.
        single: of that one.
        place: of its number among those of all measurements.
    """

    whole: Measurement
    rest: Measurement
    single: Measurement
    place: int


def _each_apart(measurements: Sequence[Measurement], at: Prediction) -> list[_Apart]:
    """Each load cell of ``measurements``."""
    found, first = [], 0
    for one in measurements:
        for number, (rest, single) in enumerate(one.each_apart(at)):
            found.append(_Apart(one, rest, single, first + number))
        first += one.value.size
    return found


def _explained(belief: Belief, measurements: Sequence[Measurement], at: Prediction) -> FloatArray:
    """By how much the square of all ``measurements`` is less without each of their numbers.

    Linearised ``at`` a state (Baarda 1968).
    """
    jacobian, noise = jacobians(measurements, at), noise_root(measurements)
    left = residuals(measurements, at) + jacobian @ (at.x - belief.mean)
    told = jacobian @ belief.root
    # By the root: the covariance of noise a million times smaller is singular by rounding.
    white = solve_lower(lower_root([told, noise]), np.column_stack([left, np.eye(left.size)]))
    each = white[:, 1:]
    return np.asarray((each.T @ white[:, 0]) ** 2 / (each**2).sum(axis=0))


def _still_refused(
    belief: Belief,
    measurements: Sequence[Measurement],
    doubted: Sequence[_Apart],
    at: Prediction,
    last: Updated,
    gate: float,
) -> Judged | None:
    """Linear ``measurements`` without a ``doubted`` one that the ``last`` belief contradicts."""
    for one in doubted:
        square = _square(one.single, last.at, last.belief)
        kept = _replaced(measurements, one)
        linear = take_linear(belief, kept, at, gate)
        if square > chi_square_limit(gate, 1) and len(linear.accepted) == len(kept):
            nothing = Taken(linear.belief, linear.at)
            return Judged([*kept, one.single], linear, nothing, {id(one.single): square})
    return None


def _without_one(
    belief: Belief,
    measurements: Sequence[Measurement],
    apart: Sequence[_Apart],
    at: Prediction,
    take: Callable[[Taken], Taken | None],
    gate: float,
) -> Judged | None:
    """The most probable of all ``measurements`` but one of those ``apart`` that they contradict.

    ``take`` takes those that are not linear after those that are, see `agreeing`.
    """
    best = None
    for one in apart:
        kept = _replaced(measurements, one)
        judged = agreeing(belief, kept, at, take, gate)
        if judged is None or (best is not None and judged.square >= best.square):
            continue
        square = _square(one.single, judged.found.at, judged.found.belief)
        if square > chi_square_limit(gate, 1):
            single = {id(one.single): square}
            best = judged._replace(measurements=[*kept, one.single], contradicted=single)
    return best


def _replaced(measurements: Sequence[Measurement], apart: _Apart) -> list[Measurement]:
    """``measurements`` without the one ``apart``."""
    return [apart.rest if one is apart.whole else one for one in measurements]


def _square(measurement: Measurement, at: Prediction, belief: Belief) -> float:
    """Normalised square of a ``measurement`` by a ``belief`` whose mean is nearly ``at``."""
    jacobian = measurement.jacobian(at)
    root = lower_root([jacobian @ belief.root, measurement.noise_root])
    return normalised_square(measurement.innovation(at) + jacobian @ (at.x - belief.mean), root)
