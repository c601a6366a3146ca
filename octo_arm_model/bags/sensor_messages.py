"""What sensors of an arm measure, written into a bag on the topics that estimators read."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from octo_arm_model.bags.topics import MIDLINE
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.wire.backbone import path, pose_array, pose_with_covariance, tendon_tensions
from octo_arm_model.wire.cdr import Layout, Template, text_field
from octo_arm_model.wire.measurements import MARKERS, MEASUREMENT_TOPICS, TIP_POSE
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS, TENSION_TOPICS

TENSIONS = 'tendon_tensions'
# Orientation of points: a camera does not see that of cross sections.
LEVEL = (0.0, 0.0, 0.0, 1.0)
_TYPES = {
    TENSIONS: TENSION_TOPICS[TENSIONS].type_name,
    DISPLACEMENTS: DISPLACEMENT_TYPE,
    MIDLINE: 'nav_msgs/msg/Path',
    TIP_POSE: MEASUREMENT_TOPICS[TIP_POSE].type_name,
    MARKERS: MEASUREMENT_TOPICS[MARKERS].type_name,
}


class SensorMessages:
    """Collects messages and writes them in the order of receipt."""

    def __init__(self, writer: BagWriter, config: Config, camera: str | None = None) -> None:
        """Messages of the arm of ``config``, midlines in the frame ``camera``, or base_frame."""
        self._writer, self._names = writer, config.arm.tendon_names
        self._frame = text_field('base_frame', config.base_frame)
        self._camera = self._frame if camera is None else camera.encode()
        self._templates: dict[tuple[str, tuple[str, ...], int], Template] = {}
        self._messages: list[Message] = []

    def add(self, topic: str, received_ns: int, *values: Any, ahead_ns: int = 0) -> None:
        """Add a message received at a time [ns], with the stamp of a clock that is ahead [ns].

        Its values are tensions (tendons,) [N], or lengths reeled in (tendons,) [m], NaN of those
        that are not read, or points (n, 3) [m] of a midline or of markers, or position, quaternion
        and covariance of the tip.
        """
        first, names = np.asarray(values[0]), self._names
        if topic == DISPLACEMENTS:
            read = np.isfinite(first)
            names, first = tuple(itertools.compress(names, read)), first[read]
        key = topic, names, len(first)
        if key not in self._templates:
            self._templates[key] = Template(self._layout(*key))
        more = (LEVEL,) if topic in (MIDLINE, MARKERS) else values[1:]
        stamp = Stamp.from_ns(received_ns + ahead_ns)
        data = self._templates[key].write(*stamp, first, *more)
        self._messages.append((self._writer.add(f'/{topic}', _TYPES[topic]), received_ns, data))

    def _layout(self, topic: str, names: tuple[str, ...], count: int) -> Layout:
        if topic == MIDLINE:
            return path(self._camera, count)
        if topic == MARKERS:
            return pose_array(self._frame, count)
        if topic == TIP_POSE:
            return pose_with_covariance(self._frame)
        layout = tendon_tensions(self._frame, names)
        if topic == DISPLACEMENTS:  # the same but for velocities and efforts, of which are none
            layout.count(0)
            layout.count(0)
        return layout

    def write(self) -> None:
        """Write all of them.

        Raises:
            BagError: if the bag cannot be written.
        """
        self._writer.write(sorted(self._messages, key=lambda message: message[1]))
