"""A belief after linear measurements and after others, and which of them are within the gate.

Linear measurements are exact and cost no shape; the others are taken all together by `fit`, from
the last shape on. Where that does not converge, or one of them is not as expected, each is judged
by itself, which takes many shapes; one shape alone tells of many that they are `far_off`.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import (
    Belief,
    gain,
    log_determinant,
    lower_root,
    normalised_square,
)
from octo_arm_model.estimation.beliefs.curvature import Curvature
from octo_arm_model.estimation.beliefs.fit import Fit, fit, fit_at_mode
from octo_arm_model.estimation.beliefs.mode import most_probable
from octo_arm_model.estimation.beliefs.posterior import nearest_possible
from octo_arm_model.estimation.measurements import Measurement, jacobians, noise_root, residuals
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.rod.sensitivity import chi_square_limit

_FAR = 4.0  # times the gate, for a square that is not exact

Kinds: TypeAlias = tuple[Hashable, ...]


class Taken(NamedTuple):
    """A belief after some measurements.

    Attributes:
        belief: after them.
        at: the prediction of its mean, or nearly, see `Fit`.
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


def take_linear(
    prior: Belief, measurements: Sequence[Measurement], at: Prediction, gate: float
) -> Taken:
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
        wanted = prior.mean + by.gain @ left
        mean = nearest_possible(at.model, Belief(wanted, by.root), wanted)
        square = normalised_square(left, by.innovation_root)
        square += normalised_square(mean - wanted, by.root)
        new = Prediction(at.model, mean, at.shape)
        volume = volume_of(by.innovation_root)
        return Taken(prior.corrected(mean, by, jacobian), new, accepted, squares, square, volume)
    return Taken(prior, at, (), squares)


class Nearby:
    """What the last state leads to: measurements are taken from there on only once.

    Attributes:
        at: prediction of the last mean; None where there is none.
        gate: probability of a right measurement to be accepted.
    """

    def __init__(
        self, at: Prediction | None, curvatures: Mapping[Kinds, Curvature], gate: float
    ) -> None:
        """Of the state ``at``, with the ``curvatures`` of what was measured together."""
        self.at, self.gate, self._curvatures = at, gate, curvatures
        self._taken: dict[tuple[Measurement | None, ...], Taken | None] = {}

    def curvature(self, measurements: Sequence[Measurement]) -> Curvature | None:
        """That of ``measurements`` if it is known."""
        return self._curvatures.get(kinds_of(measurements))

    def starts(self, at: Prediction) -> list[Prediction]:
        """Where to look from, for a prior whose mean is ``at``."""
        return [at] if self.at is None else [at, self.at]

    def take(self, linear: Taken, measurements: Sequence[Measurement]) -> Taken | None:
        """`take_together` if the last state leads to where they agree; None if not."""
        if self.at is None:
            return None
        given = *linear.accepted, None, *measurements
        if given not in self._taken:
            known = self.curvature(measurements)
            self._taken[given] = _agreed(linear.belief, measurements, self.at, known, self.gate)
        return self._taken[given]


def take_others(linear: Taken, measurements: Sequence[Measurement], near: Nearby) -> Taken:
    """The belief after ``linear`` ones after other ``measurements``.

    Raises:
        SolveError: if they find no agreement.
    """
    if taken := take_together(linear, measurements, near):
        return taken
    prior, gate, known = linear.belief, near.gate, near.curvature(measurements)
    starts, squares = near.starts(linear.at), {}
    for one in measurements:
        limit = _limit([one], gate)
        start, squares[id(one)] = most_probable(prior, [one], starts, limit, is_judged=True)
    accepted = _within(measurements, squares, gate)
    if not accepted:
        return Taken(prior, linear.at, (), squares)
    square, limit = min(squares.values()), _limit(accepted, gate)
    if len(measurements) > 1:
        start, square = most_probable(prior, accepted, starts, limit)
    try:
        found = fit(prior, accepted, start, known, is_new=True)
    except SolveError:
        # The mean of a posterior that is far from normal may not be found, or be none of its.
        if square > limit:
            raise
        found = fit_at_mode(prior, accepted, start)
    return _all(accepted, found)._replace(squares=squares)


def take_together(
    linear: Taken, measurements: Sequence[Measurement], near: Nearby, *, is_far: bool = False
) -> Taken | None:
    """`take_others` where each is within the gate beside all others; None if not.

    If ``is_far`` the last state is not thought to be near, and these may be hopeless.
    """
    prior, gate = linear.belief, near.gate
    if not measurements:
        return Taken(prior, linear.at)
    if not is_far:
        if taken := near.take(linear, measurements):
            return taken
        if len(measurements) == 1:
            return None
    limit, starts = _limit(measurements, gate), near.starts(linear.at)
    start, square = most_probable(prior, measurements, starts, limit, is_judged=True)
    if square > limit:
        return None
    known = near.curvature(measurements)
    return _agreed(prior, measurements, start, known, gate, is_new=True)


def _limit(measurements: Sequence[Measurement], gate: float) -> float:
    """The largest square of all ``measurements`` together that is within the ``gate``."""
    return chi_square_limit(gate, sum(one.value.size for one in measurements))


def far_off(
    prior: Belief, measurements: Sequence[Measurement], at: Prediction, gate: float
) -> dict[int, float]:
    """Normalised squares by `id` of those that are far outside the ``gate``.

    By what they predict linearised about the mean of ``prior``, where the arm is ``at``.
    """
    found = {}
    try:
        for one in measurements:
            root = gain(prior.root, one.jacobian(at), one.noise_root).innovation_root
            square = normalised_square(one.innovation(at), root)
            if square > _FAR * chi_square_limit(gate, one.value.size):
                found[id(one)] = square
    except SolveError:
        return {}
    return found


def _agreed(
    prior: Belief,
    measurements: Sequence[Measurement],
    start: Prediction,
    known: Curvature | None,
    gate: float,
    *,
    is_new: bool = False,
) -> Taken | None:
    """All ``measurements`` taken, from ``start`` on; None unless all are within the ``gate``."""
    try:
        taken = _all(measurements, fit(prior, measurements, start, known, is_new=is_new))
    except SolveError:
        return None
    return taken if len(_within(measurements, taken.squares, gate)) == len(measurements) else None


def _all(measurements: Sequence[Measurement], found: Fit) -> Taken:
    """All ``measurements`` taken, as they were ``found``."""
    root = found.innovation_root
    squares = _squares(measurements, found.innovation, root)
    return Taken(
        found.belief, found.at, measurements, squares, found.square, volume_of(root),
        found.curvature,
    )  # fmt: skip


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


def volume_of(root: FloatArray) -> float:
    """Twice the logarithm of the normal density's denominator, for a covariance of ``root``."""
    return log_determinant(root) + len(root) * math.log(2.0 * math.pi)
