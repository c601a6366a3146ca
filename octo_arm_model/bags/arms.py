"""Which arms a bag holds tensions or displacements of, and what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from octo_arm_model.arm.errors import BagError, ConfigError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.tensions import pick_displacements, pick_tensions
from octo_arm_model.bags.topics import DESCRIPTION, holds_displacements, namespace, usual_topics
from octo_arm_model.bags.types import STRING
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import naming, parameters_of
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS, TENSION_TOPICS


class RecordedArm(NamedTuple):
    """An arm whose tensions or displacements are in a bag.

    Attributes:
        prefix: namespace of its topics, with the slash.
        topics: those of both.
        parameters: what it is, see `Config.from_parameters`.
        fields: what holds the numbers, of topics where that is not the usual field.
        displacements: those of ``topics`` that hold displacements.
    """

    prefix: str
    topics: tuple[str, ...]
    parameters: Mapping[str, Any]
    fields: Mapping[str, str] = MappingProxyType({})
    displacements: frozenset[str] = frozenset()


def find_arms(
    reader: BagReader,
    topics: Sequence[str] = (),
    parameters: Mapping[str, Any] | None = None,
    model: str | None = None,
    calibration: Mapping[str, Any] = MappingProxyType({}),
    displacements: Sequence[str] = (),
) -> list[RecordedArm]:
    """The arms in a bag, one for each namespace of tensions or displacements.

    Args:
        reader: the bag.
        topics: those of both, or TOPIC:FIELD; if none, all with the names that the node listens
            to, or else the only one there is.
        parameters: of the arms; None for the arm_description in the bag.
        model: model instead of theirs.
        calibration: parameters of load cells and encoders instead of theirs.
        displacements: further topics of displacements, or TOPIC:FIELD.

    Raises:
        BagError: if there are no tensions, or a topic is named twice.
        ConfigError: if there is no description.
    """
    driven = dict(filter(None, (pick_displacements(reader, one) for one in displacements)))
    if topics:
        named = [_pick(reader, topic) for topic in topics]
        picked = dict(named)
        if len(picked) < len(named):
            raise BagError(f'--topics names {" ".join(topics)}, expected each topic once')
    else:
        found = [] if driven else usual_topics(reader, DISPLACEMENTS, (DISPLACEMENT_TYPE,))
        for usual, kind in TENSION_TOPICS.items():
            found += usual_topics(reader, usual, (kind.type_name,))
        picked = dict.fromkeys(sorted(found), '')
        if not (picked or driven):
            picked = dict([pick_tensions(reader, None)])
    picked |= driven
    by_prefix: dict[str, list[str]] = {}
    for topic in picked:
        by_prefix.setdefault(namespace(topic, (*TENSION_TOPICS, DISPLACEMENTS)), []).append(topic)
    arms = []
    for prefix, own in by_prefix.items():
        values = dict(parameters if parameters is not None else describe(reader, prefix))
        if model is not None:
            values['model'] = model
        values.update(calibration)
        fields = {topic: picked[topic] for topic in own if picked[topic]}
        lengths = frozenset(
            topic
            for topic in own
            if topic in driven
            or (topic not in fields and holds_displacements(topic, reader.topics[topic]))
        )
        arms.append(RecordedArm(prefix, tuple(own), values, fields, lengths))
    return arms


def _pick(reader: BagReader, wanted: str) -> tuple[str, str]:
    """Topic of tensions and its field, see `pick_tensions`, or one of displacements."""
    topic = reader.full_name(wanted)
    if holds_displacements(topic, reader.topics.get(topic, '')):
        return topic, ''
    return pick_tensions(reader, wanted)


def describe(reader: BagReader, prefix: str = '/') -> dict[str, Any]:
    """Parameters of the arm as described in a bag, the last if they changed.

    That of the namespace ``prefix``, or else the only one.

    Raises:
        ConfigError: if there is no description, or that of no arm.
        BagError: if the bag is damaged.
    """
    topics = usual_topics(reader, DESCRIPTION, (STRING,))
    if prefix + DESCRIPTION in topics:
        topics = [prefix + DESCRIPTION]
    if len(topics) != 1:
        what = f'several topics {DESCRIPTION}' if topics else f'no topic {DESCRIPTION}'
        raise ConfigError(f'{reader.path}: it has {what}, so say which arm it was by --config')
    for last in reader.messages(topics):
        record = last
    with naming(f'{reader.path}, {topics[0]}'):
        values = parameters_of(reader.decode(record).data)
        Config.from_parameters(values)
    return values
