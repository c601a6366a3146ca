"""A recording: tensions, and measured midlines, tips or markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.config.config import Config, load_parameters
from octo_arm_model.config.presets import find_path
from octo_arm_model.core.errors import BagError, MeasurementError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.experiment.recording.measured_topics import (
    Frame,
    Measured,
    MeasuredPoints,
    MeasuredTopics,
    in_short,
)
from octo_arm_model.wire.refusals import Refusals

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


def read_recording(
    path: Path | str,
    config: str | None = None,
    tensions: str | None = None,
    measured: Measured = Measured(),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Recording:
    """Read the bag at ``path``.

    Args:
        path: the bag.
        config: parameter file or preset of the arm; None for the arm_description in the bag.
        tensions: topic of the tensions; None for the only one there is.
        measured: what was measured; of no topics the only one that the model itself does not
            publish.
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
        parameters = dict(find_arms(reader, [topic], given)[0].parameters)
        arm_config = Config.from_parameters(parameters)
        points = MeasuredPoints(measured, arm_config.arm.length)
        topics = MeasuredTopics(reader, measured, points)
        notes: list[str] = []
        if any('synthetic' in text for text in reader.metadata.values()):
            notes.append('the bag says that it is synthetic')
        notes += reader.notes
        skips = Skips()
        stamped = Stamped(topic, [], [])
        total = reader.count([topic, *dict.fromkeys(topics.topics)])
        for done, reading in enumerate(read_tensions(reader, topic, arm_config)):
            progress(done, total)
            if reading.tensions is None:
                skips(topic, reading.stamp_ns, reading.reason)
            else:
                stamped.stamps.append(reading.stamp_ns)
                stamped.rows.append(reading.tensions.ravel())
        if not stamped.rows:
            raise BagError(
                f'{path}: no tensions for this arm on {topic}{in_short(skips.refusals)}'
            )
        found = []
        for frame in topics.read(skips):
            found.append(frame)
            progress(min(len(stamped.rows) + len(found), total), total)
        source = ', '.join(topics.topics)
        return assemble(parameters, stamped, found, source, measured, points, skips, notes)


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
