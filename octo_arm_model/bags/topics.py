"""What is read of which topics of a bag, in whatever namespace: arms, tensions, displacements."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

from octo_arm_model.arm.errors import BagError, ConfigError, MessageError, listed
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader, Record
from octo_arm_model.bags.types import STRING
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import naming, parameters_of
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, TENDON_LENGTHS, TENSION_ESTIMATES
from octo_arm_model.wire.estimate import ESTIMATES
from octo_arm_model.wire.measurements import MEASUREMENT_TOPICS
from octo_arm_model.wire.messages import Stamp, time_of
from octo_arm_model.wire.tensions import (
    DISPLACEMENT_TYPE,
    DISPLACEMENTS,
    TENSION_TOPICS,
    FieldMessage,
    read_displacements,
)

# What the model answers with, and the types of that: never a measurement.
ANSWERS: dict[str, str] = {
    **BACKBONE_TOPICS,
    TENDON_LENGTHS: 'sensor_msgs/msg/JointState',
    TENSION_ESTIMATES: 'octo_arm_msgs/msg/TendonTensions',
}
DESCRIPTION = 'arm_description'  # the arm as a ROS parameter file, from the node
MIDLINE = 'camera/midline'
_USUAL = (*TENSION_TOPICS, MIDLINE)  # that tensions or midlines are measured on
_MEASURED = (*_USUAL, *MEASUREMENT_TOPICS)  # on an arm


def names(topic: str, *usual: str) -> bool:
    """Whether ``topic`` is one of the ``usual`` names, in whatever namespace."""
    return f'/{topic}'.endswith(tuple(f'/{name}' for name in usual))


def namespace(topic: str, usual: Iterable[str]) -> str:
    """Namespace, with the slash, of a ``topic`` of one of the ``usual`` names or any other."""
    for name in usual:
        if names(topic, name):
            return topic.removesuffix(name)
    return topic[: topic.rfind('/') + 1]


def offer_one_arm(reader: BagReader, named: str | None) -> None:
    """Offer no topics of other arms than that of the one that is ``named``, if one is.

    An arm is a namespace with tensions or displacements.
    """
    if named is not None:
        topic = reader.full_name(named.partition(':')[0])
        reader.offered = topics_of_arm(reader, namespace(topic, _MEASURED))


def topics_of_arm(reader: BagReader, prefix: str) -> dict[str, str]:
    """Topics and their types, without those of other arms than that in the ``prefix``."""
    tendons = (*TENSION_TOPICS, DISPLACEMENTS)
    arms = {namespace(one, tendons) for one in reader.topics if names(one, *tendons)}
    if prefix not in arms:
        return reader.topics
    own = {}
    for topic, type_name in reader.topics.items():
        arm = max((one for one in arms if topic.startswith(one)), key=len, default=prefix)
        # What has another name and no namespace may be a camera's, of all arms.
        if arm == prefix or (arm == '/' and not names(topic, *_MEASURED, DESCRIPTION)):
            own[topic] = type_name
    return own


def pick_topic(
    reader: BagReader,
    wanted: str | None,
    types: Sequence[str] | None,
    what: str,
    without: str | None = None,
) -> str:
    """The topic of one of ``types`` that ``what`` is read from: ``wanted``, or the only one.

    ``types`` are None where ``wanted`` may be of any.

    What the model answers with is none unless wanted, nor are displacements, nor the topic
    ``without`` which the choice is made, as it is read as something else. Of several topics that
    with messages is taken, or with a usual name such as tendon_tensions, in whatever namespace.

    Raises:
        BagError: if there is none, or several; the message lists what is there.
    """
    expected = ' or '.join(types or ())
    if wanted is not None:
        topic = reader.full_name(wanted)
        if topic not in reader.topics:
            raise BagError(f'{reader.path}: no topic {wanted} for {what}; {reader.listing}')
        if types is not None and reader.topics[topic] not in types:
            raise BagError(
                f'{reader.path}: topic {topic} is of {reader.topics[topic]}, expected {expected} '
                f'for {what}'
            )
        reader.types_of(reader.topics[topic])
        return topic
    only = measured_topic(reader, types or (), what, () if without is None else (without,))
    if only is None:
        raise BagError(f'{reader.path}: no {what}, expected {expected}; {reader.listing}')
    reader.types_of(reader.topics[only])
    return only


def measured_topic(
    reader: BagReader, types: Sequence[str], what: str, without: Collection[str] = ()
) -> str | None:
    """The only topic of one of ``types`` that ``what`` was measured on, see `pick_topic`.

    None of none; BagError of several.
    """
    others = (*ANSWERS, *ESTIMATES, DISPLACEMENTS)
    found = [
        topic
        for topic, type_name in reader.offered.items()
        if type_name in types and topic not in without and not names(topic, *others)
    ]
    for narrower in (
        [topic for topic in found if reader.count([topic])],
        [topic for topic in found if names(topic, *_USUAL)],
    ):
        if len(found) > 1 and narrower:
            found = [topic for topic in found if topic in narrower]
    return only_one(reader, found, what)


def pick_usual(
    reader: BagReader, wanted: str | None, usual: str, types: Sequence[str], what: str
) -> str | None:
    """The topic of one of ``types`` that ``what`` is read from: ``wanted``, or the ``usual`` one.

    None where there is no usual one.

    Raises:
        BagError: if there is no ``wanted`` one, it is of another type, or there are several usual
            ones.
    """
    if wanted is not None:
        return pick_topic(reader, wanted, types, what)
    return only_one(reader, usual_topics(reader, usual, types), what)


def usual_topics(reader: BagReader, usual: str, types: Sequence[str]) -> list[str]:
    """Topics of the ``usual`` name with messages of one of ``types``."""
    return [
        topic
        for topic, type_name in reader.offered.items()
        if names(topic, usual) and type_name in types and reader.count([topic])
    ]


def only_one(reader: BagReader, topics: Sequence[str], what: str) -> str | None:
    """The only one of the ``topics`` that ``what`` may be read from; None of none.

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


