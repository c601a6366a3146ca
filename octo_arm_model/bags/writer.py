"""The writer of bags, which are complete or absent, and messages of sensors for estimators."""

import contextlib
import itertools
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinitionFormat,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer

from octo_arm_model.arm.errors import BagError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import MIDLINE
from octo_arm_model.bags.types import STRING, known_types
from octo_arm_model.config.config import Config
from octo_arm_model.wire.backbone import path, pose_array, pose_with_covariance, tendon_tensions
from octo_arm_model.wire.cdr import Template, text_field
from octo_arm_model.wire.measurements import MARKERS, MEASUREMENT_TOPICS, TIP_POSE
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS, TENSION_TOPICS

STORAGES = tuple(plugin.name.lower() for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3))
# Connection, time of receipt [ns], and bytes of a message.
Message = tuple[Connection, int, bytes]

VERSION: Final = 9  # of the metadata in Jazzy
_FOREVER = QosTime(9223372036, 854775807)  # the infinite duration of ROS 2


def _qos(depth: int, durability: QosDurability) -> Qos:
    """Return a reliable QoS, as that of the node."""
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        durability,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )


_OUTPUT = _qos(5, QosDurability.VOLATILE)
_LATCHED = _qos(1, QosDurability.TRANSIENT_LOCAL)


