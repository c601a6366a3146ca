"""Readers of tensions, encoder readings and measured points in a bag."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from octo_arm_model.arm.errors import BagError, MeasurementError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader, Record, stamp_of
from octo_arm_model.bags.topics import ArmTopics, Source, describe, namespace
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.csv_recording import NO_READING, CsvSources
from octo_arm_model.experiment.recording import Count, MarkerSources, MeasuredPoints, StampedRows
from octo_arm_model.experiment.transform_tree import TransformTree
from octo_arm_model.wire.measurements import MIDLINES, ONE, POSITIONS, points_of
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENSION_TOPICS, field_of

TF = 'tf2_msgs/msg/TFMessage'
MOST_TRANSFORMS = 4_000_000  # transforms kept at once, 64 bytes each
_STATIC = 'tf_static'  # last name of topics whose transforms hold at all times

T = TypeVar('T')


class MeasuredTopics:
    """Reads measured points from the topics of a bag."""

    def __init__(self, offered: ArmTopics, measured: MarkerSources, count: Count) -> None:
        """Choose among the topics ``offered`` those with the points that ``measured`` describes.

        ``count`` counts the messages.

        Raises:
            BagError: if a topic is missing, or has a type without points.
        """
        self._reader, self._measured, self._count = offered.reader, measured, count
        self.topics: list[str] = []
        self._fields: dict[str, str] = {}  # field with the points, by topic
        what = 'markers' if measured.marker_s else 'midlines or tips'
        if measured.marker_frames:
            names = measured.sources or tf_topics(self._reader) or ['/tf']
            self.topics = [offered.named(name, (TF,), what) for name in names]
        else:
            several = len(measured.sources) > 1
            for source in measured.sources or (None,):
                name, colon, field = (source or '').partition(':')
                if colon:
                    self.topics.append(offered.named(name, None, what))
                    self._fields[self.topics[-1]] = field
                else:
                    kinds = ONE if several else (*MIDLINES, *ONE)
                    self.topics.append(offered.pick(name or None, kinds, what))
            if len(set(self.topics)) < len(self.topics):
                raise MeasurementError('--midlines names a topic twice, expected each once')

    def read(
        self, points: MeasuredPoints, base_frame: str, refusals: Refusals, notes: list[str]
    ) -> StampedRows:
        """Return all frames, which ``points`` checks; ``refusals`` count messages left out.

        Markers of several topics, or of TF, with the same stamp are one frame. Points of a frame
        that moves by TF are transformed to base_frame, which ``notes`` then say.

        Raises:
            MeasurementError: if no transforms of TF lead to a marker, or there are too many.
        """
        rows, frames = StampedRows(', '.join(self.topics)), dict[int, FloatArray]()
        if self._measured.marker_frames:
            pairs = self._read_transforms(points, base_frame, refusals)
        else:
            pairs = (
                (stamp_ns, frame)
                for _, stamp_ns, frame in read_messages(
                    self._reader, self.topics, partial(self._read, points), refusals, self._count
                )
            )
        for stamp, frame in pairs:
            if self._measured.marker_frames or len(self.topics) > 1:
                visible = np.isfinite(frame)
                frames.setdefault(stamp, frame)[visible] = frame[visible]
            else:
                rows.add(stamp, frame)
        for stamp in sorted(frames):
            rows.add(stamp, frames[stamp])
        frame_id, topics = points.frame_id or base_frame, tf_topics(self._reader)
        is_known = self._measured.is_aligned or self._measured.marker_frames
        if is_known or frame_id == base_frame or not topics:
            return rows
        tree = read_transforms(self._reader, topics, refusals, self._count)
        if not tree.moves(frame_id, base_frame):
            return rows
        moved = StampedRows(rows.source)
        for stamp, row in zip(rows.stamps, rows.rows, strict=True):
            try:
                moved.add(stamp, tree.pose(frame_id, base_frame, stamp).to_base(row))
            except OctoArmError as error:
                refusals.count(rows.source, str(error))
        points.frame_id = base_frame
        by = ' and '.join(topics)
        notes.append(f'{frame_id!r} moves in {base_frame!r} by {by}, which is used')
        return moved

    def _read(self, checks: MeasuredPoints, record: Record, message: Any) -> FloatArray:
        """Return the points of a ``message`` after ``checks``."""
        field = self._fields.get(record.topic)
        data = POSITIONS[record.type_name](message) if field is None else field_of(message, field)
        points = points_of(data, self._measured.marker_names)
        checks.check_frame(str(getattr(getattr(message, 'header', None), 'frame_id', '')))
        if len(self.topics) > 1:
            if len(points) != 1:
                raise MeasurementError(f'it has {len(points)} points, expected one marker')
            points = self._single_marker(self.topics.index(record.topic), points[0])
        is_midline = record.type_name in MIDLINES if field is None else len(points) > 1
        return checks.check(points, is_midline)

    def _read_transforms(
        self, points: MeasuredPoints, base_frame: str, refusals: Refusals
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yield stamps and points of each marker, from chains of transforms.

        Points are in base_frame if transforms lead there, otherwise in the root of the chain.
        """
        topics = ' and '.join(self.topics)
        tree = read_transforms(self._reader, self.topics, refusals, self._count)
        for number, name in enumerate(self._measured.marker_frames):
            root = tree.chain(name)[-1]
            target = base_frame if tree.connects(name, base_frame) else root
            points.check_frame(target)

            def leave_out(reason: object, name: str = name) -> None:
                refusals.count(topics, f'{name}: {reason}')

            for stamp, point in zip(*tree.origins(name, target, leave_out)):
                try:
                    yield int(stamp), points.check(self._single_marker(number, point), False)
                except MeasurementError as error:
                    leave_out(error)

    def _single_marker(self, number: int, point: FloatArray) -> FloatArray:
        """Return a frame with only the marker of this ``number`` visible, at ``point``."""
        points = np.full((len(self._measured.marker_s), 3), np.nan)
        points[number] = point
        return points


