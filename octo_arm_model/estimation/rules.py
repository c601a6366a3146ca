"""What is taken for granted of sensors, how they contradict a hypothesis, and how often."""

from __future__ import annotations

import collections
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.sensitivity import chi_square_limit

GATE = 0.9999
RECENT = 200  # innovations of a kind that count as recent
DOUBTS = 2  # load cells that are doubted at once at most, unless it is all of them
_ALL = 4.0  # load cells that lie together as rarely as all of them

Doubts = frozenset[str]  # names of sensors that a hypothesis does not believe


@dataclass(frozen=True)
class Rules:
    """What an estimator takes for granted of sensors.

    Attributes:
        gate: probability with which a right measurement is accepted.
        cell_fault: probability of a load cell to lie, in parts of that of all being right; 0 for
            load cells that never do.
        sensor_fault: likewise of any other sensor.
        recover_after: for how long all hypotheses have to be contradicted to begin anew [s]; 0 for
            never.

    Raises:
        MeasurementError: if a number is outside its range.
    """

    gate: float = GATE
    cell_fault: float = 0.0
    sensor_fault: float = 0.0
    recover_after: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        if not 0.0 < self.gate < 1.0:
            raise MeasurementError(f'gate is {self.gate}, expected a probability in (0, 1)')
        for name in ('cell_fault', 'sensor_fault'):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise MeasurementError(f'{name} is {value}, expected a probability in [0, 1)')
        if not 0.0 <= self.recover_after < math.inf:
            raise MeasurementError(
                f'recover_after is {self.recover_after}, expected a finite number >= 0 [s]'
            )

    @property
    def doubts_any(self) -> bool:
        """Whether any sensor may lie for longer than a message."""
        return bool(self.cell_fault or self.sensor_fault)

    def improbability(self, doubts: Doubts, cells: Doubts) -> float:
        """Of the ``doubts`` of a hypothesis, of an arm with such load ``cells`` [nat]."""
        count = len(doubts & cells)
        of_cells = _ALL if count > DOUBTS else count
        parts = (of_cells, self.cell_fault), (len(doubts - cells), self.sensor_fault)
        return -sum((count * math.log(part) for count, part in parts if count), 0.0)


class Channels:
    """Which numbers of several measurements are of one sensor.

    Attributes:
        names: of the sensor of each number, (m,).
        is_same: whether two are of the same one, (m, m).
        counts: how many numbers the sensor of each measures, (m,).
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        """Of numbers of sensors of these ``names``."""
        self.names = names
        self.is_same = np.array([[one == other for one in names] for other in names])
        self.counts = self.is_same.sum(axis=1)

    def limits(self, gate: float) -> FloatArray:
        """Largest normalised square of each sensor that is within the ``gate``, (m,)."""
        return np.array([chi_square_limit(gate, count) for count in self.counts.tolist()])

    def is_in(self, doubts: Doubts) -> NDArray[np.bool_]:
        """Which numbers are of sensors that are doubted, (m,)."""
        return np.array([name in doubts for name in self.names])

    def squares(self, innovation: FloatArray, expected: FloatArray) -> FloatArray:
        """Normalised square of the sensor of each number, (hypotheses, m).

        Of an ``innovation`` (hypotheses, m), by its covariance ``expected`` (hypotheses, m, m).
        """
        solved = np.linalg.solve(expected * self.is_same, innovation[..., np.newaxis])[..., 0]
        return np.asarray((innovation * solved) @ self.is_same)


channels_of = functools.lru_cache(maxsize=64)(Channels)


class Innovation(NamedTuple):
    """What one measurement brought.

    Attributes:
        name: of the measurement, or of one load cell that was refused.
        value: measured less predicted before it, linearised about the estimate, (m,).
        covariance: expected of that, likewise, (m, m).
        normalised_square: of the value by the covariance. Chi-square of m where all is as told.
        is_accepted: whether it was used.
    """

    name: str
    value: FloatArray
    covariance: FloatArray
    normalised_square: float
    is_accepted: bool


@dataclass
class Consistency:
    """Innovations of one kind of measurement.

    Attributes:
        accepted: how many measurements.
        refused: how many the gate refused.
        square: sum of the normalised squares of those accepted; chi-square of `size` where all
            is as told.
        size: of how many numbers.
        recent: square and size of the newest of them.
        refused_from: stamp of the first one refused [ns]; None of none.
        refused_to: of the last.
    """

    accepted: int = 0
    refused: int = 0
    square: float = 0.0
    size: int = 0
    recent: collections.deque[tuple[float, int]] = field(
        default_factory=lambda: collections.deque(maxlen=RECENT)
    )
    refused_from: int | None = None
    refused_to: int | None = None

    @property
    def mean(self) -> float:
        """Mean of the normalised squares per number, 1 where all is as told; NaN of none."""
        return self.square / self.size if self.size else math.nan

    def count(self, stamp_ns: int, one: Innovation) -> None:
        """Count an innovation."""
        if one.is_accepted:
            self.accepted += 1
            self.square += one.normalised_square
            self.size += one.value.size
            self.recent.append((one.normalised_square, one.value.size))
            return
        self.refused += 1
        if self.refused_from is None:
            self.refused_from = stamp_ns
        self.refused_to = stamp_ns


def count_innovations(
    consistency: dict[str, Consistency], stamp_ns: int, innovations: Sequence[Innovation]
) -> None:
    """Count ``innovations`` of one stamp [ns] in the ``consistency`` of their kinds."""
    for one in innovations:
        consistency.setdefault(one.name, Consistency()).count(stamp_ns, one)
