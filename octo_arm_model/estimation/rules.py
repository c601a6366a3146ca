"""The assumptions about sensors, and the statistics of their innovations."""

from __future__ import annotations

import collections
import functools
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import MeasurementError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import is_number
from octo_arm_model.rod.sensitivity import chi_square_limit

GATE = 0.9999
RECENT = 200  # number of innovations of a kind that count as recent
DOUBTS = 2  # largest number of load cells that are doubted at once, other than all of them
_ALL = 4.0  # all load cells are as improbable to be wrong as this number of independent ones

Doubts = frozenset[str]  # names of the sensors that a hypothesis does not use


@dataclass(frozen=True)
class Rules:
    """The assumptions of an estimator about sensors.

    Raises:
        MeasurementError: if a number is outside its range.
    """

    gate: float = GATE  #: probability with which a right measurement is accepted
    #: probability that a load cell is wrong, over that of all sensors being right; 0 for load
    #: cells that are never wrong
    cell_fault: float = 0.0
    sensor_fault: float = 0.0  #: the same ratio for any other sensor
    #: time until an estimate that is contradicted begins anew [s]; 0 for never
    recover_after: float = 0.0

    def __post_init__(self) -> None:
        """Validate."""
        for name, lowest, highest, expected in (
            ('gate', math.ulp(0.0), 1.0, 'a probability in (0, 1)'),
            ('cell_fault', 0.0, 1.0, 'a probability in [0, 1)'),
            ('sensor_fault', 0.0, 1.0, 'a probability in [0, 1)'),
            ('recover_after', 0.0, math.inf, 'a finite number >= 0 [s]'),
        ):
            value = getattr(self, name)
            if not is_number(value) or not lowest <= value < highest:
                raise MeasurementError(f'{name} is {shown(value)}, expected {expected}')

    @property
    def doubts_any(self) -> bool:
        """Whether a sensor may be wrong for longer than one message."""
        return bool(self.cell_fault or self.sensor_fault)

    def improbability(self, doubts: Doubts, cells: Doubts) -> float:
        """Return -ln of the prior probability of ``doubts`` [nat], given all load ``cells``."""
        count = len(doubts & cells)
        of_cells = _ALL if count > DOUBTS else count
        parts = (of_cells, self.cell_fault), (len(doubts - cells), self.sensor_fault)
        return -sum((count * math.log(part) for count, part in parts if count), 0.0)


class Channels:
    """The sensors of the numbers of several measurements.

    Attributes:
        names: name of the sensor of each number, (m,).
        is_same: whether two numbers are of the same sensor, (m, m).
        counts: how many numbers the sensor of each number measures, (m,).
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        """Group numbers by the ``names`` (m,) of their sensors."""
        self.names = names
        self.is_same = np.array([[name == other_name for name in names] for other_name in names])
        self.counts = self.is_same.sum(axis=1)

    def limits(self, gate: float) -> FloatArray:
        """Return the largest normalised square that the ``gate`` accepts of each sensor, (m,)."""
        return np.array([chi_square_limit(gate, count) for count in self.counts.tolist()])

    def is_in(self, doubts: Doubts) -> NDArray[np.bool_]:
        """Return which numbers are of sensors in ``doubts``, (m,)."""
        return np.array([name in doubts for name in self.names])

    def squares(self, innovation: FloatArray, expected: FloatArray) -> FloatArray:
        """Return the normalised square of the sensor of each number, (hypotheses, m).

        The ``innovation`` (hypotheses, m) has the covariance ``expected`` (hypotheses, m, m).
        """
        solved = np.linalg.solve(expected * self.is_same, innovation[..., np.newaxis])[..., 0]
        return np.asarray((innovation * solved) @ self.is_same)


channels_of = functools.lru_cache(maxsize=64)(Channels)


class Innovation(NamedTuple):
    """The difference of one measurement from its prediction."""

    name: str  #: name of the measurement, or of one load cell that was refused
    value: FloatArray  #: measured less predicted before it, linearised about the estimate, (m,)
    #: expected covariance of the value, linearised about the estimate, (m, m)
    covariance: FloatArray
    #: square of the value by the covariance; chi-square if noise is right
    normalised_square: float
    is_accepted: bool  #: whether the measurement was used


@dataclass
class Consistency:
    """Statistics of the innovations of one kind of measurement."""

    accepted: int = 0  #: number of accepted measurements
    refused: int = 0  #: number of measurements that the gate refused
    #: sum of their normalised squares; chi-square of `size` degrees if noise is right
    square: float = 0.0
    size: int = 0  #: number of numbers in the accepted ones
    #: normalised square and size of the newest accepted ones
    recent: collections.deque[tuple[float, int]] = field(
        default_factory=lambda: collections.deque(maxlen=RECENT)
    )
    refused_from: int | None = None  #: stamp of the first refused one [ns]; None if there is none
    refused_to: int | None = None  #: stamp of the last refused one [ns]; None if there is none

    @property
    def mean(self) -> float:
        """Mean normalised square per number: about 1 if the noise is right, NaN without data."""
        return self.square / self.size if self.size else math.nan

    def count(self, stamp_ns: int, innovation: Innovation) -> None:
        """Count an ``innovation`` of a message with this stamp [ns]."""
        if innovation.is_accepted:
            self.accepted += 1
            self.square += innovation.normalised_square
            self.size += innovation.value.size
            self.recent.append((innovation.normalised_square, innovation.value.size))
            return
        self.refused += 1
        if self.refused_from is None:
            self.refused_from = stamp_ns
        self.refused_to = stamp_ns
