"""A recording: tensions, and measured midlines, tips or markers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from octo_arm_model.config.config import Config, load_parameters
from octo_arm_model.config.presets import find_path
from octo_arm_model.core.errors import BagError, ConfigError, MeasurementError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.experiment.recording.csv_recording import csv_frames, csv_tensions
from octo_arm_model.experiment.recording.csv_table import read_csv
from octo_arm_model.experiment.recording.measured_topics import (
    Frame,
    Measured,
    MeasuredPoints,
    MeasuredTopics,
    in_short,
)
from octo_arm_model.wire.refusals import Refusals

if TYPE_CHECKING:
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.bags.tensions import Reading

_KEPT = 1000  # messages left out that are kept one by one; all are counted


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
        frames: midlines as they were measured, each (m, 3) [m]; tips are (1, 3). Of markers all
            have one point for each of ``marker_s``, NaN where it was not seen.
        frame_id: frame they are in.
        skipped: the first of the messages left out.
        notes: remarks.
        marker_s: arc coordinate of each marker [m]; None of midlines and tips.
        refusals: counts of the messages left out, by topic and reason.
    """

    parameters: dict[str, Any]
    tension_time: FloatArray
    tensions: FloatArray
    frame_time: FloatArray
    frames: tuple[FloatArray, ...]
    frame_id: str
    skipped: tuple[SkippedMessage, ...] = ()
    notes: tuple[str, ...] = ()
    marker_s: FloatArray | None = None
    refusals: Refusals = field(default_factory=Refusals)

    @property
    def is_tips(self) -> bool:
        """Whether tips were measured and no midlines."""
        return self.marker_s is None and all(len(points) == 1 for points in self.frames)


class Skips:
    """What is left out on the way into a recording.

    Attributes:
        kept: the first of them.
        refusals: their counts.
    """

    def __init__(self) -> None:
        """Nothing is left out yet."""
        self.kept: list[SkippedMessage] = []
        self.refusals = Refusals()

    def __call__(self, topic: str, stamp_ns: int, reason: str) -> None:
        """Leave a message out."""
        self.refusals.count(topic, reason)
        if len(self.kept) < _KEPT:
            self.kept.append(SkippedMessage(topic, stamp_ns, reason))


class Stamped(NamedTuple):
    """Sets of tensions and their stamps.

    Attributes:
        source: topic or file.
        stamps: [ns].
        rows: (n, tendons) [N].
    """

    source: str
    stamps: list[int]
    rows: list[FloatArray]


@dataclass(frozen=True)
class CsvSources:
    """CSV files in place of topics.

    Attributes:
        tensions: of the tensions; None for those in the bag.
        midlines: of what was measured; None for that in the bag.
        columns: which column is what, see `read_csv`.
    """

    tensions: Path | None = None
    midlines: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


