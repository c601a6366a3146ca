"""Readers of tensions, encoder readings and measured points in a bag or a CSV table."""

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from octo_arm_model.arm.errors import BagError, ConfigError, MeasurementError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.bags.reader import BagReader, Record, stamp_of
from octo_arm_model.bags.topics import (
    DESCRIPTION,
    MIDLINE,
    TABLE,
    ArmTopics,
    Source,
    as_described,
    describe,
    namespace,
)
from octo_arm_model.bags.writer import LEVEL, TENSIONS, BagWriter, SensorMessages
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.estimation.settings import PREFIX
from octo_arm_model.experiment import csv_recording
from octo_arm_model.experiment.csv_recording import DISPLACEMENT, NO_READING, CsvSources
from octo_arm_model.experiment.csv_table import check_columns, read_csv
from octo_arm_model.experiment.recording import Count, MarkerSources, MeasuredPoints, StampedRows
from octo_arm_model.experiment.transform_tree import TransformTree
from octo_arm_model.wire.measurements import MARKERS, MIDLINES, ONE, POSITIONS, TIP_POSE, points_of
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import DISPLACEMENTS, TENSION_TOPICS, field_of

TF = 'tf2_msgs/msg/TFMessage'
MOST_TRANSFORMS = 4_000_000  # transforms kept at once, 64 bytes each
_STATIC = 'tf_static'  # last name of topics whose transforms hold at all times

T = TypeVar('T')


class MeasuredTopics:
    """Reads measured points from the topics of a bag."""

    def __init__(
        self,
        offered: ArmTopics,
        measured: MarkerSources,
        points: MeasuredPoints,
        base_frame: str,
        count: Count,
    ) -> None:
        """Choose among the topics ``offered`` those with the points that ``measured`` describes.

        ``points`` checks them, and ``count`` counts the messages.

        Raises:
            BagError: if a topic is missing, or has a type without points.
        """
        self._reader, self._measured, self._points = offered.reader, measured, points
        self._base_frame, self._count = base_frame, count
        self.topics: list[str] = []
        self._fields: dict[str, str] = {}  # field with the points, by topic
        what = 'markers' if measured.marker_s else 'midlines or tips'
        if measured.marker_frames:
            names = (
                measured.sources
                or [topic for topic, kind in self._reader.topics.items() if kind == TF]
                or ['/tf']
            )
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
        count.expect(self._reader.count(list(dict.fromkeys(self.topics))))

    def read(self, refusals: Refusals) -> StampedRows:
        """Return all frames; ``refusals`` count the messages that are left out.

        Markers of several topics, or of TF, with the same stamp are one frame.

        Raises:
            MeasurementError: if no transforms of TF lead to a marker, or there are too many.
        """
        source, frames = ', '.join(self.topics), dict[int, FloatArray]()
        is_tf = bool(self._measured.marker_frames)
        if not is_tf and len(self.topics) == 1:
            pairs = list(self._messages(refusals, self._read))
            stamps = [stamp for stamp, _ in pairs]
            return StampedRows(source, stamps, [points for _, points in pairs])
        read = self._read_transforms if is_tf else partial(self._messages, read=self._read)
        for stamp, points in read(refusals):
            visible = np.isfinite(points)
            frames.setdefault(stamp, points)[visible] = points[visible]
        return StampedRows(source, sorted(frames), [frames[stamp] for stamp in sorted(frames)])

    def _messages(
        self, refusals: Refusals, read: Callable[[Record, Any], T]
    ) -> Iterator[tuple[int, T]]:
        """Yield the stamp [ns] of each message and the result of ``read``, unless that refuses."""
        for record in self._reader.messages(list(dict.fromkeys(self.topics))):
            self._count.add()
            stamp, result, reason = self._reader.read(record, partial(read, record))
            if result is None:
                refusals.count(record.topic, reason)
            else:
                yield stamp.ns, result

    def _read(self, record: Record, message: Any) -> FloatArray:
        """Return the checked points of a ``message``."""
        field = self._fields.get(record.topic)
        data = POSITIONS[record.type_name](message) if field is None else field_of(message, field)
        points = points_of(data, self._measured.marker_names)
        self._points.check_frame(str(getattr(getattr(message, 'header', None), 'frame_id', '')))
        if len(self.topics) > 1:
            if len(points) != 1:
                raise MeasurementError(f'it has {len(points)} points, expected one marker')
            points = self._single_marker(self.topics.index(record.topic), points[0])
        is_midline = record.type_name in MIDLINES if field is None else len(points) > 1
        return self._points.check(points, is_midline)

    def _read_transforms(self, refusals: Refusals) -> Iterator[tuple[int, FloatArray]]:
        """Yield stamps and points of each marker, from chains of transforms.

        Points are in base_frame if transforms lead there, otherwise in the root of the chain.
        """
        tree, number, topics = TransformTree(), 0, ' and '.join(self.topics)
        messages = self._messages(
            refusals,
            lambda record, message: [(record, transform) for transform in message.transforms],
        )
        for _, transforms in messages:
            number += len(transforms)
            if number > MOST_TRANSFORMS:
                raise MeasurementError(f'{topics}: more than {MOST_TRANSFORMS} transforms')
            for record, transform in transforms:
                is_static = record.topic.endswith(_STATIC)
                shift, q = transform.transform.translation, transform.transform.rotation
                parts = np.array([shift.x, shift.y, shift.z]), np.array([q.x, q.y, q.z, q.w])
                names = str(transform.header.frame_id), str(transform.child_frame_id)
                try:
                    stamp = stamp_of(transform, record.received_ns).ns
                    tree.add(*names, stamp, *parts, is_static)
                except OctoArmError as error:
                    refusals.count(record.topic, str(error))
        for number, name in enumerate(self._measured.marker_frames):
            root = tree.chain(name)[-1]
            target = self._base_frame if tree.connects(name, self._base_frame) else root
            self._points.check_frame(target)

            def leave_out(reason: object, name: str = name) -> None:
                refusals.count(topics, f'{name}: {reason}')

            for stamp, point in zip(*tree.origins(name, target, leave_out)):
                try:
                    yield int(stamp), self._points.check(self._single_marker(number, point), False)
                except MeasurementError as error:
                    leave_out(error)

    def _single_marker(self, number: int, point: FloatArray) -> FloatArray:
        """Return a frame with only the marker of this ``number`` visible, at ``point``."""
        points = np.full((len(self._measured.marker_s), 3), np.nan)
        points[number] = point
        return points


