"""Tensions out of a bag, message by message, refusals included."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.bags.reader import BagReader, Record, stamp_of
from octo_arm_model.bags.types import known_types
from octo_arm_model.config.config import Config
from octo_arm_model.config.load_cells import LoadCellCalibration
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import OctoArmError, TensionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.wire.tension_messages import READERS
from octo_arm_model.wire.tension_template import Stamp

TYPES = tuple(type_name for type_name, _ in READERS.values())
_READ = dict(READERS.values())
# The numbers are the last field of every type of tensions.
_NUMBERS = {
    'octo_arm_msgs/msg/TendonTensions': 'tension',
    'std_msgs/msg/Float64MultiArray': 'data',
    'sensor_msgs/msg/JointState': 'effort',
}
_TOGETHER = 128  # messages read at once


class Reading(NamedTuple):
    """What a message says.

    Attributes:
        stamp: its stamp, see `stamp_of`, sec and nanosec as they came.
        tensions: of `Arm.tension_shape` [N]; None if it was refused.
        reason: why it was refused, or ''.
    """

    stamp: Stamp
    tensions: FloatArray | None
    reason: str

    @property
    def stamp_ns(self) -> int:
        """Its stamp [ns]."""
        return self.stamp.ns


def read_tensions(reader: BagReader, topic: str, config: Config) -> Iterator[Reading]:
    """Every message of ``topic``, read as the node reads it.

    Raises:
        BagError: if there is no such topic, it is of none of `TYPES` or the bag is damaged.
    """
    tensions = TensionTopic(reader, config)
    records = reader.messages([reader.pick(topic, TYPES, 'tensions')])
    while some := list(itertools.islice(records, _TOGETHER)):
        yield from tensions.read(some)


class TensionTopic:
    """Reads the messages of one topic, many at once.

    A recording repeats the names of the tendons in every message, so whatever is alike in all but
    stamp and numbers is decoded once.
    """

    def __init__(self, reader: BagReader, config: Config) -> None:
        """Read from ``reader`` for the arm and the load cells of ``config``."""
        self._reader, self._arm, self._load_cells = reader, config.arm, config.load_cells
        self._pattern: _Pattern | None = None

    def read(self, records: Sequence[Record]) -> list[Reading]:
        """What each of ``records`` says."""
        readings: dict[int, Reading] = {}
        if self._pattern is not None:
            readings = self._pattern.read(records, self._arm, self._load_cells)
        return [
            _stampable(readings[number] if number in readings else self._read_alone(record))
            for number, record in enumerate(records)
        ]

    def _read_alone(self, record: Record) -> Reading:
        if self._pattern is not None:
            # After the first of its kind.
            found = self._pattern.read([record], self._arm, self._load_cells)
            if found:
                return found[0]
        stamp = Stamp.from_ns(record.received_ns)
        try:
            message = self._reader.decode(record)
            stamp = stamp_of(message, record.received_ns)
            tensions = _READ[record.type_name](message, self._arm)
            self._pattern = _Pattern.of(self._reader, record, message, self._arm) or self._pattern
            return Reading(stamp, self._load_cells.tensions(self._arm, tensions), '')
        except OctoArmError as error:
            return Reading(stamp, None, str(error))
        except (AttributeError, TypeError, ValueError) as error:
            # A type of the usual name that the bag defines otherwise.
            return Reading(stamp, None, f'{record.type_name} of another kind: {error}')


class _Pattern(NamedTuple):
    """What messages of one layout have in common.

    Attributes:
        data: bytes of one of them (length,).
        is_constant: which of them are the same in all (length,).
        has_stamp: whether they begin with a header.
        order: for each tendon of the arm, which of the numbers at the end is its tension.
    """

    data: np.ndarray
    is_constant: np.ndarray
    has_stamp: bool
    order: np.ndarray

    @classmethod
    def of(cls, reader: BagReader, record: Record, message: Any, arm: Arm) -> _Pattern | None:
        """Pattern of a ``message``; None where it is not laid out as usual."""
        name, known = record.type_name, known_types()
        types = reader.types_of(name)
        if types.fielddefs[name] != known.fielddefs[name]:
            return None
        # What changes is found by changing it, every bit of it.
        low, high = (
            bytes(types.serialize_cdr(_filled(message, bit), name, little_endian=True))
            for bit in (0, 1)
        )
        if len(low) != len(record.data):
            return None
        data = np.frombuffer(record.data, np.uint8)
        is_constant = np.frombuffer(low, np.uint8) == np.frombuffer(high, np.uint8)
        if (data != np.frombuffer(low, np.uint8))[is_constant].any():
            return None
        numbers = np.arange(float(len(arm.tendons)))
        numbered = dataclasses.replace(message, **{_NUMBERS[name]: numbers})
        order = _READ[name](numbered, arm).ravel().astype(np.intp)
        return cls(data, is_constant, hasattr(message, 'header'), order)

    def read(
        self, records: Sequence[Record], arm: Arm, load_cells: LoadCellCalibration
    ) -> dict[int, Reading]:
        """Readings of those ``records`` that are of this layout, by their place."""
        size = self.data.size
        places = [number for number, record in enumerate(records) if len(record.data) == size]
        block = np.frombuffer(b''.join(records[number].data for number in places), np.uint8)
        block = block.reshape(len(places), size)
        is_same = (block[:, self.is_constant] == self.data[self.is_constant]).all(axis=1)
        places = list(itertools.compress(places, is_same))
        block = block[is_same]
        stamps = [Stamp.from_ns(records[number].received_ns) for number in places]
        if self.has_stamp:
            sec = block[:, 4:8].copy().view('<i4')[:, 0].tolist()
            nanosec = block[:, 8:12].copy().view('<u4')[:, 0].tolist()
            given = map(Stamp, sec, nanosec)
            stamps = [one if any(one) else received for one, received in zip(given, stamps)]
        numbers = block[:, size - 8 * self.order.size :].copy().view('<f8')[:, self.order]
        tensions = numbers.reshape(-1, *arm.tension_shape)
        try:
            found = load_cells.tensions(arm, tensions)
        except TensionError:
            readings = [_checked(arm, load_cells, *pair) for pair in zip(stamps, tensions)]
        else:
            readings = [Reading(stamp, row, '') for stamp, row in zip(stamps, found)]
        return dict(zip(places, readings))


def _stampable(reading: Reading) -> Reading:
    """The ``reading``, refused where no stamp can hold the time of its receipt."""
    if reading.tensions is None or -(2**31) <= reading.stamp.sec < 2**31:
        return reading
    reason = f'received at {reading.stamp.sec} s, which no stamp can hold'
    return reading._replace(tensions=None, reason=reason)


def _checked(
    arm: Arm, load_cells: LoadCellCalibration, stamp: Stamp, readings: FloatArray
) -> Reading:
    try:
        return Reading(stamp, load_cells.tensions(arm, readings), '')
    except TensionError as error:
        return Reading(stamp, None, str(error))


def _filled(message: Any, bit: int) -> Any:
    """The ``message`` with every bit of its stamp and numbers as ``bit``."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            changes[field.name] = np.full(value.shape, -bit, np.int64).view(np.float64)
    if hasattr(message, 'header'):
        stamp = dataclasses.replace(message.header.stamp, sec=-bit, nanosec=bit * (2**32 - 1))
        changes['header'] = dataclasses.replace(message.header, stamp=stamp)
    return dataclasses.replace(message, **changes)
