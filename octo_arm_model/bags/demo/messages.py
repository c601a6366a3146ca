"""The messages of a simulated experiment."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from octo_arm_model.bags.store.types import known_types
from octo_arm_model.bags.topics import MIDLINE
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.wire.displacement_messages import TOPIC as DISPLACEMENTS
from octo_arm_model.wire.displacement_messages import TYPE_NAME as DISPLACEMENT_TYPE
from octo_arm_model.wire.measurement_messages import MARKERS, TIP_POSE
from octo_arm_model.wire.tension_messages import TENSION_TOPICS

CAMERA_FRAME = 'camera'
START = 1_335_830_400 * 10**9  # 1 May 2012 [ns]
# A camera does not see the orientation of cross sections.
_LEVEL: FloatArray = np.array([0.0, 0.0, 0.0, 1.0])


class DemoMessages:
    """Collects messages and writes them in order of receipt."""

    def __init__(self, writer: BagWriter, config: Config) -> None:
        """Of the arm of ``config``, for ``writer``."""
        self._writer, self._config = writer, config
        self._types = known_types()
        self._topics: dict[str, Connection] = {}
        self._messages: list[Message] = []

    def add_tension(self, time: float, tension: float) -> None:
        """Add tensions measured at ``time`` [s]: that of the first tendon [N], the others none."""
        arm = self._config.arm
        tensions = np.zeros(len(arm.tendons))
        tensions[0] = tension
        (topic, kind), *_ = TENSION_TOPICS.items()
        assert kind.names is not None
        fields = {kind.names: list(arm.tendon_names), kind.tensions: tensions}
        header = self._header(time, self._config.base_frame)
        message = self._make(kind.type_name, header=header, **fields)
        self._add(f'/{topic}', kind.type_name, time, message)

    def add_displacements(self, time: float, displacements: FloatArray) -> None:
        """Add lengths that the winches have reeled in at ``time`` [s], (tendons,) [m]."""
        arm, none = self._config.arm, np.zeros(0)
        header = self._header(time, self._config.base_frame)
        message = self._make(
            DISPLACEMENT_TYPE, header=header, name=list(arm.tendon_names),
            position=displacements, velocity=none, effort=none,
        )  # fmt: skip
        self._add(f'/{DISPLACEMENTS}', DISPLACEMENT_TYPE, time, message)

    def add_midline(self, time: float, points: FloatArray, ahead: float) -> None:
        """Add ``points`` (n, 3) [m] seen at ``time`` [s], by a clock that is ``ahead`` [s]."""
        header = self._header(time + ahead, CAMERA_FRAME)
        poses = [
            self._make(
                'geometry_msgs/msg/PoseStamped', header=header, pose=self._pose(point, _LEVEL)
            )
            for point in points
        ]
        name = 'nav_msgs/msg/Path'
        self._add(f'/{MIDLINE}', name, time, self._make(name, header=header, poses=poses))

    def add_tip_pose(
        self, time: float, position: FloatArray, quaternion: FloatArray, stddev: FloatArray
    ) -> None:
        """Add a pose of the tip at ``time`` [s], of which ``stddev`` (6,) is the noise."""
        name = 'geometry_msgs/msg/PoseWithCovarianceStamped'
        covariance = np.diag(np.square(stddev)).ravel()
        pose = self._make(
            'geometry_msgs/msg/PoseWithCovariance', pose=self._pose(position, quaternion),
            covariance=covariance,
        )  # fmt: skip
        header = self._header(time, self._config.base_frame)
        self._add(f'/{TIP_POSE}', name, time, self._make(name, header=header, pose=pose))

    def add_markers(self, time: float, points: FloatArray) -> None:
        """Add markers at ``points`` (n, 3) [m] seen at ``time`` [s]."""
        name = 'geometry_msgs/msg/PoseArray'
        header = self._header(time, self._config.base_frame)
        poses = [self._pose(point, _LEVEL) for point in points]
        self._add(f'/{MARKERS}', name, time, self._make(name, header=header, poses=poses))

    def write(self) -> None:
        """Write all of them."""
        self._writer.write(sorted(self._messages, key=lambda message: message[1]))

    def _pose(self, position: FloatArray, quaternion: FloatArray) -> Any:
        x, y, z = position.tolist()
        place = self._make('geometry_msgs/msg/Point', x=x, y=y, z=z)
        x, y, z, w = quaternion.tolist()
        turned = self._make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)
        return self._make('geometry_msgs/msg/Pose', position=place, orientation=turned)

    def _header(self, time: float, frame: str) -> Any:
        sec, nanosec = divmod(_nanoseconds(time), 10**9)
        stamp = self._make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
        return self._make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)

    def _make(self, name: str, /, **fields: Any) -> Any:
        return self._types.types[name](**fields)

    def _add(self, topic: str, name: str, time: float, message: Any) -> None:
        if topic not in self._topics:
            self._topics[topic] = self._writer.add(topic, name)
        data = bytes(self._types.serialize_cdr(message, name))
        self._messages.append((self._topics[topic], _nanoseconds(time), data))


def _nanoseconds(time: float) -> int:
    """Stamp of a ``time`` from the start [s]."""
    return START + round(time * 1e9)
