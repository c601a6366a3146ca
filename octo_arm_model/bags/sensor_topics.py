"""Inputs of an estimator in a bag: its topics, and measurements by their stamps."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.errors import BagError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.validation import LARGEST
from octo_arm_model.bags import topics
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import TYPES, Source, pick_displacements, pick_tensions
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.measurements import Measurement, Tensions
from octo_arm_model.wire.measurements import MARKERS, MEASUREMENT_TOPICS, MeasuredArm
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENSION_TOPICS

NONE = '-'  # in place of a topic that is not to be used
MOST_MESSAGES = 1_000_000  # of all topics; they are kept until all are read


class StampedMeasurement(NamedTuple):
    """A measurement, when it was made and when it was recorded.

    Attributes:
        stamp_ns: when [ns].
        received_ns: when the recorder received it [ns].
        measurement: what.
    """

    stamp_ns: int
    received_ns: int
    measurement: Measurement


class RecordedTensions(NamedTuple):
    """Readings of load cells, calibrated, below zero where noise takes them there.

    Attributes:
        stamps_ns: (n,) [ns].
        received_ns: when the recorder received them, (n,) [ns].
        rows: (n, tendons) [N].
    """

    stamps_ns: IntArray
    received_ns: IntArray
    rows: FloatArray


@dataclass(frozen=True)
class SensorTopics:
    """The topics of one arm.

    Attributes:
        tensions: where those are; None for nowhere.
        others: topics by their row of `MEASUREMENT_TOPICS`.
        options: how each of these is read, besides its message and the arm.
    """

    tensions: Source | None
    others: Mapping[str, str]
    options: Mapping[str, Mapping[str, Any]]

    @property
    def all(self) -> list[str]:
        """All of them."""
        own = [] if self.tensions is None else [self.tensions.topic]
        return [*own, *self.others.values()]

    @property
    def prefix(self) -> str:
        """Namespace of the first of a usual name, or else of the first, with the slash."""
        usual = (*TENSION_TOPICS, *MEASUREMENT_TOPICS)
        known = [topic for topic in self.all if topics.names(topic, *usual)]
        return topics.namespace((known or self.all)[0], usual)


def find_sensors(
    reader: BagReader,
    tensions: str | None = None,
    others: Mapping[str, str | None] | None = None,
    marker_names: Sequence[str] = (),
) -> SensorTopics:
    """The topics that an arm is estimated from.

    Args:
        reader: the bag.
        tensions: topic of the tensions, or TOPIC:FIELD, or `NONE`; None for the only one there is.
        others: topics by their row of `MEASUREMENT_TOPICS`, of displacements and markers perhaps
            TOPIC:FIELD, or `NONE`; None for those of the usual name, in whatever namespace.
        marker_names: of the markers, see `points_of`.

    Raises:
        BagError: if a topic is missing, of another type, or there are several; if there is
            nothing at all.
    """
    named = (one for one in (tensions, *(others or {}).values()) if one not in (None, NONE))
    topics.offer_one_arm(reader, next(named, None))
    found: dict[str, str] = {}
    options: dict[str, dict[str, Any]] = {}
    for name, row in MEASUREMENT_TOPICS.items():
        wanted = (others or {}).get(name)
        if wanted == NONE:
            continue
        own: dict[str, Any] = {'names': marker_names} if name == MARKERS else {}
        if name == DISPLACEMENTS:
            source = pick_displacements(reader, wanted) or Source('')
            topic, own['field'] = source.topic, source.field
        elif name == MARKERS and ':' in (wanted or ''):
            topic, _, own['field'] = str(wanted).partition(':')
            topic = topics.pick_topic(reader, topic, None, name)
        else:
            topic = topics.pick_usual(reader, wanted, name, (row.type_name,), name) or ''
        if topic:
            found[name], options[topic] = topic, own
    cells: Source | None = None
    if tensions is not None and tensions != NONE:
        cells = pick_tensions(reader, tensions)
    elif tensions is None:
        silent = [topic for topic in reader.topics if not reader.count([topic])]
        only = topics.measured_topic(reader, TYPES, 'tensions', {*found.values(), *silent})
        cells = None if only is None else Source(only)
    sensors = SensorTopics(cells, found, options)
    if not sensors.all:
        raise BagError(
            f'{reader.path}: nothing is measured there, expected tensions or '
            f'{", ".join(MEASUREMENT_TOPICS)}; {reader.listing}'
        )
    return sensors


def read_tension_rows(
    reader: BagReader,
    sensors: SensorTopics,
    config: Config,
    refusals: Refusals,
    done: Callable[[int], None] = lambda count: None,
) -> RecordedTensions:
    """All tensions, in the order in which they were received.

    ``refusals`` count the messages left out; ``done`` is called with how many were read.

    Raises:
        BagError: if the bag is damaged, or holds too much.
    """
    if reader.count(sensors.all) > MOST_MESSAGES:
        count = reader.count(sensors.all)
        raise BagError(f'{reader.path}: {count} messages measured, at most {MOST_MESSAGES}')
    times, rows = [], []
    for record in reader.messages([sensors.tensions.topic]) if sensors.tensions else ():
        assert sensors.tensions is not None
        reading = sensors.tensions.read(reader, config, record, raw=True)
        row = np.zeros(0) if reading.tensions is None else reading.tensions.ravel()
        # Those that are no numbers, too: the measurement would refuse them.
        wrong = ~(np.abs(row) <= LARGEST)
        if reading.tensions is None:
            refusals.count(record.topic, reading.reason)
        elif wrong.any():
            number = int(wrong.argmax())
            reason = (
                f'reading of {config.arm.tendon_names[number]} is {row[number]:g} N, expected a '
                f'finite number of at most {LARGEST:g}'
            )
            refusals.count(record.topic, reason)
        else:
            times.append((reading.stamp_ns, record.received_ns))
            rows.append(row)
        done(1)
    table = np.array(rows, np.float64).reshape(-1, len(config.arm.tendons))
    stamps, received = np.array(times, np.int64).reshape(-1, 2).T
    return RecordedTensions(stamps, received, table)


def read_measured(
    reader: BagReader,
    sensors: SensorTopics,
    tensions: RecordedTensions,
    arm: MeasuredArm,
    refusals: Refusals,
    done: Callable[[int], None] = lambda count: None,
) -> list[list[StampedMeasurement]]:
    """Everything measured, by its stamp: what has the same one is together.

    Raises:
        BagError: if the bag is damaged.
    """
    found = [
        StampedMeasurement(int(stamp), int(received), Tensions(row, arm.noise.tension))
        for stamp, received, row in zip(*tensions)
    ]
    rows = {topic: MEASUREMENT_TOPICS[name] for name, topic in sensors.others.items()}

    for record in reader.messages(list(rows)):
        done(1)
        read = partial(rows[record.topic].read, arm=arm, **sensors.options[record.topic])
        stamp, measurement, reason = reader.read(record, read)
        if measurement is None:
            refusals.count(record.topic, reason)
        else:
            found.append(StampedMeasurement(stamp.ns, record.received_ns, measurement))
    found.sort(key=lambda one: one.stamp_ns)
    return [list(group) for _, group in itertools.groupby(found, key=lambda one: one.stamp_ns)]
