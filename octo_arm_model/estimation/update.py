"""What measurements of one time make of a belief: the step of the filter.

Linear measurements come first, then the others, see `taken`; those that the others contradict are
refused too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.chi_square import chi_square_limit
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.estimation.belief import (
    Belief,
    solve_lower,
)
from octo_arm_model.estimation.curvature import Curvature
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.prediction import ArmModel, Prediction
from octo_arm_model.estimation.taken import (
    Kinds,
    Taken,
    far_off,
    kinds_of,
    take_linear,
    take_others,
    volume_of,
)

_MOST_KINDS = 8  # of measurements together whose curvature is kept
_REDUNDANT = 1e-6  # part of its variance that others must tell of a number to contradict it


class Innovation(NamedTuple):
    """What one measurement brought.

    Attributes:
        name: of the measurement.
        value: measured less predicted before it, linearised about the estimate, (m,).
        covariance: expected of that, likewise, (m, m).
        normalised_square: of the value by the covariance, which is the least sum of squares of
            noise and change of the state that explain it. Chi-square of m where all is as told.
            Of one that the others contradict, of what it is off from these. Of one that is refused
            it may be smaller, and linearised about the state before.
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
        refused: names of measurements of which the newest was refused.
    """

    belief: Belief
    at: Prediction
    shape: Backbone
    innovations: tuple[Innovation, ...]
    accepted: tuple[Measurement, ...]
    normalised_square: tuple[float, int]
    log_likelihood: float
    curvatures: Mapping[Kinds, Curvature]
    refused: frozenset[str]


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
            log_likelihood -= 0.5 * (chi_square_limit(gate, value.size) + volume_of(root))
    return Updated(
        found.belief,
        found.at,
        found.at.solved,
        tuple(innovations),
        tuple(one for one in measurements if id(one) in accepted),
        (linear.square + found.square, size),
        log_likelihood,
        _kept(last, found),
        frozenset(one.name for one in innovations if not one.is_accepted).union(
            () if last is None else last.refused - {one.name for one in innovations}
        ),
    )


def _take_all(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    gate: float,
) -> tuple[Taken, Taken]:
    """``belief`` after linear ``measurements``, and after all.

    Raises:
        SolveError: if they find no agreement.
    """
    at = Prediction(model, belief.mean, last and last.shape)
    linear = take_linear(belief, [one for one in measurements if one.is_linear], at, gate)
    others = [one for one in measurements if not one.is_linear]
    far: dict[int, float] = {}
    if last is not None and last.refused:
        doubted = [one for one in others if one.name in last.refused]
        far = far_off(linear.belief, doubted, linear.at, gate)
        others = [one for one in others if id(one) not in far]
    known = last and (last.at, last.curvatures.get(kinds_of(others)))
    found = take_others(linear.belief, others, linear.at, known, gate)
    return linear, found._replace(squares={**found.squares, **far})


def _contradicted(
    accepted: Sequence[Measurement], linear: Taken, found: Taken, gate: float
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


def _kept(last: Updated | None, found: Taken) -> dict[Kinds, Curvature]:
    """Curvatures of what was measured together last."""
    kept = dict(last.curvatures) if last is not None else {}
    if found.curvature is not None:
        kinds = kinds_of(found.accepted)
        kept.pop(kinds, None)
        kept[kinds] = found.curvature
        if len(kept) > _MOST_KINDS:
            del kept[next(iter(kept))]
    return kept
