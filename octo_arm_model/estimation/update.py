"""What measurements of one time make of a belief: the step of the filter.

Linear measurements are exact and cost no shape, so they come first; the others all together by
`fit`, from the last shape on. Where that does not converge, or one of them is not as expected,
each is judged by itself; those that the others contradict are refused too.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.estimation.belief import (
    Belief,
    chi_square_limit,
    gain,
    lower_root,
    normalised_square,
    solve_lower,
)
from octo_arm_model.estimation.curvature import Curvature
from octo_arm_model.estimation.fit import Fit, fit, nearest_possible
from octo_arm_model.estimation.measurements import Measurement, jacobians, noise_root, residuals
from octo_arm_model.estimation.mode import FROM_AFAR, FROM_NEARBY, most_probable
from octo_arm_model.estimation.prediction import ArmModel, Prediction

_MOST_KINDS = 8  # of measurements together whose curvature is kept
_REDUNDANT = 1e-6  # part of its variance that others must tell of a number to contradict it

Kinds: TypeAlias = tuple[Hashable, ...]
Start: TypeAlias = tuple[Prediction, tuple[float, ...]]  # and how it is left, see `mode`


class Innovation(NamedTuple):
    """What one measurement brought.

    Attributes:
        name: of the measurement.
        value: measured less predicted before it, linearised about the estimate, (m,).
        covariance: expected of that, likewise, (m, m).
        normalised_square: of the value by the covariance, which is the least sum of squares of
            noise and change of the state that explain it. Chi-square of m where all is as told.
            Of one that the others contradict, of what it is off from these.
        is_accepted: whether it is within the gate.
    """

    name: str
    value: FloatArray
    covariance: FloatArray
    normalised_square: float
    is_accepted: bool


class Updated(NamedTuple):
    """A belief after measurements.

    Attributes:
        belief: after them.
        at: the prediction of its mean, about which it was linearised.
        shape: in its mean, of the arm as described.
        innovations: of every measurement, in their order.
        accepted: the measurements that were used.
        normalised_square: of all that were accepted together, and of how many numbers.
        log_likelihood: of all measurements; of a refused one as if it were at the gate.
        curvatures: of what is measured together, by `Measurement.kind` of each.
    """

    belief: Belief
    at: Prediction
    shape: Backbone
    innovations: tuple[Innovation, ...]
    accepted: tuple[Measurement, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float
    curvatures: Mapping[Kinds, Curvature]


def update(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    gate: float,
) -> Updated:
    """``belief`` after ``measurements``, from the ``last`` one on.

    ``gate`` is the probability of a right measurement to be accepted.

    Raises:
        SolveError: if the arm has no trustworthy shape, or the iteration does not converge.
        MeasurementError: if a measurement does not fit the arm.
    """
    contradicted: dict[int, float] = {}
    while True:
        used = [one for one in measurements if id(one) not in contradicted]
        linear, found = _take_all(model, belief, used, last, gate)
        worst = _contradicted([*linear.accepted, *found.accepted], linear, found, gate)
        if worst is None:
            break
        contradicted[id(worst[0])] = worst[1]
    squares = {**linear.squares, **found.squares, **contradicted}
    accepted = {id(one) for one in (*linear.accepted, *found.accepted)}
    innovations, size = [], 0
    log_likelihood = -0.5 * (linear.square + linear.volume + found.square + found.volume)
    for one in measurements:
        before, is_accepted = belief if one.is_linear else linear.belief, id(one) in accepted
        jacobian = one.jacobian(found.at)
        value = one.innovation(found.at) + jacobian @ (found.at.x - before.mean)
        told = jacobian @ before.root
        covariance = told @ told.T + one.covariance
        innovations.append(Innovation(one.name, value, covariance, squares[id(one)], is_accepted))
        if is_accepted:
            size += value.size
        else:
            root = np.asarray(np.linalg.cholesky(covariance), np.float64)
            log_likelihood -= 0.5 * (chi_square_limit(gate, value.size) + _volume(root))
    return Updated(
        found.belief,
        found.at,
        found.at.solved,
        tuple(innovations),
        tuple(one for one in measurements if id(one) in accepted),
        (linear.square + found.square, size),
        log_likelihood,
        _kept(last, found),
    )


class _Taken(NamedTuple):
    """A belief after some measurements.

    Attributes:
        belief: after them.
        at: the prediction of its mean.
        accepted: those that were used.
        squares: normalised squares of all, by `id`.
        square: of all that were accepted together.
        volume: twice the logarithm of the denominator of their density.
        curvature: of what these predict, if that is known.
    """

    belief: Belief
    at: Prediction
    accepted: Sequence[Measurement] = ()
    squares: Mapping[int, float] = {}
    square: float = 0.0
    volume: float = 0.0
    curvature: Curvature | None = None


def _take_all(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    gate: float,
) -> tuple[_Taken, _Taken]:
    """``belief`` after linear ``measurements``, and after all.

    Raises:
        SolveError: if they find no agreement.
    """
    at = Prediction(model, belief.mean, last and last.shape)
    linear = _take_linear(belief, [one for one in measurements if one.is_linear], at, gate)
    others = [one for one in measurements if not one.is_linear]
    return linear, _take(linear.belief, others, linear.at, last, gate)


def _take_linear(
    prior: Belief, measurements: Sequence[Measurement], at: Prediction, gate: float
) -> _Taken:
    """``prior`` after linear ``measurements``, whose mean is ``at``."""
    squares: dict[int, float] = {}
    accepted = measurements
    while accepted:
        left, jacobian = residuals(accepted, at), jacobians(accepted, at)
        by = gain(prior.root, jacobian, noise_root(accepted))
        if not squares:
            squares = _squares(accepted, left, by.innovation_root)
            within = _within(accepted, squares, gate)
            if len(within) < len(accepted):
                accepted = within
                continue
        wanted, posterior = prior.mean + by.gain @ left, Belief(prior.mean, by.root)
        mean = nearest_possible(at.model, posterior, wanted)
        square = normalised_square(left, by.innovation_root)
        square += normalised_square(mean - wanted, by.root)
        new = Prediction(at.model, mean, at.shape)
        volume = _volume(by.innovation_root)
        return _Taken(Belief(mean, by.root), new, accepted, squares, square, volume)
    return _Taken(prior, at, (), squares)


def _take(
    prior: Belief,
    measurements: Sequence[Measurement],
    at: Prediction,
    last: Updated | None,
    gate: float,
) -> _Taken:
    """``prior`` after other ``measurements``, whose mean is ``at``.

    Raises:
        SolveError: if they find no agreement.
    """
    if not measurements:
        return _Taken(prior, at)
    if last is not None:
        known = last.curvatures.get(kinds_of(measurements))
        try:
            taken = _all(measurements, fit(prior, measurements, last.at, known))
        except SolveError:
            pass
        else:
            if len(_within(measurements, taken.squares, gate)) == len(measurements):
                return taken
    starts: list[Start] = [(at, FROM_AFAR)]
    if last is not None:
        starts.insert(0, (last.at, FROM_NEARBY))
    if len(measurements) > 1:
        limit = chi_square_limit(gate, sum(one.value.size for one in measurements))
        start, square = _most_probable(prior, measurements, starts, limit)
        if square <= limit:
            try:
                taken = _all(measurements, fit(prior, measurements, start, None))
            except SolveError:
                pass
            else:
                if len(_within(measurements, taken.squares, gate)) == len(measurements):
                    return taken
    squares = {}
    for one in measurements:
        limit = chi_square_limit(gate, one.value.size)
        _, squares[id(one)] = _most_probable(prior, [one], starts, limit)
    accepted = _within(measurements, squares, gate)
    if not accepted:
        return _Taken(prior, at, (), squares)
    limit = chi_square_limit(gate, sum(one.value.size for one in accepted))
    start, _ = _most_probable(prior, accepted, starts, limit)
    try:
        found = fit(prior, accepted, start, None)
    except SolveError:
        found = fit(prior, accepted, start, None, to_mode=True)
    return _all(accepted, found)._replace(squares=squares)


def _all(measurements: Sequence[Measurement], found: Fit) -> _Taken:
    """All ``measurements`` taken, as they were ``found``."""
    root = found.innovation_root
    squares = _squares(measurements, found.innovation, root)
    return _Taken(
        found.belief, found.at, measurements, squares, found.square, _volume(root),
        found.curvature,
    )  # fmt: skip


def _most_probable(
    prior: Belief, measurements: Sequence[Measurement], starts: Sequence[Start], enough: float
) -> tuple[Prediction, float]:
    """`most_probable` from the best of ``starts``, or the first that is as good as ``enough``.

    Infinite where there is none.
    """
    best, least = starts[0][0], math.inf
    for start, factors in starts:
        try:
            at, square = most_probable(prior, measurements, start, factors)
        except SolveError:
            continue
        if square < least:
            best, least = at, square
        if least <= enough:
            break
    return best, least


def _contradicted(
    accepted: Sequence[Measurement], linear: _Taken, found: _Taken, gate: float
) -> tuple[Measurement, float] | None:
    """The measurement that all others contradict the most, and its square by these.

    None where all together are within the ``gate``, or none by itself is beyond it (outlier test
    of geodesy, Baarda 1968).
    """
    size = sum(one.value.size for one in accepted)
    if len(accepted) < 2 or linear.square + found.square <= chi_square_limit(gate, size):
        return None
    worst, most = None, 1.0
    for one in accepted:
        white = solve_lower(one.noise_root, one.innovation(found.at))
        told = solve_lower(one.noise_root, one.jacobian(found.at) @ found.belief.root)
        values, vectors = np.linalg.eigh(np.eye(white.size) - told @ told.T)
        known = values > _REDUNDANT
        square = float(((vectors[:, known].T @ white) ** 2 / values[known]).sum())
        beyond = square / chi_square_limit(gate, white.size)
        if beyond > most:
            worst, most = (one, square), beyond
    return worst


def _kept(last: Updated | None, found: _Taken) -> dict[Kinds, Curvature]:
    """Curvatures of what was measured together last."""
    kept = dict(last.curvatures) if last is not None else {}
    if found.curvature is not None:
        kinds = kinds_of(found.accepted)
        kept.pop(kinds, None)
        kept[kinds] = found.curvature
        if len(kept) > _MOST_KINDS:
            del kept[next(iter(kept))]
    return kept


def kinds_of(measurements: Sequence[Measurement]) -> Kinds:
    """What ``measurements`` are of, whatever their values."""
    return tuple(one.kind for one in measurements)


def _squares(
    measurements: Sequence[Measurement], innovation: FloatArray, root: FloatArray
) -> dict[int, float]:
    """Normalised square of each, by `id`; ``root`` is of the covariance of all."""
    if len(measurements) == 1:
        return {id(measurements[0]): normalised_square(innovation, root)}
    found, first = {}, 0
    for one in measurements:
        own = slice(first, first + one.value.size)
        found[id(one)] = normalised_square(innovation[own], lower_root([root[own]]))
        first = own.stop
    return found


def _within(
    measurements: Sequence[Measurement], squares: Mapping[int, float], gate: float
) -> list[Measurement]:
    """Those whose ``squares`` are within the ``gate``."""
    return [
        one for one in measurements if squares[id(one)] <= chi_square_limit(gate, one.value.size)
    ]


def _volume(root: FloatArray) -> float:
    """Twice the logarithm of the normal density's denominator, for a covariance of ``root``."""
    return 2.0 * float(np.log(root.diagonal()).sum()) + len(root) * math.log(2.0 * math.pi)
