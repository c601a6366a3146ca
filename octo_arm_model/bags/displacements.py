"""Displacements of winches read from a bag, message by message, refusals included."""

from __future__ import annotations

import functools
from collections.abc import Sequence

from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.store.records import Record
from octo_arm_model.bags.tensions import Reading, stampable
from octo_arm_model.bags.topics import names
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.wire.displacement_messages import TOPIC, TYPE_NAME, read_displacements


class DisplacementTopic:
    """Reads the messages of one topic as the node reads them."""

    def __init__(self, reader: BagReader, arm: Arm) -> None:
        """Read from ``reader`` for ``arm``."""
        self._reader, self._arm = reader, arm

    def read(self, records: Sequence[Record]) -> list[Reading]:
        """Displacements of each of ``records``, or why it was refused."""
        return [stampable(self._read(record)) for record in records]

    def _read(self, record: Record) -> Reading:
        read = functools.partial(read_displacements, arm=self._arm)
        stamp, displacements, reason = self._reader.read(record, read)
        return Reading(stamp, None, reason, displacements)


def holds_displacements(topic: str, type_name: str) -> bool:
    """Whether messages of a type on ``topic`` are displacements for the node."""
    return names(topic, TOPIC) and type_name == TYPE_NAME
