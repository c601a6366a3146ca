"""The topics of arms, tensions and displacements in a bag, in any namespace, and their reading."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

from octo_arm_model.arm.errors import BagError, ConfigError, listed
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import finite
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.types import STRING
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import naming, parameters_of
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, TENDON_LENGTHS, TENSION_ESTIMATES
from octo_arm_model.wire.estimate import ESTIMATES
from octo_arm_model.wire.measurements import MEASUREMENT_TOPICS
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import (
    DISPLACEMENT_TYPE,
    DISPLACEMENTS,
    TENSION_TOPICS,
    FieldMessage,
    read_displacements,
)

# The topics of the model's answers, with their types; they are never measurements.
ANSWERS: dict[str, str] = {
    **BACKBONE_TOPICS,
    TENDON_LENGTHS: 'sensor_msgs/msg/JointState',
    TENSION_ESTIMATES: 'octo_arm_msgs/msg/TendonTensions',
}
DESCRIPTION = 'arm_description'  # the arm as a ROS parameter file, from the node
MIDLINE = 'camera/midline'
TABLE = 'octo_arm_table'  # in the metadata of a bag made from a table: the name of the table
_USUAL = (*TENSION_TOPICS, MIDLINE)  # usual topics of measured tensions or midlines
_MEASURED = (*_USUAL, *MEASUREMENT_TOPICS)  # usual topics of all measurements


def names(topic: str, *usual: str) -> bool:
    """Whether ``topic`` is one of the ``usual`` names, in any namespace."""
    return f'/{topic}'.endswith(tuple(f'/{name}' for name in usual))


def namespace(topic: str, usual: Iterable[str]) -> str:
    """Return the namespace, with the slash, of a ``topic`` of a ``usual`` name or any other."""
    for name in usual:
        if names(topic, name):
            return topic.removesuffix(name)
    return topic[: topic.rfind('/') + 1]


TYPES = tuple(kind.type_name for kind in TENSION_TOPICS.values())
_KINDS = {kind.type_name: kind for kind in TENSION_TOPICS.values()}
_LISTED = 20


class Reading(NamedTuple):
    """The tensions or displacements in a message, or the reason why it was refused."""

    stamp: Stamp  #: stamp of the message; its time of receipt if it has none, or no valid one
    #: tensions of `Arm.tension_shape` [N]; None if refused, or with displacements
    tensions: FloatArray | None
    reason: str  #: reason why the message was refused, or ''
    #: length reeled in [m] by name of the tendons driven by length; None if there are none
    displacements: dict[str, float] | None = None


class Source(NamedTuple):
    """A topic, and perhaps a field, that tensions or displacements are read from."""

    topic: str  #: topic of the messages
    field: str = ''  #: field that holds the numbers, or '' for the usual field of the type
    is_displacements: bool = False  #: whether they are displacements

    def read(
        self, reader: BagReader, config: Config, record: Record, *, raw: bool = False
    ) -> Reading:
        """Return the reading of a ``record`` for the arm and the sensors of ``config``.

        ``raw`` tensions may be below zero by noise.
        """
        cells, arm = config.load_cells, config.arm
        if self.is_displacements:
            read_lengths = partial(
                read_displacements, arm=arm, encoders=config.encoders, field=self.field
            )
            stamp, lengths_by_tendon, reason = reader.read(record, read_lengths)
            return Reading(stamp, None, reason, lengths_by_tendon)
        by_field = FieldMessage(record.type_name, self.field)
        kind = by_field if self.field else _KINDS[record.type_name]

        def calibrated(message: Any) -> FloatArray:
            readings = kind.read(message, arm, cells.names)
            if not raw:
                return cells.tensions(arm, readings)
            tensions = cells.scale_and_offset(readings)
            for name, tension in zip(arm.tendon_names, tensions.ravel().tolist(), strict=True):
                finite(f'reading of {name}', tension, 'a finite number [N]')
            return tensions

        return Reading(*reader.read(record, calibrated))


class ArmTopics:
    """The topics of a bag that the inputs of one arm are chosen from.

    Attributes:
        reader: the bag.
        types: types by topic: all but those of arms in other namespaces.
    """

    def __init__(self, reader: BagReader, prefix: str | None = None) -> None:
        """Hide the topics of other arms if ``prefix`` is the namespace of an arm, with the slash.

        An arm is where there are tensions or displacements.
        """
        self.reader, self.types = reader, reader.topics
        tendons = (*TENSION_TOPICS, DISPLACEMENTS)
        arms = {namespace(name, tendons) for name in reader.topics if names(name, *tendons)}
        if prefix not in arms:
            return
        self.types = {}
        for topic, type_name in reader.topics.items():
            arm = max((name for name in arms if topic.startswith(name)), key=len, default=prefix)
            # A topic of another name without a namespace may be of a camera that sees all arms.
            if arm == prefix or (arm == '/' and not names(topic, *_MEASURED, DESCRIPTION)):
                self.types[topic] = type_name

    @classmethod
    def beside(cls, reader: BagReader, named: str | None) -> 'ArmTopics':
        """Return the topics of the arm of the topic ``named``, or of all arms if that is None."""
        if named is None:
            return cls(reader)
        return cls(reader, namespace(reader.full_name(named.partition(':')[0]), _MEASURED))

    def named(self, chosen: str, types: Sequence[str] | None, what: str) -> str:
        """Return the full name of the topic ``chosen`` for ``what``; None for any type.

        Raises:
            BagError: if there is no such topic, or it is of none of ``types``, or of no known one.
        """
        reader, topic = self.reader, self.reader.full_name(chosen)
        if topic not in reader.topics:
            raise BagError(f'{reader.path}: no topic {chosen} for {what}; {reader.listing}')
        if types is not None and reader.topics[topic] not in types:
            raise BagError(
                f'{reader.path}: topic {topic} is of {reader.topics[topic]}, expected '
                f'{" or ".join(types)} for {what}'
            )
        reader.types_of(reader.topics[topic])
        return topic

    def usual(self, name: str, types: Sequence[str]) -> list[str]:
        """Return the topics of the usual ``name`` that have messages of one of ``types``."""
        return [
            topic
            for topic, type_name in self.types.items()
            if names(topic, name) and type_name in types and self.reader.count([topic])
        ]

    def named_or_usual(
        self, chosen: str | None, name: str, types: Sequence[str], what: str
    ) -> str | None:
        """Return the topic that ``what`` is read from: ``chosen``, or the only usual one, or None.

        Raises:
            BagError: as `named`, or if there are several usual ones.
        """
        if chosen is not None:
            return self.named(chosen, types, what)
        return self._only(self.usual(name, types), what)

    def measured(
        self, types: Sequence[str], what: str, without: Collection[str] = ()
    ) -> str | None:
        """Return the only topic of one of ``types`` that ``what`` was measured on; None if none.

        Topics of the model's answers and of displacements are not taken, nor those ``without``,
        because they are read as something else. Among several topics those with messages are
        preferred, then those of a usual name such as tendon_tensions, in any namespace.

        Raises:
            BagError: if there are several.
        """
        others = (*ANSWERS, *ESTIMATES, DISPLACEMENTS)
        candidates = [
            topic
            for topic, type_name in self.types.items()
            if type_name in types and topic not in without and not names(topic, *others)
        ]
        for narrower in (
            [topic for topic in candidates if self.reader.count([topic])],
            [topic for topic in candidates if names(topic, *_USUAL)],
        ):
            if len(candidates) > 1 and narrower:
                candidates = [topic for topic in candidates if topic in narrower]
        return self._only(candidates, what)

    def _only(self, topics: Sequence[str], what: str) -> str | None:
        if len(topics) > 1:
            raise BagError(
                f'{self.reader.path}: several topics of {what}, name one of {listed(topics)}'
            )
        return topics[0] if topics else None

    def pick(
        self, chosen: str | None, types: Sequence[str], what: str, without: Collection[str] = ()
    ) -> str:
        """Return the topic that ``what`` is read from: ``chosen``, or the only `measured` one.

        Raises:
            BagError: if there is no such topic, or several; the message lists the existing ones.
        """
        if chosen is not None:
            return self.named(chosen, types, what)
        reader, only = self.reader, self.measured(types, what, without)
        if only is not None:
            return self.named(only, types, what)
        answers = [one for one, kind in self.types.items() if kind in types and one not in without]
        hint = f'{answers[0]} is no measurement unless an option names it; ' if answers else ''
        expected = f'expected {" or ".join(types)}'
        raise BagError(f'{reader.path}: no {what}, {expected}; {hint}{reader.listing}')

    def tensions(self, chosen: str | None, without: Collection[str] = ()) -> 'Source':
        """Return the source of tensions on the topic ``chosen``, TOPIC or TOPIC:FIELD.

        None takes the only topic besides ``without``, which is read as something else.

        Raises:
            BagError: if there is none; the message lists the numeric fields of other types.
        """
        if chosen is not None and ':' in chosen:
            return self._field(chosen, 'tensions')
        try:
            return Source(self.pick(chosen, TYPES, 'tensions', without))
        except BagError as error:
            others = [chosen] if chosen is not None else list(self.reader.topics)
            raise BagError(f'{error}{self._fields_of(others)}') from None

    def displacements(self, chosen: str | None) -> 'Source | None':
        """Return the source of displacements on the topic ``chosen``, TOPIC or TOPIC:FIELD.

        None takes tendon_displacements, if there is such a topic.

        Raises:
            BagError: if there is no such topic or field, or there are several.
        """
        if chosen is not None and ':' in chosen:
            return self._field(chosen, 'displacements')
        kinds = (DISPLACEMENT_TYPE,)
        topic = self.named_or_usual(chosen, DISPLACEMENTS, kinds, 'displacements')
        return None if topic is None else Source(topic, '', True)

    def _field(self, chosen: str, what: str) -> 'Source':
        """Return the source ``chosen``, TOPIC:FIELD; BagError lists the existing fields."""
        name, _, field = chosen.partition(':')
        reader, topic = self.reader, self.named(name, None, what)
        fields = reader.numeric_fields(reader.topics[topic])
        if re.sub(r'\[\d+\]', '', field) not in fields:
            raise BagError(
                f'{reader.path}: {topic} ({reader.topics[topic]}) has no numeric field {field!r}; '
                f'it has {", ".join(fields) or "none"}'
            )
        return Source(topic, field, what == 'displacements')

    def _fields_of(self, topics: Sequence[str]) -> str:
        """Return a text that lists numeric fields on ``topics`` whose types are not in `TYPES`."""
        texts = []
        for topic in map(self.reader.full_name, topics[:_LISTED]):
            type_name = self.reader.topics.get(topic, '')
            if type_name and type_name not in TYPES:
                if fields := self.reader.numeric_fields(type_name):
                    texts.append(f'{topic}:{{{",".join(fields)}}}')
        return f'; any numeric field will do, as TOPIC:FIELD: {" ".join(texts)}' if texts else ''


class RecordedArm(NamedTuple):
    """An arm whose tensions or displacements are in a bag."""

    prefix: str  #: namespace of its topics, with the slash
    sources: tuple[Source, ...]  #: sources of its tensions and displacements
    parameters: Mapping[str, Any]  #: parameters of the arm, as for `Config.from_parameters`


def find_arms(
    reader: BagReader,
    topics: Sequence[str] = (),
    parameters: Mapping[str, Any] | None = None,
    model: str | None = None,
    calibration: Mapping[str, Any] = MappingProxyType({}),
    displacements: Sequence[str] = (),
) -> list[RecordedArm]:
    """Find the arms in a bag, one for each namespace of tensions or displacements.

    Args:
        reader: the bag.
        topics: topics of tensions and displacements, or TOPIC:FIELD; if empty, all with names that
            the node listens to, or else the only one.
        parameters: parameters of the arms; None for the arm_description in the bag.
        model: model that replaces theirs.
        calibration: parameters of load cells and encoders that replace theirs.
        displacements: further topics of displacements, or TOPIC:FIELD.

    Raises:
        BagError: if there are no tensions, a topic is named twice, or by `sensed_by`.
        ConfigError: if there is no description.
    """
    offered = ArmTopics(reader)
    displaced = list(filter(None, map(offered.displacements, displacements)))
    picked = []
    for topic in topics:
        name = reader.full_name(topic)
        is_usual = names(name, DISPLACEMENTS) and reader.topics.get(name) == DISPLACEMENT_TYPE
        picked.append(Source(name, '', True) if is_usual else offered.tensions(topic))
    if len({one.topic for one in picked}) < len(picked):
        raise BagError(f'--topics names {" ".join(topics)}, expected each topic once')
    if not topics:
        usual = {} if displaced else {DISPLACEMENTS: DISPLACEMENT_TYPE}
        usual |= {name: kind.type_name for name, kind in TENSION_TOPICS.items()}
        for name, kind in usual.items():
            found = offered.usual(name, (kind,))
            picked += [Source(topic, '', name == DISPLACEMENTS) for topic in found]
        picked = sorted(picked) or ([] if displaced else [offered.tensions(None)])
    by_prefix: dict[str, list[Source]] = {}
    for source in {one.topic: one for one in (*picked, *displaced)}.values():
        prefix = namespace(source.topic, (*TENSION_TOPICS, DISPLACEMENTS))
        by_prefix.setdefault(prefix, []).append(source)
    arms = []
    for prefix, sources in by_prefix.items():
        described = parameters if parameters is not None else describe(reader, prefix)
        values = sensed_by(reader, described, calibration)
        values |= {} if model is None else {'model': model}
        arms.append(RecordedArm(prefix, tuple(sources), values))
    return arms


def sensed_by(
    reader: BagReader, parameters: Mapping[str, Any], calibration: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the ``parameters`` for a bag, whose ``calibration`` replaces theirs.

    Raises:
        BagError: if there is a ``calibration`` for a bag made from a table, whose readings have
            had theirs.
    """
    if TABLE not in reader.metadata:
        return {**parameters, **calibration}
    if calibration:
        raise BagError(
            f'{reader.path}: made from {reader.metadata[TABLE]}, its readings are those of '
            'tendons, so --tendons, --motors and --spools have no effect'
        )
    return as_described(parameters)


def as_described(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ``parameters`` without calibration, which readings in a table's bag have had."""
    calibrated = (
        'tension_names',
        'displacement_names',
        'displacement_scale',
        'displacement_offset',
    )
    return {name: value for name, value in parameters.items() if name not in calibrated}


def describe(reader: BagReader, prefix: str = '/') -> dict[str, Any]:
    """Return the last parameters of an arm that a bag describes.

    It is the arm of the namespace ``prefix``, or else the only one.

    Raises:
        ConfigError: if there is no description, or it describes no valid arm.
        BagError: if the bag is damaged.
    """
    topics = ArmTopics(reader, prefix).usual(DESCRIPTION, (STRING,))
    if prefix + DESCRIPTION in topics:
        topics = [prefix + DESCRIPTION]
    if len(topics) != 1:
        problem = f'several topics {DESCRIPTION}' if topics else f'no topic {DESCRIPTION}'
        raise ConfigError(f'{reader.path}: it has {problem}, so say which arm it was by --config')
    for last in reader.messages(topics):
        record = last
    with naming(f'{reader.path}, {topics[0]}'):
        values = parameters_of(reader.decode(record).data)
        Config.from_parameters(values)
    return values
