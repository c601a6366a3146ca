"""Tensions and displacements read from a bag, message by message, refusals included."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from octo_arm_model.arm.errors import BagError, MessageError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.topics import pick_topic, pick_usual
from octo_arm_model.config.config import Config
from octo_arm_model.wire.stamp import Stamp, time_of
from octo_arm_model.wire.tensions import (
    DISPLACEMENT_TYPE,
    DISPLACEMENTS,
    TENSION_TOPICS,
    FieldMessage,
    read_displacements,
)

TYPES = tuple(kind.type_name for kind in TENSION_TOPICS.values())
_KINDS = {kind.type_name: kind for kind in TENSION_TOPICS.values()}
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
        return _pick_field(reader, wanted, 'tensions')
    try:
        topic = pick_topic(reader, wanted, TYPES, 'tensions', without)
    except BagError as error:
        others = [wanted] if wanted is not None else list(reader.topics)
        others = [reader.full_name(one) for one in others]
        raise BagError(f'{error}{_fields_of(reader, others)}') from None
    return topic, ''


def _pick_field(reader: BagReader, wanted: str, what: str) -> tuple[str, str]:
    """Topic and numeric field that ``wanted``, TOPIC:FIELD, names; BagError lists those there."""
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
        BagError: if there is no such topic or field, or there are several.
    """
    if wanted is not None and ':' in wanted:
        return _pick_field(reader, wanted, 'displacements')
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


def read_tensions(
    reader: BagReader, config: Config, field: str, record: Record, *, raw: bool = False
) -> Reading:
    """Tensions of a ``record``, for the arm and load cells of ``config``, or why it was refused.

    Readings are in ``field``, if that is given; ``raw`` ones may be below zero, as noise is.
    """
    cells, arm = config.load_cells, config.arm
    calibrated = cells.scale_and_offset if raw else partial(cells.tensions, arm)
    kind = FieldMessage(record.type_name, field) if field else _KINDS[record.type_name]
    found = reader.read(record, lambda message: calibrated(kind.read(message, arm, cells.names)))
    return _stampable(Reading(*found))


def read_lengths(reader: BagReader, config: Config, field: str, record: Record) -> Reading:
    """Displacements of a ``record``, as the node reads them, or why it was refused.

    Readings are in ``field``, if that is given.
    """
    read = partial(read_displacements, arm=config.arm, encoders=config.encoders, field=field)
    stamp, found, reason = reader.read(record, read)
    return _stampable(Reading(stamp, None, reason, found))


def _stampable(reading: Reading) -> Reading:
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
