"""The inputs of an estimator in a bag: topics of sensors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import TYPES, ArmTopics, Source, names, namespace
from octo_arm_model.estimation.measurements import Measurement
from octo_arm_model.wire.measurements import MARKERS, MEASUREMENT_TOPICS
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENSION_TOPICS

NONE = '-'  # stands for a topic that is not used


@dataclass(frozen=True)
class SensorTopics:
    """The topics of the sensors of one arm."""

    tensions: Source | None  #: source of the tensions; None if there are none
    others: Mapping[str, str]  #: topics by the names of their rows of `MEASUREMENT_TOPICS`
    #: functions by topic that return the measurement of an ``arm`` in a message there
    readers: Mapping[str, Callable[..., Measurement]]

    @property
    def all(self) -> list[str]:
        """All topics."""
        tensions = [] if self.tensions is None else [self.tensions.topic]
        return [*tensions, *self.others.values()]

    @property
    def prefix(self) -> str:
        """Namespace, with the slash, of the first topic of a usual name, or else of the first."""
        usual = (*TENSION_TOPICS, *MEASUREMENT_TOPICS)
        named = [topic for topic in self.all if names(topic, *usual)]
        return namespace((named or self.all)[0], usual)


def find_sensors(
    reader: BagReader,
    tensions: str | None = None,
    others: Mapping[str, str | None] | None = None,
    marker_names: Sequence[str] = (),
) -> SensorTopics:
    """Find the topics that an arm is estimated from.

    Args:
        reader: the bag.
        tensions: topic of the tensions, or TOPIC:FIELD, or `NONE`; None for the only such topic.
        others: topics by name in `MEASUREMENT_TOPICS`, or `NONE`; for displacements and markers
            also TOPIC:FIELD. None takes those of the usual name in any namespace.
        marker_names: names of the markers, as in `points_of`.

    Raises:
        BagError: if a topic is missing, ambiguous or of another type, or nothing is measured.
    """
    named = (topic for topic in (tensions, *(others or {}).values()) if topic not in (None, NONE))
    offered = ArmTopics.beside(reader, next(named, None))
    by_name: dict[str, str] = {}
    readers: dict[str, Callable[..., Measurement]] = {}
    for name, row in MEASUREMENT_TOPICS.items():
        given = (others or {}).get(name)
        if given == NONE:
            continue
        option: dict[str, Any] = {'names': marker_names} if name == MARKERS else {}
        if name == DISPLACEMENTS:
            source = offered.displacements(given) or Source('')
            topic, option['field'] = source.topic, source.field
        elif name == MARKERS and ':' in (given or ''):
            topic, _, option['field'] = str(given).partition(':')
            topic = offered.named(topic, None, name)
        else:
            topic = offered.named_or_usual(given, name, (row.type_name,), name) or ''
        if topic:
            by_name[name], readers[topic] = topic, partial(row.read, **option)
    source_found: Source | None = None
    if tensions is not None and tensions != NONE:
        source_found = offered.tensions(tensions)
    elif tensions is None:
        empty = [topic for topic in reader.topics if not reader.count([topic])]
        others_read = {*by_name.values(), *empty}
        only = offered.measured(TYPES, 'tensions', others_read)
        source_found = None if only is None else Source(only)
    sensors = SensorTopics(source_found, by_name, readers)
    if not sensors.all:
        raise BagError(
            f'{reader.path}: nothing is measured there, expected tensions or '
            f'{", ".join(MEASUREMENT_TOPICS)}; {reader.listing}'
        )
    return sensors