class BagWriter(contextlib.AbstractContextManager['BagWriter']):
    """A bag that is being written.

    It is written to a hidden folder beside its path, which is renamed when the bag is complete,
    and removed after any exception.
    """

    def __init__(
        self, path: str | Path, storage: str = 'mcap', custom: Mapping[str, str] | None = None
    ) -> None:
        """Begin a bag at ``path``, which must not exist, with ``custom`` data in its metadata.

        Raises:
            BagError: if ``path`` exists, or its folder cannot be written.
        """
        self.path = Path(path)
        self._topics: dict[tuple[str, str], Connection] = {}
        if storage not in STORAGES:
            raise BagError(f'storage is {storage!r}, expected one of {", ".join(STORAGES)}')
        if self.path.exists() or self.path.is_symlink():
            raise BagError(f'{self.path}: exists already, expected the name of a new bag')
        if not self.path.name:
            raise BagError(f'{self.path}: expected the name of a new bag')
        with contextlib.ExitStack() as resources, self._failures():
            folder = tempfile.TemporaryDirectory(
                prefix=f'.{self.path.name}.', dir=self.path.parent, ignore_cleanup_errors=True
            )
            # The file is named after this folder, as the recorder names the first of a bag.
            self._writer = Writer(
                Path(resources.enter_context(folder)) / f'{self.path.name}_0',
                version=VERSION,
                storage_plugin=StoragePlugin[storage.upper()],
            )
            resources.callback(self._abort)
            for key, value in (custom or {}).items():
                self._writer.set_custom_data(key, value)
            self._writer.open()
            self._resources = resources.pop_all()

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Complete the bag, or discard it after an ``error``.

        Raises:
            BagError: if the bag cannot be completed; it is then discarded.
        """
        with self._resources, self._failures():
            if error is None:
                self._writer.close()
                self._writer.path.rename(self.path)

    def _abort(self) -> None:
        """Close the file of a bag that is not complete."""
        with contextlib.suppress(Exception):
            self._writer.abort()

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        """Turn errors of files and of SQLite into BagError."""
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            problem = error.strerror if isinstance(error, OSError) else error
            raise BagError(f'{self.path}: cannot be written: {problem}') from error

    def add(self, topic: str, type_name: str, latched: bool = False) -> Connection:
        """Return the connection of a ``topic`` of a known type, and add it if it is new.

        Late subscribers receive the last message of a ``latched`` topic.

        Raises:
            BagError: if the bag cannot be written.
        """
        key = topic, type_name
        if key not in self._topics:
            qos = [_LATCHED if latched else _OUTPUT]
            with self._failures():
                self._topics[key] = self._writer.add_connection(
                    *key, typestore=known_types(), offered_qos_profiles=qos
                )
        return self._topics[key]

    def add_text(self, topic: str, text: str, received_ns: int) -> None:
        """Write a latched std_msgs/String on a ``topic``, received at a time [ns].

        Raises:
            BagError: if the bag cannot be written.
        """
        types = known_types()
        data = bytes(types.serialize_cdr(types.types[STRING](data=text), STRING))
        self.write([(self.add(topic, STRING, latched=True), received_ns, data)])

    def add_copy(self, reader: BagReader, source: Connection) -> Connection | None:
        """Add a topic as it is in another bag; return None if its type is not defined there.

        Raises:
            BagError: if the bag cannot be written.
        """
        text, digest = source.msgdef.data, source.digest
        if source.msgdef.format != MessageDefinitionFormat.MSG or not digest:
            try:
                types = reader.types_of(source.msgtype)
            except BagError:
                return None
            text, _ = types.generate_msgdef(source.msgtype, ros_version=2)
            digest = types.hash_rihs01(source.msgtype)
        assert isinstance(source.ext, ConnectionExtRosbag2)
        with self._failures():
            return self._writer.add_connection(
                source.topic,
                source.msgtype,
                msgdef=text,
                rihs01=digest,
                offered_qos_profiles=source.ext.offered_qos_profiles,
            )

    def write(self, messages: Iterable[Message]) -> None:
        """Add ``messages``; BagError if the bag cannot be written."""
        with self._failures():
            for connection, received_ns, data in messages:
                self._writer.write(connection, received_ns, data)


TENSIONS = 'tendon_tensions'
# Orientation of points, because a camera does not see that of cross sections.
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
        """Collect messages of the arm of ``config``, with midlines in ``camera`` or base_frame."""
        self._writer, self._names = writer, config.arm.tendon_names
        self._frame = text_field('base_frame', config.base_frame)
        self._camera = self._frame if camera is None else camera.encode()
        self._templates: dict[tuple[str, tuple[str, ...], int], Template] = {}
        self._messages: list[Message] = []

    def add(self, topic: str, received_ns: int, *values: Any, ahead_ns: int = 0) -> None:
        """Add a message received at a time [ns], with a stamp that is ``ahead_ns`` [ns] later.

        The values are tensions (tendons,) [N]; or lengths reeled in (tendons,) [m], NaN if not
        read; or points (n, 3) [m] of a midline or of markers; or position, quaternion and
        covariance of the tip.
        """
        first, names = np.asarray(values[0]), self._names
        if topic == DISPLACEMENTS:
            is_read = np.isfinite(first)
            names, first = tuple(itertools.compress(names, is_read)), first[is_read]
        key = topic, names, len(first)
        if key not in self._templates:
            layout = {
                MIDLINE: lambda: path(self._camera, len(first)),
                MARKERS: lambda: pose_array(self._frame, len(first)),
                TIP_POSE: lambda: pose_with_covariance(self._frame),
            }.get(topic, lambda: tendon_tensions(self._frame, names))()
            if topic == DISPLACEMENTS:  # a JointState goes on with velocities and efforts, empty
                layout.count(0)
                layout.count(0)
            self._templates[key] = layout
        further = (LEVEL,) if topic in (MIDLINE, MARKERS) else values[1:]
        stamp = Stamp.from_ns(received_ns + ahead_ns)
        data = self._templates[key].write(*stamp, first, *further)
        self._messages.append((self._writer.add(f'/{topic}', _TYPES[topic]), received_ns, data))

    def add_all(
        self, topic: str, received_ns: Iterable[int], rows: Iterable[FloatArray], ahead_ns: int = 0
    ) -> None:
        """Add a message for each of ``rows``, the values of `add`."""
        for received, row in zip(received_ns, rows, strict=True):
            self.add(topic, received, row, ahead_ns=ahead_ns)

    def write(self) -> None:
        """Write all messages; BagError if the bag cannot be written."""
        self._writer.write(sorted(self._messages, key=lambda message: message[1]))
