"""A recording: tensions, and measured midlines or tips."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.config.config import Config, load_parameters
from octo_arm_model.config.presets import find_path
from octo_arm_model.core.errors import BagError, MeasurementError, OctoArmError
from octo_arm_model.core.hints import FloatArray, IntArray

MIDLINES = ('nav_msgs/msg/Path', 'geometry_msgs/msg/PoseArray')
TIPS = ('geometry_msgs/msg/PoseStamped', 'geometry_msgs/msg/PoseWithCovarianceStamped')
# A midline is taken to be in metres if its extent is so many times the length of the arm.
_LENGTHS = (0.02, 2.0)


class SkippedMessage(NamedTuple):
    """A message that was left out.

    Attributes:
        topic: where it was published.
        stamp_ns: its stamp [ns].
        reason: why.
    """

    topic: str
    stamp_ns: int
    reason: str


@dataclass(frozen=True)
class Recording:
    """Tensions and measured midlines with their stamps, in order of time.

    Attributes:
        parameters: those of the arm, see `Config.from_parameters`.
        tension_time: stamp of each set of tensions [s], (n,); from the first on.
        tensions: (n, tendons) [N].
        frame_time: stamp of each midline, on the same scale, (f,) [s].
        frames: midlines as they were measured, each (m, 3) [m]; tips are (1, 3).
        frame_id: frame they are in.
        skipped: messages left out.
        notes: remarks.
    """

    parameters: dict[str, Any]
    tension_time: FloatArray
    tensions: FloatArray
    frame_time: FloatArray
    frames: tuple[FloatArray, ...]
    frame_id: str
    skipped: tuple[SkippedMessage, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def is_tips(self) -> bool:
        """Whether tips were measured and no midlines."""
        return all(len(points) == 1 for points in self.frames)


def read_recording(
    path: Path | str,
    config: str | None = None,
    tensions: str | None = None,
    midlines: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Recording:
    """Read the bag at ``path``.

    Args:
        path: the bag.
        config: parameter file or preset of the arm; None for the arm_description in the bag.
        tensions: topic of the tensions; None for the only one there is.
        midlines: topic of the midlines or tips; None for the only one that the model itself does
            not publish.
        progress: called with the numbers of messages read and of all messages.

    Raises:
        BagError: if the bag cannot be read or a topic is missing.
        ConfigError: if there is no arm, or it cannot be.
        MeasurementError: if no message holds a midline in metres.
    """
    from octo_arm_model.bags.arms import find_arms
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.bags.tensions import TYPES, read_tensions

    given = None if config is None else load_parameters(find_path(config))
    with BagReader(path) as reader:
        topic = reader.pick(tensions, TYPES, 'tensions')
        measured = reader.pick(midlines, tuple(_MEASURED), 'midlines or tips')
        parameters = dict(find_arms(reader, [topic], given)[0].parameters)
        arm_config = Config.from_parameters(parameters)
        arm = arm_config.arm
        notes: list[str] = []
        if any('synthetic' in text for text in reader.metadata.values()):
            notes.append('the bag says that it is synthetic')
        notes += reader.notes
        skipped: list[SkippedMessage] = []
        stamps: list[int] = []
        rows: list[FloatArray] = []
        total = reader.count([topic, measured])
        for done, reading in enumerate(read_tensions(reader, topic, arm_config)):
            progress(done, total)
            if reading.tensions is None:
                skipped.append(SkippedMessage(topic, reading.stamp_ns, reading.reason))
            else:
                stamps.append(reading.stamp_ns)
                rows.append(reading.tensions.ravel())
        if not rows:
            raise BagError(f'{path}: no tensions for this arm on {topic}{_first(skipped)}')
        origin = min(stamps)
        tension_time, order = _in_order(stamps, origin, topic, notes)
        table = np.array(rows)[order]
        frames = _Frames(reader, measured, arm.length)
        found = []
        for stamped in frames.read(skipped):
            found.append(stamped)
            progress(len(rows) + len(found), total)
        if not found:
            raise MeasurementError(f'{path}: nothing measured on {measured}{_first(skipped)}')
        frame_time, order = _in_order([stamp for stamp, _ in found], origin, measured, notes)
        return Recording(
            parameters, tension_time, table, frame_time, tuple(found[i][1] for i in order),
            frames.frame_id or '', tuple(skipped), tuple(notes),
        )  # fmt: skip


def _in_order(
    stamps: list[int], origin: int, topic: str, notes: list[str]
) -> tuple[FloatArray, IntArray]:
    """Stamps from ``origin`` on in seconds, ascending, and the order that makes them so."""
    given = np.array(stamps, dtype=np.int64)
    back = int((np.diff(given) < 0).sum())
    if back:
        notes.append(f'{back} of {given.size} stamps on {topic} run backwards; they are sorted')
    order = np.argsort(given, kind='stable')
    return np.asarray(1e-9 * (given[order] - origin)), np.asarray(order)


def _first(skipped: list[SkippedMessage]) -> str:
    """The last reason, for an error message."""
    return f'; {len(skipped)} were left out, the last as {skipped[-1].reason}' if skipped else ''


class _Frames:
    """Reads measured midlines or tips off one topic.

    Attributes:
        frame_id: frame of the first one; None before.
    """

    def __init__(self, reader: Any, topic: str, length: float) -> None:
        self.frame_id: str | None = None
        self._reader, self._topic, self._length = reader, topic, length

    def read(self, skipped: list[SkippedMessage]) -> Iterator[tuple[int, FloatArray]]:
        """Stamps [ns] and points; unusable messages are added to ``skipped``."""
        from octo_arm_model.bags.reader import stamp_of

        for record in self._reader.messages([self._topic]):
            stamp = record.received_ns
            try:
                message = self._reader.decode(record)
                stamp = stamp_of(message, stamp).ns
                yield stamp, self._points(message, record.type_name)
            except OctoArmError as error:
                skipped.append(SkippedMessage(self._topic, stamp, str(error)))

    def _points(self, message: Any, type_name: str) -> FloatArray:
        """Points of a message, checked.

        Raises:
            MeasurementError: if they cannot be points of this arm.
        """
        frame = str(message.header.frame_id)
        if self.frame_id is None:
            self.frame_id = frame
        elif frame != self.frame_id:
            raise MeasurementError(f'its frame is {frame!r}, expected {self.frame_id!r}')
        positions = _MEASURED[type_name](message)
        points = np.array([(p.x, p.y, p.z) for p in positions], dtype=np.float64).reshape(-1, 3)
        if type_name in MIDLINES and len(points) < 2:
            raise MeasurementError(f'it has {len(points)} point(s), expected at least 2')
        if not np.isfinite(points).all():
            number = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
            raise MeasurementError(
                f'point {number + 1} is {points[number].tolist()}, expected finite numbers'
            )
        if type_name in MIDLINES:
            # The diagonal of the bounding box, to which noise adds little.
            size = float(np.linalg.norm(np.ptp(points, axis=0)))
            low, high = (factor * self._length for factor in _LENGTHS)
            if not low <= size <= high:
                raise MeasurementError(
                    f'it extends over {size:.4g} m, expected {low:.3g} to {high:.3g} m for an arm '
                    f'of {self._length:.4g} m'
                )
        return points


# The positions in a message, by type.
_MEASURED: dict[str, Callable[[Any], list[Any]]] = {
    'nav_msgs/msg/Path': lambda message: [pose.pose.position for pose in message.poses],
    'geometry_msgs/msg/PoseArray': lambda message: [pose.position for pose in message.poses],
    'geometry_msgs/msg/PoseStamped': lambda message: [message.pose.position],
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda message: [message.pose.pose.position],
}