def read_messages(
    reader: BagReader,
    topics: Sequence[str],
    read: Callable[[Record, Any], T],
    refusals: Refusals,
    count: Count,
) -> Iterator[tuple[Record, int, T]]:
    """Yield each message of ``topics``, its stamp [ns] and the result of ``read``.

    ``refusals`` count the messages that ``read`` refuses, and ``count`` counts all of them.
    """
    different = list(dict.fromkeys(topics))
    count.expect(reader.count(different))
    for record in reader.messages(different):
        count.add()
        stamp, result, reason = reader.read(record, partial(read, record))
        if result is None:
            refusals.count(record.topic, reason)
        else:
            yield record, stamp.ns, result


def tf_topics(reader: BagReader) -> list[str]:
    """Return the topics of transforms in a bag."""
    return [topic for topic, kind in reader.topics.items() if kind == TF]


def read_transforms(
    reader: BagReader, topics: Sequence[str], refusals: Refusals, count: Count
) -> TransformTree:
    """Return the transforms on ``topics``; for the other arguments see `read_messages`.

    Raises:
        MeasurementError: if there are too many.
    """
    tree, number = TransformTree(), 0
    messages = read_messages(reader, topics, lambda _, m: list(m.transforms), refusals, count)
    for record, _, transforms in messages:
        number += len(transforms)
        if number > MOST_TRANSFORMS:
            raise MeasurementError(
                f'{" and ".join(topics)}: more than {MOST_TRANSFORMS} transforms'
            )
        for transform in transforms:
            is_static = record.topic.endswith(_STATIC)
            shift, q = transform.transform.translation, transform.transform.rotation
            parts = np.array([shift.x, shift.y, shift.z]), np.array([q.x, q.y, q.z, q.w])
            names = str(transform.header.frame_id), str(transform.child_frame_id)
            try:
                stamp = stamp_of(transform, record.received_ns).ns
                tree.add(*names, stamp, *parts, is_static)
            except OctoArmError as error:
                refusals.count(record.topic, str(error))
    return tree


class BagRecording:
    """The topics of a bag that tensions, encoder readings and points come from.

    Attributes:
        reader: the bag.
        notes: remarks on the bag.
    """

    def __init__(
        self,
        reader: BagReader,
        tensions: str | None,
        displacements: str | None,
        measured: MarkerSources,
        files: CsvSources,
        count: Count,
    ) -> None:
        """Choose topics for all that is not in ``files``.

        ``tensions`` and ``displacements`` are TOPIC, TOPIC:FIELD or None; ``measured`` describes
        the points, and ``count`` counts the messages.

        Raises:
            BagError: if there are neither tensions nor displacements, or a topic is missing.
        """
        self.reader, self._count, self.notes = reader, count, notes_on(reader)
        offered = ArmTopics.beside(reader, tensions or displacements)
        has_file = files.displacements is not None
        self._cells: Source | None = None
        self._encoders = None if has_file else offered.displacements(displacements)
        if files.tensions is None:
            without = (self._encoders.topic,) if self._encoders else ()
            try:
                self._cells = offered.tensions(tensions, without)
            except BagError:
                if tensions is not None or not (self._encoders or has_file):
                    raise
        self._frames = None
        if files.midlines is None:
            self._frames = MeasuredTopics(offered, measured, count)

    def described(self) -> dict[str, Any]:
        """Return the parameters of the arm; ConfigError if the bag has no description of it."""
        topic, *_ = self._cells or self._encoders or ('/',)
        return describe(self.reader, namespace(topic, (*TENSION_TOPICS, DISPLACEMENTS)))

    def read(
        self, config: Config, points: MeasuredPoints, refusals: Refusals
    ) -> tuple[StampedRows | None, StampedRows | None, StampedRows | None]:
        """Return tensions, encoder readings and frames; None for those without a topic."""
        tensions, encoders = (
            read_readings(self.reader, source, config, refusals, self._count)
            for source in (self._cells, self._encoders)
        )
        if self._frames is None:
            return tensions, encoders, None
        return (
            tensions,
            encoders,
            self._frames.read(points, config.base_frame, refusals, self.notes),
        )


def read_readings(
    reader: BagReader,
    source: Source | None,
    config: Config,
    refusals: Refusals,
    count: Count,
    *,
    raw: bool = False,
) -> StampedRows | None:
    """Return tensions or encoder readings of a bag, NaN for tendons without one.

    There are none without a ``source``. ``refusals`` count the messages left out, ``count`` all of
    them. ``raw`` tensions may be below zero by noise.

    Raises:
        BagError: if the bag is damaged.
    """
    if source is None:
        return None
    rows, names = StampedRows(source.topic), config.arm.tendon_names
    count.expect(reader.count([source.topic]))
    for record in reader.messages([source.topic]):
        count.add()
        reading = source.read(reader, config, record, raw=raw)
        if reading.reason or reading.displacements == {}:
            refusals.count(source.topic, reading.reason or NO_READING)
            continue
        row = reading.tensions
        if row is None:
            lengths = reading.displacements or {}
            row = np.array([lengths.get(name, np.nan) for name in names])
        rows.add(reading.stamp.ns, row.ravel())
        rows.received.append(record.received_ns)
    return rows


def notes_on(reader: BagReader) -> list[str]:
    """Return remarks on the state of a bag and on its metadata."""
    synthetic = any('synthetic' in text for text in reader.metadata.values())
    return [*(['the bag says that it is synthetic'] if synthetic else []), *reader.notes]
