"""Messages as they are stored in a bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple

from rosbags.interfaces import Connection

from octo_arm_model.wire.stamp import Stamp


class Record(NamedTuple):
    """A message as it is stored in a bag.

    Attributes:
        topic: where it was published.
        type_name: its type, such as 'nav_msgs/msg/Path'.
        received_ns: when the recorder received it [ns].
        data: its bytes, as ROS 2 sends them.
    """

    topic: str
    type_name: str
    received_ns: int
    data: bytes


def stamp_of(message: Any, received_ns: int) -> Stamp:
    """Stamp of a decoded message: that of its header, as the node takes it.

    The time of receipt where it has no header, or an unset stamp.
    """
    header = getattr(message, 'header', None)
    if header is not None and (header.stamp.sec or header.stamp.nanosec):
        return Stamp.of(header.stamp)
    return Stamp.from_ns(received_ns)


Key = tuple[str, str]  # a topic and the type of messages on it


def count_messages(connections: Iterable[Connection]) -> Counter[Key]:
    """How many messages there are of each type on each topic."""
    counts = Counter[Key]()
    for connection in connections:
        counts[connection.topic, connection.msgtype] += connection.msgcount
    return counts


def counts_of(counts: Counter[Key], connections: Iterable[Connection]) -> dict[Key, int]:
    """Entries of ``counts`` for the topics and types of ``connections``."""
    return {key: counts[key] for key in {(one.topic, one.msgtype) for one in connections}}
