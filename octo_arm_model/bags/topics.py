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


def arm_of(reader: BagReader, named: str | None) -> str | None:
    """Return the namespace of the arm that the topic ``named`` is of; None if that is None."""
    if named is None:
        return None
    return namespace(reader.full_name(named.partition(':')[0]), _MEASURED)


def offered(reader: BagReader, prefix: str | None) -> dict[str, str]:
    """Return the topics that defaults are chosen from, with their types.

    They are all topics but those of arms in other namespaces than ``prefix``, if that is the
    namespace of an arm: one with tensions or displacements.
    """
    tendons = (*TENSION_TOPICS, DISPLACEMENTS)
    arms = {namespace(name, tendons) for name in reader.topics if names(name, *tendons)}
    if prefix not in arms:
        return reader.topics
    selected = {}
    for topic, type_name in reader.topics.items():
        arm = max((name for name in arms if topic.startswith(name)), key=len, default=prefix)
        # A topic of another name without a namespace may be of a camera that sees all arms.
        if arm == prefix or (arm == '/' and not names(topic, *_MEASURED, DESCRIPTION)):
            selected[topic] = type_name
    return selected


def pick_topic(
    reader: BagReader,
    chosen: str | None,
    types: Sequence[str] | None,
    what: str,
    without: Collection[str] = (),
    prefix: str | None = None,
) -> str:
    """Return the topic that ``what`` is read from: ``chosen``, or the only one of ``types``.

    That is the only one `offered` for the arm of ``prefix``. If ``types`` is None, ``chosen`` may
    be of any type. Topics of the model's answers and of displacements are taken only if
    ``chosen``, and those ``without`` never, because they are read as something else. Among
    several topics those with messages are preferred, then those of a usual name such as
    tendon_tensions, in any namespace.

    Raises:
        BagError: if there is no such topic, or several; the message lists the existing ones.
    """
    expected = ' or '.join(types or ())
    if chosen is not None:
        topic = reader.full_name(chosen)
        if topic not in reader.topics:
            raise BagError(f'{reader.path}: no topic {chosen} for {what}; {reader.listing}')
        if types is not None and reader.topics[topic] not in types:
            raise BagError(
                f'{reader.path}: topic {topic} is of {reader.topics[topic]}, expected {expected} '
                f'for {what}'
            )
        reader.types_of(reader.topics[topic])
        return topic
    types = types or ()
    only = measured_topic(reader, types, what, without, prefix)
    if only is None:
        topics = offered(reader, prefix).items()
        answers = [one for one, kind in topics if kind in types and one not in without]
        hint = f'{answers[0]} is no measurement unless an option names it; ' if answers else ''
        raise BagError(f'{reader.path}: no {what}, expected {expected}; {hint}{reader.listing}')
    reader.types_of(reader.topics[only])
    return only


def measured_topic(
    reader: BagReader,
    types: Sequence[str],
    what: str,
    without: Collection[str] = (),
    prefix: str | None = None,
) -> str | None:
    """Return the only topic of one of ``types`` that ``what`` was measured on; None if none.

    The preferences are those of `pick_topic`. BagError is raised if there are several.
    """
    others = (*ANSWERS, *ESTIMATES, DISPLACEMENTS)
    candidates = [
        topic
        for topic, type_name in offered(reader, prefix).items()
        if type_name in types and topic not in without and not names(topic, *others)
    ]
    for narrower in (
        [topic for topic in candidates if reader.count([topic])],
        [topic for topic in candidates if names(topic, *_USUAL)],
    ):
        if len(candidates) > 1 and narrower:
            candidates = [topic for topic in candidates if topic in narrower]
    return only_one(reader, candidates, what)


def pick_usual(
    reader: BagReader,
    chosen: str | None,
    usual: str,
    types: Sequence[str],
    what: str,
    prefix: str | None = None,
) -> str | None:
    """Return the topic that ``what`` is read from: ``chosen``, or the ``usual`` one; else None.

    Raises:
        BagError: if ``chosen`` does not exist or is of none of ``types``, or there are several
            usual ones.
    """
    if chosen is not None:
        return pick_topic(reader, chosen, types, what)
    return only_one(reader, usual_topics(reader, usual, types, prefix), what)


def usual_topics(
    reader: BagReader, usual: str, types: Sequence[str], prefix: str | None = None
) -> list[str]:
    """Return the topics of the ``usual`` name that have messages of one of ``types``."""
    return [
        topic
        for topic, type_name in offered(reader, prefix).items()
        if names(topic, usual) and type_name in types and reader.count([topic])
    ]


def only_one(reader: BagReader, topics: Sequence[str], what: str) -> str | None:
    """Return the only one of ``topics``, which ``what`` is read from; None if there is none.

    Raises:
        BagError: if there are several.
    """
    if len(topics) > 1:
        raise BagError(f'{reader.path}: several topics of {what}, name one of {listed(topics)}')
    return topics[0] if topics else None


TYPES = tuple(kind.type_name for kind in TENSION_TOPICS.values())
_KINDS = {kind.type_name: kind for kind in TENSION_TOPICS.values()}
_LISTED = 20


