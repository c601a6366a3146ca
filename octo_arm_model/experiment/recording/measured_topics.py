"""Measured points off topics of a bag: midlines, tips, and markers at known arc coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.core.errors import MeasurementError, OctoArmError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.experiment.recording.markers import check_marker_s
from octo_arm_model.wire.refusals import Refusals

LENGTH_UNITS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3}
TF = 'tf2_msgs/msg/TFMessage'
# A midline is taken to be in metres if its extent is so many times the length of the arm.
_LENGTHS = (0.02, 2.0)
_OF_TIPS = 4.0  # so many times the length tips and markers may be apart, in all of a recording


@dataclass(frozen=True)
class Measured:
    """What was measured of the arm, and how.

    Attributes:
        sources: topics, or none for the only one there is; several are of one marker each.
        marker_s: arc coordinate of each marker, increasing [m]; none for midlines and tips.
        marker_frames: names of the frames of the markers in TF, in the order of ``marker_s``.
        unit: of all lengths, of `LENGTH_UNITS`.
    """

    sources: tuple[str, ...] = ()
    marker_s: tuple[float, ...] = ()
    marker_frames: tuple[str, ...] = ()
    unit: str = 'm'

    def __post_init__(self) -> None:
        """Validate.

        Raises:
            MeasurementError: if the numbers of markers differ.
        """
        given = ('--marker-frames', self.marker_frames), ('--midlines', self.sources[1:])
        for name, names in given:
            count = len(names) + (name == '--midlines')
            if names and count != len(self.marker_s):
                raise MeasurementError(
                    f'{name} names {count}, --marker-s has {len(self.marker_s)} values; expected '
                    'one for each marker'
                )


class Frame(NamedTuple):
    """Points seen at one time: stamp [ns], and (m, 3) [m], NaN for markers that were not seen."""

    stamp_ns: int
    points: FloatArray


class MeasuredPoints:
    """Checks points as they come, of whatever source.

    Attributes:
        frame_id: frame of the first ones; None before.
        marker_s: arc coordinates of the markers [m]; None of midlines and tips.
    """

    def __init__(self, measured: Measured, length: float) -> None:
        """Of an arm of ``length`` [m].

        Raises:
            MeasurementError: if markers cannot be where they are said to be.
        """
        self.frame_id: str | None = None
        self.marker_s = check_marker_s(measured.marker_s, length) if measured.marker_s else None
        self._count, self._length = len(measured.marker_s), length
        self._unit, self._factor = measured.unit, LENGTH_UNITS[measured.unit]

    def check_frame(self, frame_id: str) -> None:
        """Have all points be in one frame.

        Raises:
            MeasurementError: if they are not.
        """
        if self.frame_id is None:
            self.frame_id = frame_id
        elif frame_id != self.frame_id:
            raise MeasurementError(f'its frame is {frame_id!r}, expected {self.frame_id!r}')

    def check(self, points: FloatArray, is_midline: bool) -> FloatArray:
        """The ``points`` (m, 3), given in the unit, in metres.

        Raises:
            MeasurementError: if they cannot be points of this arm.
        """
        if self._count:
            return self._check_markers(points)
        if is_midline and len(points) < 2:
            raise MeasurementError(f'it has {len(points)} point(s), expected at least 2')
        if not np.isfinite(points).all():
            number = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
            raise MeasurementError(
                f'point {number + 1} is {points[number].tolist()}, expected finite numbers'
            )
        points = self._factor * points
        if is_midline:
            # The diagonal of the bounding box, to which noise adds little.
            size = float(np.linalg.norm(np.ptp(points, axis=0)))
            low, high = (factor * self._length for factor in _LENGTHS)
            if not low <= size <= high:
                raise MeasurementError(
                    f'it extends over {size:.4g} m, expected {low:.3g} to {high:.3g} m for an arm '
                    f'of {self._length:.4g} m{self.hint(size, low, high)}'
                )
        return points

    def _check_markers(self, points: FloatArray) -> FloatArray:
        if len(points) != self._count:
            raise MeasurementError(
                f'it has {len(points)} point(s), expected {self._count}, one for each of '
                '--marker-s'
            )
        if np.isinf(points).any():
            raise MeasurementError(
                'a point is infinite, expected finite numbers, or NaN if unseen'
            )
        seen = np.asarray(np.isfinite(points).all(axis=1))
        if not seen.any():
            raise MeasurementError('it shows no marker')
        return np.where(seen[:, np.newaxis], self._factor * points, np.nan)

    def check_together(self, frames: Sequence[Frame]) -> None:
        """Check how far apart tips or markers are in all ``frames``.

        Raises:
            MeasurementError: if no arm of this length reaches so far.
        """
        points = np.concatenate([frame.points for frame in frames])
        size = float(np.linalg.norm(np.nanmax(points, axis=0) - np.nanmin(points, axis=0)))
        high = _OF_TIPS * self._length
        if size > high:
            raise MeasurementError(
                f'measured points are up to {size:.4g} m apart, expected at most {high:.3g} m for '
                f'an arm of {self._length:.4g} m{self.hint(size, 0.0, high)}'
            )

    def hint(self, size: float, low: float, high: float) -> str:
        """A unit in which a ``size`` [m] would be from ``low`` to ``high``, as a question."""
        for unit, factor in LENGTH_UNITS.items():
            if unit != self._unit and low <= size / self._factor * factor <= high:
                return f'; are they in {unit}? then say --length-unit {unit}'
        return ''


class MeasuredTopics:
    """Reads measured points off the topics of a bag."""

    def __init__(self, reader: Any, measured: Measured, points: MeasuredPoints) -> None:
        """Read from ``reader``, and check ``points``.

        Raises:
            BagError: if a topic is missing, or of a type without points.
        """
        self._reader, self._measured, self._points = reader, measured, points
        what = 'markers' if measured.marker_s else 'midlines or tips'
        if measured.marker_frames:
            names = measured.sources or ('/tf',)
            self.topics = [reader.pick(name, (TF,), what) for name in names]
        elif len(measured.sources) > 1:
            self.topics = [reader.pick(name, ONE, what) for name in measured.sources]
        else:
            types = (*MIDLINES, *ONE)
            name = measured.sources[0] if measured.sources else None
            self.topics = [reader.pick(name, types, what)]

    def read(self, skip: Callable[[str, int, str], None]) -> Iterator[Frame]:
        """Frames in the order of their stamps; ``skip`` is told topic, stamp and reason of others.

        Markers of several topics, or of TF, with the same stamp are one frame.
        """
        frames: dict[int, FloatArray] = {}
        is_joined = bool(self._measured.marker_frames) or len(self.topics) > 1
        for record in self._reader.messages(list(dict.fromkeys(self.topics))):
            try:
                for stamp, points in self._of(record, skip):
                    if not is_joined:
                        yield Frame(stamp, points)
                    elif stamp in frames:
                        seen = np.isfinite(points)
                        frames[stamp][seen] = points[seen]
                    else:
                        frames[stamp] = points
            except OctoArmError as error:
                skip(record.topic, self._stamp(record), str(error))
        for stamp in sorted(frames):
            yield Frame(stamp, frames[stamp])

    def _stamp(self, record: Any) -> int:
        from octo_arm_model.bags.records import stamp_of

        try:
            return stamp_of(self._reader.decode(record), record.received_ns).ns
        except OctoArmError:
            return int(record.received_ns)

    def _of(
        self, record: Any, skip: Callable[[str, int, str], None]
    ) -> Iterator[tuple[int, FloatArray]]:
        """Stamps and points of a message.

        Raises:
            OctoArmError: if it holds none of this arm.
        """
        from octo_arm_model.bags.records import stamp_of

        message, kind = self._reader.decode(record), record.type_name
        if kind == TF:
            yield from self._of_tf(message, record, skip)
            return
        stamp = stamp_of(message, record.received_ns).ns
        self._points.check_frame(str(message.header.frame_id))
        positions = _POSITIONS[kind](message)
        points = np.array([(p.x, p.y, p.z) for p in positions], dtype=np.float64).reshape(-1, 3)
        if len(self.topics) > 1:
            points = self._alone(self.topics.index(record.topic), points[0])
        yield stamp, self._points.check(points, kind in MIDLINES)

    def _of_tf(
        self, message: Any, record: Any, skip: Callable[[str, int, str], None]
    ) -> Iterator[tuple[int, FloatArray]]:
        from octo_arm_model.bags.records import stamp_of

        for transform in message.transforms:
            name = str(transform.child_frame_id)
            if name not in self._measured.marker_frames:
                continue
            stamp = stamp_of(transform, record.received_ns).ns
            try:
                self._points.check_frame(str(transform.header.frame_id))
                at = transform.transform.translation
                number = self._measured.marker_frames.index(name)
                points = self._alone(number, np.array([at.x, at.y, at.z]))
                yield stamp, self._points.check(points, False)
            except MeasurementError as error:
                skip(record.topic, stamp, f'{name}: {error}')

    def _alone(self, number: int, point: FloatArray) -> FloatArray:
        """Markers of which that with a ``number`` alone is seen, at ``point``."""
        points = np.full((len(self._measured.marker_s), 3), np.nan)
        points[number] = point
        return points


# The positions in a message, by type: of many points, and of one.
_MANY: dict[str, Callable[[Any], list[Any]]] = {
    'nav_msgs/msg/Path': lambda message: [pose.pose.position for pose in message.poses],
    'geometry_msgs/msg/PoseArray': lambda message: [pose.position for pose in message.poses],
}
_ONE: dict[str, Callable[[Any], list[Any]]] = {
    'geometry_msgs/msg/PoseStamped': lambda message: [message.pose.position],
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda message: [message.pose.pose.position],
    'geometry_msgs/msg/PointStamped': lambda message: [message.point],
    'geometry_msgs/msg/TransformStamped': lambda message: [message.transform.translation],
}
_POSITIONS = {**_MANY, **_ONE}
MIDLINES, ONE = tuple(_MANY), tuple(_ONE)


def in_short(refusals: Refusals) -> str:
    """The most frequent reason, for an error message."""
    lines = refusals.lines()
    return f'; {lines[0]}' if lines else ''