class BagRecording:
    """The topics of tensions and encoder readings in a bag, unless they come from files.

    Attributes:
        reader: the bag.
        topics: topics of the arm of which a topic was named, or of all arms.
        cells: topic of the tensions, or None.
        encoders: topic of the encoder readings, or None.
        count: counter of the messages that are read.
        notes: remarks on the bag.
    """

    def __init__(
        self,
        reader: BagReader,
        tensions: str | None,
        displacements: str | None,
        files: CsvSources,
        count: Count,
    ) -> None:
        """Choose the topics; ``tensions`` and ``displacements`` are TOPIC, TOPIC:FIELD or None.

        Raises:
            BagError: if there are neither tensions nor displacements, or a topic is missing.
        """
        self.reader, self.count, self.notes = reader, count, notes_on(reader)
        self.topics = ArmTopics.beside(reader, tensions or displacements)
        self.cells: Source | None = None
        has_file = files.displacements is not None
        self.encoders = None if has_file else self.topics.displacements(displacements)
        if files.tensions is None:
            without = (self.encoders.topic,) if self.encoders else ()
            try:
                self.cells = self.topics.tensions(tensions, without)
            except BagError:
                if tensions is not None or not (self.encoders or has_file):
                    raise

    def described(self) -> dict[str, Any]:
        """Return the parameters of the arm; ConfigError if the bag has no description of it."""
        topic, *_ = self.cells or self.encoders or ('/',)
        return describe(self.reader, namespace(topic, (*TENSION_TOPICS, DISPLACEMENTS)))

    def readings(
        self, source: Source | None, config: Config, refusals: Refusals
    ) -> StampedRows | None:
        """Return tensions or encoder readings, NaN for tendons without one, or None."""
        if source is None:
            return None
        rows, names = StampedRows(source.topic, [], []), config.arm.tendon_names
        self.count.expect(self.reader.count([source.topic]))
        for record in self.reader.messages([source.topic]):
            self.count.add()
            reading = source.read(self.reader, config, record)
            if reading.is_refused or reading.displacements == {}:
                refusals.count(source.topic, reading.reason or NO_READING)
                continue
            rows.stamps.append(reading.stamp.ns)
            if reading.tensions is not None:
                row = reading.tensions.ravel()
            else:
                lengths = reading.displacements or {}
                row = np.array([lengths.get(name, np.nan) for name in names])
            rows.rows.append(row)
        return rows