class Reading(NamedTuple):
    """The tensions or displacements in a message, or the reason why it was refused.

    Attributes:
        stamp: stamp of the message; its time of receipt if it has none, or no valid one.
        tensions: tensions of `Arm.tension_shape` [N]; None if refused, or with displacements.
        reason: reason why the message was refused, or ''.
        displacements: length reeled in [m] by name of the tendons driven by length; None if there
            are none.
    """

    stamp: Stamp
    tensions: FloatArray | None
    reason: str
    displacements: dict[str, float] | None = None

    @property
    def is_refused(self) -> bool:
        """Whether there are neither tensions nor displacements."""
        return self.tensions is None and self.displacements is None


class Source(NamedTuple):
    """A topic, and perhaps a field, that tensions or displacements are read from.

    Attributes:
        topic: topic of the messages.
        field: field that holds the numbers, or '' for the usual field of the type.
        is_displacements: whether they are displacements.
    """

    topic: str
    field: str = ''
    is_displacements: bool = False

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


def pick_tensions(
    reader: BagReader, chosen: str | None, without: Collection[str] = (), prefix: str | None = None
) -> Source:
    """Return the source of tensions on the topic ``chosen``, TOPIC or TOPIC:FIELD.

    None takes the only topic besides ``without``, which is read as something else, that is
    `offered` for the arm of ``prefix``.

    Raises:
        BagError: if there is none; the message lists the numeric fields of other types.
    """
    if chosen is not None and ':' in chosen:
        return _pick_field(reader, chosen, 'tensions')
    try:
        return Source(pick_topic(reader, chosen, TYPES, 'tensions', without, prefix))
    except BagError as error:
        others = [chosen] if chosen is not None else list(reader.topics)
        others = [reader.full_name(topic) for topic in others]
        raise BagError(f'{error}{_fields_of(reader, others)}') from None


def pick_displacements(
    reader: BagReader, chosen: str | None, prefix: str | None = None
) -> Source | None:
    """Return the source of displacements on the topic ``chosen``, TOPIC or TOPIC:FIELD.

    None takes tendon_displacements of the arm of ``prefix``, if there is one.

    Raises:
        BagError: if there is no such topic or field, or there are several.
    """
    if chosen is not None and ':' in chosen:
        return _pick_field(reader, chosen, 'displacements')
    kinds = (DISPLACEMENT_TYPE,)
    topic = pick_usual(reader, chosen, DISPLACEMENTS, kinds, 'displacements', prefix)
    return None if topic is None else Source(topic, '', True)


def _pick_field(reader: BagReader, chosen: str, what: str) -> Source:
    """Return the source ``chosen``, TOPIC:FIELD; BagError lists the existing numeric fields."""
    topic, _, field = chosen.partition(':')
    topic = pick_topic(reader, topic, None, what)
    fields = reader.numeric_fields(reader.topics[topic])
    if re.sub(r'\[\d+\]', '', field) not in fields:
        raise BagError(
            f'{reader.path}: {topic} ({reader.topics[topic]}) has no numeric field {field!r}; '
            f'it has {", ".join(fields) or "none"}'
        )
    return Source(topic, field, what == 'displacements')


def _fields_of(reader: BagReader, topics: Sequence[str]) -> str:
    """Return a text that lists numeric fields on ``topics`` whose types are not in `TYPES`."""
    texts = []
    for topic in topics[:_LISTED]:
        type_name = reader.topics.get(topic, '')
        if type_name and type_name not in TYPES:
            if fields := reader.numeric_fields(type_name):
                texts.append(f'{topic}:{{{",".join(fields)}}}')
    return f'; any numeric field will do, as TOPIC:FIELD: {" ".join(texts)}' if texts else ''


class RecordedArm(NamedTuple):
    """An arm whose tensions or displacements are in a bag.

    Attributes:
        prefix: namespace of its topics, with the slash.
        sources: sources of its tensions and displacements.
        parameters: its parameters, as for `Config.from_parameters`.
    """

    prefix: str
    sources: tuple[Source, ...]
    parameters: Mapping[str, Any]


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
    displaced = list(filter(None, (pick_displacements(reader, one) for one in displacements)))
    picked = []
    for topic in topics:
        name = reader.full_name(topic)
        is_usual = names(name, DISPLACEMENTS) and reader.topics.get(name) == DISPLACEMENT_TYPE
        picked.append(Source(name, '', True) if is_usual else pick_tensions(reader, topic))
    if len({one.topic for one in picked}) < len(picked):
        raise BagError(f'--topics names {" ".join(topics)}, expected each topic once')
    if not topics:
        usual = {} if displaced else {DISPLACEMENTS: DISPLACEMENT_TYPE}
        usual |= {name: kind.type_name for name, kind in TENSION_TOPICS.items()}
        for name, kind in usual.items():
            found = usual_topics(reader, name, (kind,))
            picked += [Source(topic, '', name == DISPLACEMENTS) for topic in found]
        picked = sorted(picked) or ([] if displaced else [pick_tensions(reader, None)])
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
    topics = usual_topics(reader, DESCRIPTION, (STRING,), prefix)
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