class Source(NamedTuple):
    """Where tensions or displacements are read.

    Attributes:
        topic: of their messages.
        field: what holds the numbers, or '' for the usual field of the type.
        is_displacements: whether they are displacements.
    """

    topic: str
    field: str = ''
    is_displacements: bool = False

    def read(
        self, reader: BagReader, config: Config, record: Record, *, raw: bool = False
    ) -> Reading:
        """What a ``record`` says of the arm and its sensors in ``config``, or why that is nothing.

        ``raw`` tensions may be below zero, as noise is.
        """
        cells, arm = config.load_cells, config.arm
        if self.is_displacements:
            lengths = partial(
                read_displacements, arm=arm, encoders=config.encoders, field=self.field
            )
            stamp, found, reason = reader.read(record, lengths)
            return _stampable(Reading(stamp, None, reason, found))
        named = FieldMessage(record.type_name, self.field)
        kind = named if self.field else _KINDS[record.type_name]
        calibrated = cells.scale_and_offset if raw else partial(cells.tensions, arm)
        read = reader.read(record, lambda one: calibrated(kind.read(one, arm, cells.names)))
        return _stampable(Reading(*read))


def pick_tensions(reader: BagReader, wanted: str | None, without: str | None = None) -> Source:
    """Tensions on the topic ``wanted``, TOPIC or TOPIC:FIELD.

    None stands for the only topic that there is ``without`` one that is read as something else.

    Raises:
        BagError: if there is none; the message lists the numeric fields of other types.
    """
    if wanted is not None and ':' in wanted:
        return _pick_field(reader, wanted, 'tensions')
    try:
        return Source(pick_topic(reader, wanted, TYPES, 'tensions', without))
    except BagError as error:
        others = [wanted] if wanted is not None else list(reader.topics)
        others = [reader.full_name(one) for one in others]
        raise BagError(f'{error}{_fields_of(reader, others)}') from None


