"""Tensions and displacements read from a bag, message by message, refusals included."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from octo_arm_model.arm.errors import BagError, MessageError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.topics import pick_topic, pick_usual
from octo_arm_model.bags.types import known_types
from octo_arm_model.config.config import Config
from octo_arm_model.wire.stamp import Stamp, time_of
from octo_arm_model.wire.tension_layout import TensionLayout
from octo_arm_model.wire.tensions import (
    DISPLACEMENT_TYPE,
    DISPLACEMENTS,
    TENSION_TOPICS,
    FieldMessage,
    read_displacements,
)

TYPES = tuple(kind.type_name for kind in TENSION_TOPICS.values())
_KINDS = {kind.type_name: kind for kind in TENSION_TOPICS.values()}
_TOGETHER = 128  # messages read at once
_LISTED = 20


class Reading(NamedTuple):
    """Tensions or displacements of a message, or why it was refused.

    Attributes:
        stamp: its stamp, see `stamp_of`, sec and nanosec as they came.
        tensions: of `Arm.tension_shape` [N]; None if it was refused, or has displacements.
        reason: why it was refused, or ''.
        displacements: length reeled in [m] by name of the tendons driven by length; None if it
            has none of them to say.
    """

    stamp: Stamp
    tensions: FloatArray | None
    reason: str
    displacements: dict[str, float] | None = None

    @property
    def is_refused(self) -> bool:
        """Whether it says neither."""
        return self.tensions is None and self.displacements is None

    @property
    def stamp_ns(self) -> int:
        """Its stamp [ns]."""
        return self.stamp.ns


def read_topic(
    reader: BagReader, topic: str, read: Callable[[Sequence[Record]], list[Reading]]
) -> Iterator[tuple[Record, Reading]]:
    """Every message of ``topic`` and what ``read``, that of its type, makes of it.

    Raises:
        BagError: if there is no such topic, or the bag is damaged.
    """
    records = reader.messages([topic])
    while some := list(itertools.islice(records, _TOGETHER)):
        yield from zip(some, read(some), strict=True)


def pick_tensions(
    reader: BagReader, wanted: str | None, without: str | None = None
) -> tuple[str, str]:
    """Topic of tensions and the field they are in, '' for the usual one of its type.

    ``wanted`` is TOPIC or TOPIC:FIELD; None for the only topic that there is ``without`` one that
    is read as something else.

    Raises:
        BagError: if there is none; the message lists the numeric fields of other types.
    """
    if wanted is not None and ':' in wanted:
        return pick_field(reader, wanted, 'tensions')
    try:
        topic = pick_topic(reader, wanted, TYPES, 'tensions', without)
    except BagError as error:
        others = [wanted] if wanted is not None else list(reader.topics)
        others = [reader.full_name(one) for one in others]
        raise BagError(f'{error}{_fields_of(reader, others)}') from None
    return topic, ''


def pick_field(reader: BagReader, wanted: str, what: str) -> tuple[str, str]:
    """Topic and numeric field that ``wanted``, TOPIC:FIELD, names for ``what``.

    Raises:
        BagError: if there is no such topic or field; the message lists what there is.
    """
    topic, _, field = wanted.partition(':')
    topic = pick_topic(reader, topic, None, what)
    fields = reader.numeric_fields(reader.topics[topic])
    if re.sub(r'\[\d+\]', '', field) not in fields:
        raise BagError(
            f'{reader.path}: {topic} ({reader.topics[topic]}) has no numeric field {field!r}; '
            f'it has {", ".join(fields) or "none"}'
        )
    return topic, field


def pick_displacements(reader: BagReader, wanted: str | None) -> tuple[str, str] | None:
    """Topic of displacements and the field they are in, '' for positions of a JointState.

    ``wanted`` is TOPIC or TOPIC:FIELD; None for tendon_displacements, if there.

    Raises:
        BagError: as `pick_field`, or if there are several.
    """
    if wanted is not None and ':' in wanted:
        return pick_field(reader, wanted, 'displacements')
    kinds = (DISPLACEMENT_TYPE,)
    topic = pick_usual(reader, wanted, DISPLACEMENTS, kinds, 'displacements')
    return None if topic is None else (topic, '')


def _fields_of(reader: BagReader, topics: Sequence[str]) -> str:
    """Numeric fields of the messages on ``topics`` whose types are none of `TYPES`, in words."""
    found = []
    for topic in topics[:_LISTED]:
        type_name = reader.topics.get(topic, '')
        if type_name and type_name not in TYPES:
            if fields := reader.numeric_fields(type_name):
                found.append(f'{topic}:{{{",".join(fields)}}}')
    return f'; any numeric field will do, as TOPIC:FIELD: {" ".join(found)}' if found else ''


class TensionTopic:
    """Reads the messages of one topic: those laid out like one before them many at once."""

    def __init__(
        self, reader: BagReader, config: Config, field: str = '', raw: bool = False
    ) -> None:
        """Read from ``reader`` for the arm and the load cells of ``config``.

        Tensions are in ``field``, if that is given; ``raw`` ones may be below zero, as noise is.
        """
        self._field = field
        self._reader, self._arm, self._load_cells = reader, config.arm, config.load_cells
        cells = config.load_cells
        self._calibrated = cells.scale_and_offset if raw else partial(cells.tensions, config.arm)
        self._layout: TensionLayout | None = None

    def read(self, records: Sequence[Record]) -> list[Reading]:
        """Tensions of each of ``records``, or why it was refused."""
        readings = self._read_alike(records)
        return [
            stampable(readings[number] if number in readings else self._read_alone(record))
            for number, record in enumerate(records)
        ]

    def _read_alike(self, records: Sequence[Record]) -> dict[int, Reading]:
        """Readings of those ``records`` that are of the layout, by their place."""
        if self._layout is None:
            return {}
        places, tensions, given = self._layout.read_all([record.data for record in records])
        stamps = [Stamp.from_ns(records[place].received_ns) for place in places]
        if given is not None:
            stamps = [one if any(one) else received for one, received in zip(given, stamps)]
        try:
            tensions = self._calibrated(tensions)
        except TensionError:
            readings = [self._checked(*pair) for pair in zip(stamps, tensions)]
        else:
            readings = [Reading(stamp, row, '') for stamp, row in zip(stamps, tensions)]
        return dict(zip(places, readings))

    def _read_alone(self, record: Record) -> Reading:
        # The layout may be that of another message of the same batch by now.
        if found := self._read_alike([record]):
            return found[0]
        return Reading(*self._reader.read(record, partial(self._read, record)))

    def _read(self, record: Record, message: Any) -> FloatArray:
        wanted = self._load_cells.names
        if self._field:
            given = FieldMessage(record.type_name, self._field)
            return self._calibrated(given.read_named(message, self._arm, wanted))
        kind = _KINDS[record.type_name]
        if wanted:
            return self._calibrated(kind.read_named(message, self._arm, wanted))
        tensions = kind.read(message, self._arm)
        if self._is_as_known(record.type_name):
            layout = TensionLayout(kind, record.data, message, self._arm)
            self._layout = layout if layout.read(record.data) else self._layout
        return self._calibrated(tensions)

    def _checked(self, stamp: Stamp, readings: FloatArray) -> Reading:
        try:
            return Reading(stamp, self._calibrated(readings), '')
        except TensionError as error:
            return Reading(stamp, None, str(error))

    def _is_as_known(self, type_name: str) -> bool:
        """Whether the bag defines a type as it is known here, so that it has the known layout."""
        types, known = self._reader.types_of(type_name), known_types()
        return types is known or types.hash_rihs01(type_name) == known.hash_rihs01(type_name)


def read_lengths(
    reader: BagReader, config: Config, field: str, records: Sequence[Record]
) -> list[Reading]:
    """Displacements of each of ``records``, as the node reads them, or why it was refused.

    Readings are in ``field``, if that is given.
    """
    read = partial(read_displacements, arm=config.arm, encoders=config.encoders, field=field)
    readings = []
    for record in records:
        stamp, found, reason = reader.read(record, read)
        readings.append(stampable(Reading(stamp, None, reason, found)))
    return readings


def stampable(reading: Reading) -> Reading:
    """The ``reading``, refused where its stamp is no time, or cannot hold that of its receipt."""
    if reading.is_refused:
        return reading
    if not -(2**31) <= reading.stamp.sec < 2**31:
        reason = f'received at {reading.stamp.sec} s, which no stamp can hold'
        return Reading(reading.stamp, None, reason)
    try:
        time_of(reading.stamp)
    except MessageError as error:
        return Reading(reading.stamp, None, str(error))
    return reading