def read_recording(
    path: Path | str | None,
    config: str | None = None,
    tensions: str | None = None,
    measured: Measured = Measured(),
    files: CsvSources = CsvSources(),
    tendons: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Recording:
    """Read the bag at ``path``, or CSV files, or tensions from one and midlines from the other.

    Args:
        path: the bag; None where all is in files.
        config: parameter file or preset of the arm; None for the arm_description in the bag.
        tensions: topic of the tensions, or TOPIC:FIELD; None for the only one there is.
        measured: what was measured; of no topics the only one that the model itself does not
            publish.
        files: CSV files in place of topics.
        tendons: what the tendons are called there, in place of tension_names.
        progress: called with the numbers of messages read and of all messages.

    Raises:
        BagError: if the bag cannot be read or a topic is missing.
        ConfigError: if there is no arm, or it cannot be.
        MeasurementError: if no message holds a midline in metres, or a file cannot be read.
    """
    given = None if config is None else load_parameters(find_path(config))
    if files.tensions is not None and files.midlines is not None:
        if given is None:
            raise ConfigError('no arm: without a bag it has to be given by --config')
        return _gather(None, given, tensions, measured, files, tendons, progress)
    if path is None:
        raise MeasurementError('expected a bag, or --tension-csv and --midline-csv')
    from octo_arm_model.bags.reader import BagReader

    with BagReader(path) as reader:
        return _gather(reader, given, tensions, measured, files, tendons, progress)


def _gather(
    reader: BagReader | None,
    given: dict[str, Any] | None,
    tensions: str | None,
    measured: Measured,
    files: CsvSources,
    tendons: Sequence[str],
    progress: Callable[[int, int], None],
) -> Recording:
    """Tensions and frames, each from a file or from the bag of ``reader``."""
    skips, notes = Skips(), list[str]()
    topic, field = None, ''
    if reader is not None:
        from octo_arm_model.bags.arms import describe, find_arms
        from octo_arm_model.bags.tensions import pick_tensions

        if any('synthetic' in text for text in reader.metadata.values()):
            notes.append('the bag says that it is synthetic')
        notes += reader.notes
        if files.tensions is None:
            topic, field = pick_tensions(reader, tensions)
            wanted = f'{topic}:{field}' if field else topic
            given = dict(find_arms(reader, [wanted], given)[0].parameters)
        elif given is None:
            given = describe(reader)
    assert given is not None
    if tendons:
        given['tension_names'] = list(tendons)
    config = Config.from_parameters(given)
    points = MeasuredPoints(measured, config.arm.length)
    topics = None
    if files.midlines is None:
        assert reader is not None
        topics = MeasuredTopics(reader, measured, points)
    total = 0
    if reader is not None:
        names = [topic] if topic is not None else []
        names += topics.topics if topics is not None else []
        total = reader.count(list(dict.fromkeys(names)))
    if topic is not None and reader is not None:
        from octo_arm_model.bags.tensions import read_tensions

        readings = read_tensions(reader, topic, config, field)
        stamped = _tensions_of(topic, readings, skips, lambda done: progress(done, total))
    else:
        assert files.tensions is not None
        table = read_csv(files.tensions, files.columns)
        stamped = Stamped(str(files.tensions), *csv_tensions(table, config, skips))
    if not stamped.rows:
        where = reader.path if topic is not None and reader is not None else files.tensions
        raise BagError(
            f'{where}: no tensions for this arm on {stamped.source}{in_short(skips.refusals)}'
        )
    if topics is not None:
        source, found = ', '.join(topics.topics), []
        for frame in topics.read(skips):
            found.append(frame)
            progress(min(len(stamped.rows) + len(found), total), total)
    else:
        assert files.midlines is not None
        source = str(files.midlines)
        found = csv_frames(read_csv(files.midlines, files.columns), measured, points, skips)
    return assemble(given, stamped, found, source, measured, points, skips, notes)


def _tensions_of(
    topic: str, readings: Iterable[Reading], skips: Skips, progress: Callable[[int], None]
) -> Stamped:
    """Tensions of a topic."""
    stamped = Stamped(topic, [], [])
    for done, one in enumerate(readings):
        progress(done)
        if one.tensions is None:
            skips(topic, one.stamp_ns, one.reason)
        else:
            stamped.stamps.append(one.stamp_ns)
            stamped.rows.append(one.tensions.ravel())
    return stamped


def assemble(
    parameters: dict[str, Any],
    tensions: Stamped,
    frames: Sequence[Frame],
    source: str,
    measured: Measured,
    points: MeasuredPoints,
    skips: Skips,
    notes: list[str],
) -> Recording:
    """A recording of ``tensions`` and ``frames``, which come from ``source``.

    Raises:
        MeasurementError: if there are no frames, or they are not of this arm.
    """
    if not frames:
        raise MeasurementError(f'nothing measured on {source}{in_short(skips.refusals)}')
    if measured.marker_s or all(len(frame.points) == 1 for frame in frames):
        points.check_together(frames)
    origin = min(tensions.stamps)
    tension_time, order = _in_order(tensions.stamps, origin, tensions.source, notes)
    table = np.array(tensions.rows)[order]
    stamps = [frame.stamp_ns for frame in frames]
    frame_time, order = _in_order(stamps, origin, source, notes)
    return Recording(
        parameters, tension_time, table, frame_time, tuple(frames[i].points for i in order),
        points.frame_id or '', tuple(skips.kept), tuple(notes), points.marker_s, skips.refusals,
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
