"""A recording: tensions or encoder readings, and measured midlines, tips or markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.experiment.measured_points import Frame, Measured, MeasuredPoints
from octo_arm_model.wire.refusals import Refusals


class Count:
    """Counts work done, and the work that is known of so far.

    Attributes:
        done: so much.
        total: of so much.
    """

    def __init__(self, report: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Call ``report`` with both numbers as they change."""
        self._report, self.done, self.total = report, 0, 0

    def expect(self, more: int) -> None:
        """Know of ``more``."""
        self.total += more
        self._report(self.done, self.total)

    def add(self, some: int = 1) -> None:
        """Have done ``some`` more."""
        self.done += some
        self._report(self.done, self.total)


@dataclass(frozen=True)
class Recording:
    """Tensions, encoder readings and measured midlines with their stamps, in order of time.

    Attributes:
        parameters: those of the arm, see `Config.from_parameters`.
        tension_time: stamp of each set of tensions [s], (n,), from the first of those or of the
            encoder readings on.
        tensions: (n, tendons) [N]; none where there were no load cells.
        frame_time: stamp of each midline, on the same scale, (f,) [s].
        frames: midlines as they were measured, each (m, 3) [m]; tips are (1, 3). Of markers all
            have one point for each of ``marker_s``, NaN where it was not seen.
        frame_id: frame they are in.
        notes: remarks.
        marker_s: arc coordinate of each marker [m]; None of midlines and tips.
        refusals: counts of the messages left out, by topic and reason.
        displacement_time: stamp of each set of encoder readings, on the scale of tensions, (e,)
            [s].
        displacements: lengths reeled in by the winches, as their encoders read them, (e, tendons)
            [m]; NaN for tendons without.
    """

    parameters: dict[str, Any]
    tension_time: FloatArray
    tensions: FloatArray
    frame_time: FloatArray
    frames: tuple[FloatArray, ...]
    frame_id: str
    notes: tuple[str, ...] = ()
    marker_s: FloatArray | None = None
    refusals: Refusals = field(default_factory=Refusals)
    displacement_time: FloatArray = field(default_factory=lambda: np.zeros(0))
    displacements: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def is_driven(self) -> bool:
        """Whether tensions are not known but by the lengths that winches reeled in."""
        return not len(self.tensions)

    @property
    def held(self) -> tuple[FloatArray, FloatArray]:
        """Stamps (n,) [s] and values (n, tendons) of what is held in steps.

        Tensions [N], or, where there are none, lengths reeled in [m], NaN of those not read then.
        """
        if not self.is_driven:
            return self.tension_time, self.tensions
        return self.displacement_time, self.displacements

    @property
    def is_tips(self) -> bool:
        """Whether tips were measured and no midlines."""
        return self.marker_s is None and all(len(points) == 1 for points in self.frames)


class Stamped(NamedTuple):
    """Sets of tensions or of encoder readings, and their stamps.

    Attributes:
        source: topic or file.
        stamps: [ns].
        rows: of each tendon (tendons,) [N] or [m].
    """

    source: str
    stamps: list[int]
    rows: list[FloatArray]


def assemble(
    parameters: dict[str, Any],
    tensions: Stamped | None,
    encoders: Stamped | None,
    frames: Sequence[Frame],
    source: str,
    measured: Measured,
    points: MeasuredPoints,
    refusals: Refusals,
    notes: list[str],
) -> Recording:
    """A recording of ``tensions``, ``encoders``, one of which there is, and ``frames``.

    Frames come from ``source``.

    Raises:
        MeasurementError: if there are no frames, or they are not of this arm.
    """
    if not frames:
        raise MeasurementError(f'nothing measured on {source}{refusals.in_short}')
    if measured.marker_s or all(len(frame.points) == 1 for frame in frames):
        points.check_together(frames)
    origin = min(min(one.stamps) for one in (tensions, encoders) if one is not None)
    tension_time, table = _table(tensions, origin, notes)
    displacement_time, displacements = _table(encoders, origin, notes)
    stamps = [frame.stamp_ns for frame in frames]
    frame_time, order = _in_order(stamps, origin, source, notes)
    return Recording(
        parameters, tension_time, table, frame_time, tuple(frames[i].points for i in order),
        points.frame_id or '', tuple(notes), points.marker_s, refusals, displacement_time,
        displacements,
    )  # fmt: skip


def _table(
    stamped: Stamped | None, origin: int, notes: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Stamps from ``origin`` on (n,) [s], and rows in their order (n, tendons)."""
    if stamped is None:
        return np.zeros(0), np.zeros((0, 0))
    time, order = _in_order(stamped.stamps, origin, stamped.source, notes)
    return time, np.array(stamped.rows)[order]


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