def pick_displacements(reader: BagReader, wanted: str | None) -> Source | None:
    """Displacements on the topic ``wanted``, TOPIC or TOPIC:FIELD.

    None stands for tendon_displacements, if there.

    Raises:
        BagError: if there is no such topic or field, or there are several.
    """
    if wanted is not None and ':' in wanted:
        return _pick_field(reader, wanted, 'displacements')
    kinds = (DISPLACEMENT_TYPE,)
    topic = pick_usual(reader, wanted, DISPLACEMENTS, kinds, 'displacements')
    return None if topic is None else Source(topic, '', True)


def _pick_field(reader: BagReader, wanted: str, what: str) -> Source:
    """What ``wanted``, TOPIC:FIELD, names; BagError lists the numeric fields there."""
    topic, _, field = wanted.partition(':')
    topic = pick_topic(reader, topic, None, what)
    fields = reader.numeric_fields(reader.topics[topic])
    if re.sub(r'\[\d+\]', '', field) not in fields:
        raise BagError(
            f'{reader.path}: {topic} ({reader.topics[topic]}) has no numeric field {field!r}; '
            f'it has {", ".join(fields) or "none"}'
        )
    return Source(topic, field, what == 'displacements')


def _fields_of(reader: BagReader, topics: Sequence[str]) -> str:
    """Numeric fields of the messages on ``topics`` whose types are none of `TYPES`, in words."""
    found = []
    for topic in topics[:_LISTED]:
        type_name = reader.topics.get(topic, '')
        if type_name and type_name not in TYPES:
            if fields := reader.numeric_fields(type_name):
                found.append(f'{topic}:{{{",".join(fields)}}}')
    return f'; any numeric field will do, as TOPIC:FIELD: {" ".join(found)}' if found else ''


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


class RecordedArm(NamedTuple):
    """An arm whose tensions or displacements are in a bag.

    Attributes:
        prefix: namespace of its topics, with the slash.
        sources: of both.
        parameters: what it is, see `Config.from_parameters`.
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
    driven = list(filter(None, (pick_displacements(reader, one) for one in displacements)))
    picked = []
    for topic in topics:
        name = reader.full_name(topic)
        is_usual = names(name, DISPLACEMENTS) and reader.topics.get(name) == DISPLACEMENT_TYPE
        picked.append(Source(name, '', True) if is_usual else pick_tensions(reader, topic))
    if len({one.topic for one in picked}) < len(picked):
        raise BagError(f'--topics names {" ".join(topics)}, expected each topic once')
    if not topics:
        usual = {} if driven else {DISPLACEMENTS: DISPLACEMENT_TYPE}
        usual |= {name: kind.type_name for name, kind in TENSION_TOPICS.items()}
        for name, kind in usual.items():
            found = usual_topics(reader, name, (kind,))
            picked += [Source(topic, '', name == DISPLACEMENTS) for topic in found]
        picked = sorted(picked) or ([] if driven else [pick_tensions(reader, None)])
    by_prefix: dict[str, list[Source]] = {}
    for source in {one.topic: one for one in (*picked, *driven)}.values():
        prefix = namespace(source.topic, (*TENSION_TOPICS, DISPLACEMENTS))
        by_prefix.setdefault(prefix, []).append(source)
    arms = []
    for prefix, own in by_prefix.items():
        values = dict(parameters if parameters is not None else describe(reader, prefix))
        values |= {**({} if model is None else {'model': model}), **calibration}
        arms.append(RecordedArm(prefix, tuple(own), values))
    return arms


def describe(reader: BagReader, prefix: str = '/') -> dict[str, Any]:
    """Parameters of the arm as described in a bag, the last if they changed.

    That of the namespace ``prefix``, or else the only one.

    Raises:
        ConfigError: if there is no description, or that of no arm.
        BagError: if the bag is damaged.
    """
    own = topics_of_arm(reader, prefix)
    topics = [one for one in usual_topics(reader, DESCRIPTION, (STRING,)) if one in own]
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
