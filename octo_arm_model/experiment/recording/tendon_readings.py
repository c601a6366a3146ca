"""What load cells and encoders read of tendons, from topics of a bag or from CSV files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from octo_arm_model.config.config import Config
from octo_arm_model.core.errors import BagError
from octo_arm_model.experiment.recording.count import Count
from octo_arm_model.experiment.recording.csv_recording import (
    NO_READING,
    CsvSources,
    csv_displacements,
    csv_tensions,
)
from octo_arm_model.experiment.recording.csv_table import read_csv
from octo_arm_model.experiment.recording.recording import Stamped
from octo_arm_model.wire.displacement_messages import TOPIC, TYPE_NAME
from octo_arm_model.wire.refusals import Refusals

if TYPE_CHECKING:
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.bags.store.records import Record
    from octo_arm_model.bags.tensions import Reading


def pick_topics(
    reader: BagReader, topics: tuple[str | None, str | None], files: CsvSources
) -> tuple[tuple[str, str] | None, str | None]:
    """Topic of tensions and its field, and topic of displacements; None of what is not in a bag.

    Raises:
        BagError: if there is neither, or a topic is missing.
    """
    from octo_arm_model.bags.tensions import pick_tensions
    from octo_arm_model.bags.topics import pick_usual

    tensions, displacements = topics
    encoders = None
    if files.displacements is None:
        encoders = pick_usual(reader, displacements, TOPIC, (TYPE_NAME,), 'displacements')
    if files.tensions is not None:
        return None, encoders
    try:
        return pick_tensions(reader, tensions, encoders), encoders
    except BagError:
        if tensions is not None or (encoders is None and files.displacements is None):
            raise
        return None, encoders


def read_tendons(
    reader: BagReader | None,
    picked: tuple[str, str] | None,
    encoders: str | None,
    files: CsvSources,
    config: Config,
    refusals: Refusals,
    count: Count,
) -> tuple[Stamped | None, Stamped | None]:
    """Tensions and encoder readings; None of what there is not.

    Raises:
        BagError: if what there is has no readings of this arm.
    """
    tensions = displacements = None
    if picked is not None:
        from octo_arm_model.bags.tensions import TensionTopic

        assert reader is not None
        topic, field = picked
        read = TensionTopic(reader, config, field).read
        tensions = _of_topic(reader, topic, read, config, refusals, count)
    elif files.tensions is not None:
        table = read_csv(files.tensions, files.columns, count)
        tensions = Stamped(str(files.tensions), *csv_tensions(table, config, refusals))
    if encoders is not None:
        from octo_arm_model.bags.displacements import DisplacementTopic

        assert reader is not None
        read = DisplacementTopic(reader, config.arm).read
        displacements = _of_topic(reader, encoders, read, config, refusals, count)
    elif files.displacements is not None:
        table = read_csv(files.displacements, files.columns, count)
        found = csv_displacements(table, config.arm, refusals)
        displacements = Stamped(str(files.displacements), *found)
    for what, stamped in (('tensions', tensions), ('encoder readings', displacements)):
        if stamped is not None and not stamped.rows:
            raise BagError(f'no {what} for this arm on {stamped.source}{refusals.in_short}')
    return tensions, displacements


def _of_topic(
    reader: BagReader,
    topic: str,
    read: Callable[[Sequence[Record]], list[Reading]],
    config: Config,
    refusals: Refusals,
    count: Count,
) -> Stamped:
    """What ``read`` makes of the messages of a ``topic`` and does not refuse."""
    from octo_arm_model.bags.tensions import read_topic

    stamped, names = Stamped(topic, [], []), config.arm.tendon_names
    count.expect(reader.count([topic]))
    for _, one in read_topic(reader, topic, read):
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
