"""Which measurements of one time are used.

Linear measurements come first, then the others, see `taken`; those that the others contradict are
refused too. `lying_cell` has what is done where all but one load cell agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.estimation.beliefs.belief import Belief, solve_lower
from octo_arm_model.estimation.gating.taken import (
    Nearby,
    Taken,
    far_off,
    take_linear,
    take_others,
)
from octo_arm_model.estimation.gating.updated import Updated
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.estimation.state.prediction import ArmModel, Prediction
from octo_arm_model.rod.sensitivity import chi_square_limit

_REDUNDANT = 1e-6  # part of its variance that others must tell of a number to contradict it


class Judged(NamedTuple):
    """Measurements, and which of them are used.

    Attributes:
        measurements: in their order.
        linear: the belief after those that are linear.
        found: after all.
        contradicted: squares of those that the others contradict, by `id`.
    """

    measurements: Sequence[Measurement]
    linear: Taken
    found: Taken
    contradicted: Mapping[int, float]

    @property
    def accepted(self) -> list[Measurement]:
        """Those that are used."""
        return [*self.linear.accepted, *self.found.accepted]

    @property
    def refused(self) -> list[Measurement]:
        """All others."""
        used = {id(one) for one in self.accepted}
        return [one for one in self.measurements if id(one) not in used]

    @property
    def squares(self) -> dict[int, float]:
        """Normalised squares of all, by `id`."""
        return {**self.linear.squares, **self.found.squares, **self.contradicted}

    @property
    def square(self) -> float:
        """Of all that are used together."""
        return self.linear.square + self.found.square


def judge(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    near: Nearby,
) -> Judged:
    """``measurements`` without those that the others contradict, one after another.

    Raises:
        SolveError: as `update`.
    """
    contradicted: dict[int, float] = {}
    while True:
        used = [one for one in measurements if id(one) not in contradicted]
        linear, found = _take_all(model, belief, used, last, near)
        judged = Judged(measurements, linear, found, contradicted)
        worst = _contradicted(judged, near.gate)
        if worst is None:
            return judged
        contradicted[id(worst[0])] = worst[1]


def agreeing(
    belief: Belief,
    measurements: Sequence[Measurement],
    at: Prediction,
    take: Callable[[Taken], Taken | None],
    gate: float,
) -> Judged | None:
    """``measurements`` if all agree, those that are not linear as ``take`` takes them."""
    linear_ones = [one for one in measurements if one.is_linear]
    linear = take_linear(belief, linear_ones, at, gate)
    if len(linear.accepted) < len(linear_ones):
        return None
    found = take(linear)
    if found is None:
        return None
    judged = Judged(measurements, linear, found, {})
    return judged if _contradicted(judged, gate) is None else None


def _take_all(
    model: ArmModel,
    belief: Belief,
    measurements: Sequence[Measurement],
    last: Updated | None,
    near: Nearby,
) -> tuple[Taken, Taken]:
    """``belief`` after linear ``measurements``, and after all.

    Raises:
        SolveError: if they find no agreement.
    """
    at = Prediction(model, belief.mean, last and last.shape)
    linear = take_linear(belief, [one for one in measurements if one.is_linear], at, near.gate)
    others = [one for one in measurements if not one.is_linear]
    far: dict[int, float] = {}
    if last is not None and last.refused:
        doubted = [one for one in others if one.name in last.refused]
        far = far_off(linear.belief, doubted, linear.at, near.gate)
        if len(far) == len(others):
            # Nothing else tells of the shape: the arm may have left the branch of equilibria on
            # which it is thought to be.
            far = {}
        others = [one for one in others if id(one) not in far]
    found = take_others(linear, others, near)
    return linear, found._replace(squares={**found.squares, **far})


def _contradicted(judged: Judged, gate: float) -> tuple[Measurement, float] | None:
    """The measurement that all others contradict the most, and its square by these.

    None where all together are within the ``gate``, or none by itself is beyond it (outlier test
    of geodesy, Baarda 1968).
    """
    accepted, found = judged.accepted, judged.found
    size = sum(one.value.size for one in accepted)
    if len(accepted) < 2 or judged.square <= chi_square_limit(gate, size):
        return None
    worst, most = None, 1.0
    for one in accepted:
        jacobian, away = one.jacobian(found.at), found.at.x - found.belief.mean
        white = solve_lower(one.noise_root, one.innovation(found.at) + jacobian @ away)
        told = solve_lower(one.noise_root, jacobian @ found.belief.root)
        values, vectors = np.linalg.eigh(np.eye(white.size) - told @ told.T)
        known = values > _REDUNDANT
        square = float(((vectors[:, known].T @ white) ** 2 / values[known]).sum())
        beyond = square / chi_square_limit(gate, white.size)
        if beyond > most:
            worst, most = (one, square), beyond
    return worst
