"""Readings of tendons and measured points out of a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from octo_arm_model.arm.errors import BagError, MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.arms import describe, find_arms
from octo_arm_model.bags.reader import BagReader, Record, stamp_of
from octo_arm_model.bags.tensions import (
    Reading,
    TensionTopic,
    pick_tensions,
    read_lengths,
    read_topic,
)
from octo_arm_model.bags.topics import pick_topic, pick_usual
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.csv_recording import NO_READING, CsvSources
from octo_arm_model.experiment.measured_points import Frame, Measured, MeasuredPoints
from octo_arm_model.experiment.recording import Count, Stamped
from octo_arm_model.experiment.transform_tree import TransformTree
from octo_arm_model.wire.refusals import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENT_TYPE, DISPLACEMENTS

TF = 'tf2_msgs/msg/TFMessage'
MOST_TRANSFORMS = 4_000_000  # kept at once, 64 bytes each
_STATIC = 'tf_static'  # the name of topics whose transforms hold at all times

T = TypeVar('T')


class MeasuredTopics:
    """Reads measured points off the topics of a bag."""

    def __init__(
        self, reader: BagReader, measured: Measured, points: MeasuredPoints, base_frame: str
    ) -> None:
        """Read from ``reader``, and check ``points``, of an arm in ``base_frame``.

        Raises:
            BagError: if a topic is missing, or of a type without points.
        """
        self._reader, self._measured, self._points = reader, measured, points
        self._base_frame = base_frame
        what = 'markers' if measured.marker_s else 'midlines or tips'
        if measured.marker_frames:
            names = measured.sources or [
                topic for topic, kind in reader.topics.items() if kind == TF
            ] or ['/tf']  # fmt: skip
            self.topics = [pick_topic(reader, name, (TF,), what) for name in names]
        elif len(measured.sources) > 1:
            self.topics = [pick_topic(reader, name, ONE, what) for name in measured.sources]
        else:
            types = (*MIDLINES, *ONE)
            name = measured.sources[0] if measured.sources else None
            self.topics = [pick_topic(reader, name, types, what)]

    def read(self, refusals: Refusals, count: Count) -> Iterator[Frame]:
        """Frames in the order of their stamps; ``refusals`` count those left out.

        Markers of several topics, or of TF, with the same stamp are one frame. Each message
        is counted.

        Raises:
            MeasurementError: if no transforms of TF lead to a marker, or there are too many.
        """
        frames: dict[int, FloatArray] = {}
        is_tf = bool(self._measured.marker_frames)
        found = (
            self._of_tf(refusals, count) if is_tf else self._messages(refusals, count, self._read)
        )
        for stamp, points in found:
            if not is_tf and len(self.topics) == 1:
                yield Frame(stamp, points)
            elif stamp in frames:
                seen = np.isfinite(points)
                frames[stamp][seen] = points[seen]
            else:
                frames[stamp] = points
        for stamp in sorted(frames):
            yield Frame(stamp, frames[stamp])

    def _messages(
        self, refusals: Refusals, count: Count, read: Callable[[Record, Any], T]
    ) -> Iterator[tuple[int, T]]:
        """Stamps [ns] of messages and what ``read`` makes of each, left out where nothing."""
        for record in self._reader.messages(list(dict.fromkeys(self.topics))):
            count.add()
            stamp, found, reason = self._reader.read(record, partial(read, record))
            if found is None:
                refusals.count(record.topic, reason)
            else:
                yield stamp.ns, found

    def _read(self, record: Record, message: Any) -> FloatArray:
        """The points of a ``message``, checked."""
        positions = [(p.x, p.y, p.z) for p in _POSITIONS[record.type_name](message)]
        points = np.array(positions, dtype=np.float64).reshape(-1, 3)
        self._points.check_frame(str(message.header.frame_id))
        if len(self.topics) > 1:
            points = self._alone(self.topics.index(record.topic), points[0])
        return self._points.check(points, record.type_name in MIDLINES)

    def _of_tf(self, refusals: Refusals, count: Count) -> Iterator[tuple[int, FloatArray]]:
        """Stamps and points of each marker by chains of transforms.

        In base_frame where transforms lead there, otherwise in their root.
        """
        tree, number, topics = TransformTree(), 0, ' and '.join(self.topics)
        found = self._messages(
            refusals, count, lambda record, message: [(record, one) for one in message.transforms]
        )
        for _, transforms in found:
            number += len(transforms)
            if number > MOST_TRANSFORMS:
                raise MeasurementError(f'{topics}: more than {MOST_TRANSFORMS} transforms')
            for record, one in transforms:
                is_static = record.topic.endswith(_STATIC)
                stamp = stamp_of(one, record.received_ns).ns
                at, turn = one.transform.translation, one.transform.rotation
                parts = np.array([at.x, at.y, at.z]), np.array([turn.x, turn.y, turn.z, turn.w])
                names = str(one.header.frame_id), str(one.child_frame_id)
                try:
                    tree.add(*names, stamp, *parts, is_static)
                except MeasurementError as error:
                    refusals.count(record.topic, str(error))
        for number, name in enumerate(self._measured.marker_frames):
            root = tree.chain(name)[-1]
            target = self._base_frame if tree.connects(name, self._base_frame) else root
            self._points.check_frame(target)

            def leave_out(reason: str, name: str = name) -> None:
                refusals.count(topics, f'{name}: {reason}')

            for stamp, point in zip(*tree.origins(name, target, leave_out)):
                try:
                    yield int(stamp), self._points.check(self._alone(number, point), False)
                except MeasurementError as error:
                    leave_out(str(error))

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


class BagRecording:
    """The topics of a bag that tensions and encoder readings come from, where not from files.

    Attributes:
        reader: the bag.
        notes: remarks on it.
    """

    def __init__(
        self,
        reader: BagReader,
        tensions: str | None,
        displacements: str | None,
        files: CsvSources,
    ) -> None:
        """Choose the topics; ``tensions`` and ``displacements`` as in `read_recording`.

        Raises:
            BagError: if there is neither, or a topic is missing.
        """
        self.reader = reader
        self.notes = list(reader.notes)
        if any('synthetic' in text for text in reader.metadata.values()):
            self.notes.insert(0, 'the bag says that it is synthetic')
        self._encoders: str | None = None
        self._tensions: tuple[str, str] | None = None  # topic, and the field they are in
        if files.displacements is None:
            wanted = displacements, DISPLACEMENTS, (DISPLACEMENT_TYPE,), 'displacements'
            self._encoders = pick_usual(reader, *wanted)
        if files.tensions is not None:
            return
        try:
            self._tensions = pick_tensions(reader, tensions, self._encoders)
        except BagError:
            if tensions is not None or (self._encoders is None and files.displacements is None):
                raise

    def parameters(self, given: Mapping[str, Any] | None) -> dict[str, Any]:
        """Parameters of the arm: those ``given``, or else its description in the bag.

        Raises:
            ConfigError: if there is no description.
        """
        wanted = ':'.join(part for part in self._tensions or (self._encoders,) if part)
        if wanted:
            return dict(find_arms(self.reader, [wanted], given)[0].parameters)
        return dict(given) if given is not None else describe(self.reader)

    def tensions(self, config: Config, refusals: Refusals, count: Count) -> Stamped | None:
        """Tensions of the arm of ``config``; None if there is no topic of them."""
        if self._tensions is None:
            return None
        topic, field = self._tensions
        read = TensionTopic(self.reader, config, field).read
        return self._read(topic, read, config, refusals, count)

    def displacements(self, config: Config, refusals: Refusals, count: Count) -> Stamped | None:
        """Encoder readings likewise, NaN of tendons without an encoder."""
        if self._encoders is None:
            return None
        read = partial(read_lengths, self.reader, config.arm)
        return self._read(self._encoders, read, config, refusals, count)

    def _read(
        self,
        topic: str,
        read: Callable[[Sequence[Record]], list[Reading]],
        config: Config,
        refusals: Refusals,
        count: Count,
    ) -> Stamped:
        stamped, names = Stamped(topic, [], []), config.arm.tendon_names
        count.expect(self.reader.count([topic]))
        for _, one in read_topic(self.reader, topic, read):
            count.add()
            if one.is_refused or one.displacements == {}:
                refusals.count(topic, one.reason or NO_READING)
                continue
            stamped.stamps.append(one.stamp_ns)
            if one.tensions is not None:
                row = one.tensions.ravel()
            else:
                given = one.displacements or {}
                row = np.array([given.get(name, np.nan) for name in names])
            stamped.rows.append(row)
        return stamped
