"""The messages of a simulated experiment."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Connection

from octo_arm_model.bags.topics import MIDLINE
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.wire.cdr.backbone import (
    path,
    pose_array,
    pose_with_covariance,
    tendon_tensions,
)
from octo_arm_model.wire.cdr.layout import text_field
from octo_arm_model.wire.cdr.templates import Template
from octo_arm_model.wire.displacement_messages import DISPLACEMENT_TYPE, DISPLACEMENTS
from octo_arm_model.wire.measurement_messages import MARKERS, MEASUREMENT_TOPICS, TIP_POSE
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tension_messages import TENSION_TOPICS

START = 1_335_830_400 * 10**9  # 1 May 2012 [ns]
TENSIONS = 'tendon_tensions'
# Orientation of points: a camera does not see that of cross sections.
LEVEL = (0.0, 0.0, 0.0, 1.0)


class DemoMessages:
    """Collects messages and writes them in order of receipt."""

    def __init__(self, writer: BagWriter, config: Config, points: int, markers: int) -> None:
        """Lay out messages of the arm of ``config``, with so many ``points`` and ``markers``."""
        frame, names = text_field('base_frame', config.base_frame), config.arm.tendon_names
        lengths = tendon_tensions(frame, names)  # but that the numbers are positions
        lengths.count(0)  # no velocities
        lengths.count(0)  # no efforts
        layouts = {
            TENSIONS: (TENSION_TOPICS[TENSIONS].type_name, tendon_tensions(frame, names)),
            DISPLACEMENTS: (DISPLACEMENT_TYPE, lengths),
            MIDLINE: ('nav_msgs/msg/Path', path(b'camera', points)),
            TIP_POSE: (MEASUREMENT_TOPICS[TIP_POSE].type_name, pose_with_covariance(frame)),
        }
        if markers:
            layouts[MARKERS] = MEASUREMENT_TOPICS[MARKERS].type_name, pose_array(frame, markers)
        self._layouts = {
            topic: (type_name, Template(layout)) for topic, (type_name, layout) in layouts.items()
        }
        self._writer = writer
        self._connections: dict[str, Connection] = {}
        self._messages: list[Message] = []

    def add(self, topic: str, time: float, *values: Any, ahead: float = 0.0) -> None:
        """Add a message received at ``time`` [s] after the start.

        It holds the ``values`` of the slots of its layout in their order, and a stamp of a clock
        that is ``ahead`` [s].
        """
        type_name, template = self._layouts[topic]
        if topic not in self._connections:
            self._connections[topic] = self._writer.add(f'/{topic}', type_name)
        data = template.write(*Stamp.from_ns(_nanoseconds(time + ahead)), *values)
        self._messages.append((self._connections[topic], _nanoseconds(time), data))

    def write(self) -> None:
        """Write all of them."""
        self._writer.write(sorted(self._messages, key=lambda message: message[1]))


def _nanoseconds(time: float) -> int:
    """Stamp of a ``time`` from the start [s]."""
    return START + round(time * 1e9)
