"""Displacements of winches read from a bag, message by message, refusals included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.records import Record
from octo_arm_model.bags.tensions import Reading, reading_of, stampable
from octo_arm_model.bags.topics import names, pick_topic
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import BagError
from octo_arm_model.wire.displacement_messages import TOPIC, TYPE_NAME, read_displacements
from octo_arm_model.wire.stamp import Stamp


class DisplacementTopic:
    """Reads the messages of one topic as the node reads them."""

    def __init__(self, reader: BagReader, arm: Arm) -> None:
        """Read from ``reader`` for ``arm``."""
        self._reader, self._arm = reader, arm

    def read(self, records: Sequence[Record]) -> list[Reading]:
        """Displacements of each of ``records``, or why it was refused."""
        return [stampable(reading_of(self._reader, record, self._read)) for record in records]

    def _read(self, message: Any, stamp: Stamp) -> Reading:
        return Reading(stamp, None, '', read_displacements(message, self._arm))


def read_topic(reader: BagReader, topic: str, arm: Arm) -> Iterator[Reading]:
    """Every message of ``topic``, read as the node reads it.

    Raises:
        BagError: if the bag is damaged.
    """
    displacements = DisplacementTopic(reader, arm)
    for record in reader.messages([topic]):
        yield from displacements.read([record])


def pick_displacements(reader: BagReader, wanted: str | None) -> str | None:
    """Topic of displacements: ``wanted``, or that with the usual name; None where there is none.

    Raises:
        BagError: if there is no ``wanted`` one, it is of another type, or there are several.
    """
    if wanted is not None:
        return pick_topic(reader, wanted, (TYPE_NAME,), 'displacements')
    found = [
        topic
        for topic, type_name in reader.topics.items()
        if holds_displacements(topic, type_name) and reader.count([topic])
    ]
    if len(found) > 1:
        raise BagError(
            f'{reader.path}: several topics of displacements, name one of {", ".join(found)}'
        )
    return found[0] if found else None


def holds_displacements(topic: str, type_name: str) -> bool:
    """Whether messages of a type on ``topic`` are displacements for the node."""
    return names(topic, TOPIC) and type_name == TYPE_NAME
