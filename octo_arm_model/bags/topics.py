"""Names of topics, in whatever namespace, and which of those in a bag something is read from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from octo_arm_model.arm.errors import BagError, listed
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, TENDON_LENGTHS, TENSION_ESTIMATES
from octo_arm_model.wire.estimate import ESTIMATES
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS, TENSION_TOPICS

# What the model answers with, and the types of that: never a measurement.
ANSWERS: dict[str, str] = {
    **BACKBONE_TOPICS,
    TENDON_LENGTHS: 'sensor_msgs/msg/JointState',
    TENSION_ESTIMATES: 'octo_arm_msgs/msg/TendonTensions',
}
DESCRIPTION = 'arm_description'  # the arm as a ROS parameter file, from the node
MIDLINE = 'camera/midline'
_USUAL = (*TENSION_TOPICS, MIDLINE)  # that tensions or midlines are measured on


def names(topic: str, *usual: str) -> bool:
    """Whether ``topic`` is one of the ``usual`` names, in whatever namespace."""
    return f'/{topic}'.endswith(tuple(f'/{name}' for name in usual))


def namespace(topic: str, usual: Iterable[str]) -> str:
    """Namespace, with the slash, of a ``topic`` of one of the ``usual`` names or any other."""
    for name in usual:
        if names(topic, name):
            return topic.removesuffix(name)
    return topic[: topic.rfind('/') + 1]


def holds_displacements(topic: str, type_name: str) -> bool:
    """Whether messages of a type on ``topic`` are displacements for the node."""
    return names(topic, DISPLACEMENTS) and type_name == DISPLACEMENT_TYPE


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
    found = [topic for topic in measured_topics(reader, types or ()) if topic != without]
    for narrower in (
        [topic for topic in found if reader.count([topic])],
        [topic for topic in found if names(topic, *_USUAL)],
    ):
        if len(found) > 1 and narrower:
            found = [topic for topic in found if topic in narrower]
    only = only_one(reader, found, what)
    if only is None:
        raise BagError(f'{reader.path}: no {what}, expected {expected}; {reader.listing}')
    reader.types_of(reader.topics[only])
    return only


def measured_topics(reader: BagReader, types: Sequence[str]) -> list[str]:
    """Topics of one of ``types`` that are none of the model's answers, nor displacements."""
    return [
        topic
        for topic, type_name in reader.topics.items()
        if type_name in types and not names(topic, *ANSWERS, *ESTIMATES, DISPLACEMENTS)
    ]


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
        for topic, type_name in reader.topics.items()
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
