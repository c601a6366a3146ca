"""Readings of tendons and measured points out of a bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags.arms import describe, find_arms
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.records import Record
from octo_arm_model.bags.tensions import (
    Reading,
    TensionTopic,
    pick_tensions,
    read_lengths,
    read_topic,
)
from octo_arm_model.bags.topics import pick_usual
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.recording.count import Count
from octo_arm_model.experiment.recording.csv_recording import NO_READING, CsvSources
from octo_arm_model.experiment.recording.recording import Stamped
from octo_arm_model.wire.refusals import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS


class BagRecording:
    """The topics of a bag that tensions and encoder readings come from, where not from files.

    Attributes:
        reader: the bag.
        notes: remarks on it.
    """

    def __init__(
        self,
        reader: BagReader,
        tensions: str | None,
        displacements: str | None,
        files: CsvSources,
    ) -> None:
        """Choose the topics; ``tensions`` and ``displacements`` as in `read_recording`.

        Raises:
            BagError: if there is neither, or a topic is missing.
        """
        self.reader = reader
        self.notes = list(reader.notes)
        if any('synthetic' in text for text in reader.metadata.values()):
            self.notes.insert(0, 'the bag says that it is synthetic')
        self._encoders: str | None = None
        self._tensions: tuple[str, str] | None = None  # topic, and the field they are in
        if files.displacements is None:
            wanted = displacements, DISPLACEMENTS, (DISPLACEMENT_TYPE,), 'displacements'
            self._encoders = pick_usual(reader, *wanted)
        if files.tensions is not None:
            return
        try:
            self._tensions = pick_tensions(reader, tensions, self._encoders)
        except BagError:
            if tensions is not None or (self._encoders is None and files.displacements is None):
                raise

    def parameters(self, given: Mapping[str, Any] | None) -> dict[str, Any]:
        """Parameters of the arm: those ``given``, or else its description in the bag.

        Raises:
            ConfigError: if there is no description.
        """
        wanted = ':'.join(part for part in self._tensions or (self._encoders,) if part)
        if wanted:
            return dict(find_arms(self.reader, [wanted], given)[0].parameters)
        return dict(given) if given is not None else describe(self.reader)

    def tensions(self, config: Config, refusals: Refusals, count: Count) -> Stamped | None:
        """Tensions of the arm of ``config``; None if there is no topic of them."""
        if self._tensions is None:
            return None
        topic, field = self._tensions
        read = TensionTopic(self.reader, config, field).read
        return self._read(topic, read, config, refusals, count)

    def displacements(self, config: Config, refusals: Refusals, count: Count) -> Stamped | None:
        """Encoder readings likewise, NaN of tendons without an encoder."""
        if self._encoders is None:
            return None
        read = partial(read_lengths, self.reader, config.arm)
        return self._read(self._encoders, read, config, refusals, count)

    def _read(
        self,
        topic: str,
        read: Callable[[Sequence[Record]], list[Reading]],
        config: Config,
        refusals: Refusals,
        count: Count,
    ) -> Stamped:
        stamped, names = Stamped(topic, [], []), config.arm.tendon_names
        count.expect(self.reader.count([topic]))
        for _, one in read_topic(self.reader, topic, read):
            count.add()
            if one.is_refused or one.displacements == {}:
                refusals.count(topic, one.reason or NO_READING)
                continue
            stamped.stamps.append(one.stamp_ns)
            if one.tensions is not None:
                row = one.tensions.ravel()
            else:
                given = one.displacements or {}
                row = np.array([given.get(name, np.nan) for name in names])
            stamped.rows.append(row)
        return stamped