def notes_on(reader: BagReader) -> list[str]:
    """Return remarks on the state of a bag and on its metadata."""
    synthetic = any('synthetic' in text for text in reader.metadata.values())
    return [*(['the bag says that it is synthetic'] if synthetic else []), *reader.notes]


@contextlib.contextmanager
def opened(
    path: Path,
    parameters: Mapping[str, Any] | None,
    calibration: Mapping[str, Any],
    columns: Mapping[str, str],
    marker_names: tuple[str, ...] = (),
    to_base: Callable[[FloatArray], FloatArray] | None = None,
) -> Iterator[BagReader]:
    """Open the bag at ``path``, or a temporary bag made from the table there, which ends in .csv.

    Args:
        path: path of the bag or the table. Rows of a table have tensions or encoder readings, and
            perhaps tips, markers or midlines, at their times or a second apart.
        parameters: parameters of the arm, which a table needs, and of the estimator.
        calibration: parameters of load cells and encoders that replace those.
        columns: columns of a table by quantity.
        marker_names: names of the markers at estimator.marker_s in a table.
        to_base: transforms points (..., 3) [m] of a table to base_frame; None leaves them out, as
            nothing says what frame they are in.

    Raises:
        BagError: if there is no such bag, or ``columns`` are given for a bag.
        ConfigError: if there is no arm for a table.
        MeasurementError: if a table cannot be read, or has neither tensions nor encoder readings.
    """
    if path.suffix != '.csv':
        if columns or marker_names:
            raise BagError(f'{path}: --columns and --marker-names are of tables that end in .csv')
        with BagReader(path) as reader:
            yield reader
        return
    if parameters is None:
        raise ConfigError('no arm: for a table it has to be given by --config')
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / 'table'
        values = {**parameters, **calibration}
        notes = _write(written, path, values, columns, marker_names, to_base)
        with BagReader(written, path, notes) as reader:
            yield reader


def _write(
    written: Path,
    path: Path,
    parameters: dict[str, Any],
    columns: Mapping[str, str],
    marker_names: tuple[str, ...],
    to_base: Callable[[FloatArray], FloatArray] | None,
) -> list[str]:
    """Write the bag of a table; return remarks on rows that were left out."""
    arm_values = {name: value for name, value in parameters.items() if not name.startswith(PREFIX)}
    config, refusals = Config.from_parameters(arm_values), Refusals()
    table = read_csv(path, CsvSources(columns=columns).columns_of(''), has_time=False)
    marker_s = tuple(parameters.get(f'{PREFIX}marker_s', ()))
    measured = MarkerSources(marker_s=marker_s, marker_names=marker_names)
    has_cells, has_encoders = (
        csv_recording.has_tensions(table, config),
        csv_recording.has_displacements(table, config),
    )
    if not (has_cells or has_encoders):
        name = config.arm.tendon_names[0]
        raise MeasurementError(
            f'{path}: no column {name} or {DISPLACEMENT}{name}, nor those of another tendon; '
            f'{table.listing}; say --columns {name}=COLUMN'
        )
    if (first := min(table.times())) < 0:
        raise MeasurementError(f'{path}: time is {1e-9 * first} s, expected none below 0')
    with BagWriter(written, custom={TABLE: path.name}) as writer:
        writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(as_described(arm_values)), first)
        messages = SensorMessages(writer, config)
        if has_cells:
            messages.add_all(TENSIONS, *csv_recording.csv_readings(table, config))
        if has_encoders:
            lengths = csv_recording.csv_displacements(table, config, refusals)
            messages.add_all(DISPLACEMENTS, lengths.stamps, lengths.rows)
        has_points = csv_recording.has_points(table, measured)
        if has_points and to_base is not None:
            points = MeasuredPoints(measured, config.arm.length)
            frames = csv_recording.csv_frames(table, measured, points, refusals)
            for stamp, row in zip(frames.stamps, map(to_base, frames.rows)):
                if marker_s or len(row) > 1:
                    messages.add(MARKERS if marker_s else MIDLINE, stamp, row)
                else:
                    messages.add(TIP_POSE, stamp, row, LEVEL, np.zeros((6, 6)))
        check_columns(columns, {'': table})
        messages.write()
    if has_points and to_base is None:
        left_out = f'the points of {path.name} are left out, as their frame is not known'
        return [*refusals.lines(), f'{left_out}: `octo-arm compare --pose-csv` fits it']
    return refusals.lines()
