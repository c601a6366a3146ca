"""A recording: tensions, and measured midlines, tips or markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.core.errors import MeasurementError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.experiment.recording.measured_points import Frame, Measured, MeasuredPoints
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


def in_short(refusals: Refusals) -> str:
    """The most frequent reason, for an error message."""
    lines = refusals.lines()
    return f'; {lines[0]}' if lines else ''
