"""A recording of tensions or encoder readings and measured points, and the checks of them.

Points are midlines, tips, or markers at known arc coordinates.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import LARGEST
from octo_arm_model.wire.messages import Refusals

MOST_MARKERS = 1000
MOST_MESSAGES = 1_000_000  # of all topics, because what they hold is kept in memory
LENGTH_UNITS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3}
# Range of the extent of a midline in metres, over the length of the arm.
_LENGTHS = (0.02, 2.0)
_OF_TIPS = 4.0  # largest distance of tips and markers in a recording, over the length of the arm


@dataclass(frozen=True)
class MarkerSources:
    """Sources and unit of measured points, and the markers among them."""

    #: topics, or TOPIC:FIELD; empty for the only such topic. Several topics have one marker each
    #: or, with ``marker_frames``, transforms of TF, by default all of that type.
    sources: tuple[str, ...] = ()
    #: arc coordinate of each marker, increasing [m]; empty for midlines and tips
    marker_s: tuple[float, ...] = ()
    #: names of the frames of the markers in TF, in the order of ``marker_s``
    marker_frames: tuple[str, ...] = ()
    unit: str = 'm'  #: unit of all lengths, of `LENGTH_UNITS`
    #: names of the markers in a message or a table, or their numbers from 0 on in a message, in
    #: the order of ``marker_s``; empty for all markers in their order
    marker_names: tuple[str, ...] = ()
    #: whether the pose of their frame is given or fitted, whatever TF says of it
    is_aligned: bool = False

    def __post_init__(self) -> None:
        """Validate; MeasurementError if the numbers of markers differ."""
        name, names = '--marker-frames', self.marker_frames
        if self.marker_names:
            name, names = '--marker-names', self.marker_names
            if self.marker_frames or len(self.sources) > 1:
                raise MeasurementError(
                    '--marker-names is of one message or table, expected neither --marker-frames '
                    'nor several --midlines with it'
                )
        elif not names and len(self.sources) > 1:
            name, names = '--midlines', self.sources
        if names and len(names) != len(self.marker_s):
            raise MeasurementError(
                f'{name} names {len(names)}, --marker-s has {len(self.marker_s)} values; expected '
                'one for each marker'
            )
        if len(set(names)) < len(names):
            raise MeasurementError(f'{name} names {" ".join(names)}, expected each once')


class MeasuredPoints:
    """Checks measured points of any source.

    Attributes:
        frame_id: frame of the first points; None before.
        marker_s: arc coordinates of the markers [m]; None for midlines and tips.
    """

    def __init__(self, measured: MarkerSources, length: float) -> None:
        """Check points that ``measured`` describes, of an arm of ``length`` [m].

        Raises:
            MeasurementError: if arc coordinates of markers are not increasing, or not on the arm.
        """
        self.frame_id: str | None = None
        self.marker_s = check_marker_s(measured.marker_s, length) if measured.marker_s else None
        self._count, self._length = len(measured.marker_s), length
        self._unit, self._factor = measured.unit, LENGTH_UNITS[measured.unit]

    def check_frame(self, frame_id: str) -> None:
        """Check that ``frame_id`` is that of earlier points; MeasurementError if it is not."""
        if self.frame_id is None:
            self.frame_id = frame_id
        elif frame_id != self.frame_id:
            raise MeasurementError(f'its frame is {frame_id!r}, expected {self.frame_id!r}')

    def check(self, points: FloatArray, is_midline: bool) -> FloatArray:
        """Check ``points`` (m, 3) in the unit of the source, and return them in metres.

        Raises:
            MeasurementError: if they cannot be points of this arm.
        """
        if self._count:
            return self._check_markers(points)
        if is_midline and len(points) < 2:
            raise MeasurementError(f'it has {len(points)} point(s), expected at least 2')
        if (wrong := ~(np.abs(points) <= LARGEST).all(axis=1)).any():
            number = int(np.argmax(wrong))
            raise MeasurementError(
                f'point {number + 1} is {points[number].tolist()}, expected finite numbers of at '
                f'most {LARGEST:g}'
            )
        points = self._factor * points
        if is_midline:
            # Noise hardly changes the diagonal of the bounding box.
            size = float(np.linalg.norm(np.ptp(points, axis=0)))
            low, high = (factor * self._length for factor in _LENGTHS)
            self._check_size(size, low, high, f'it extends over {size:.4g} m')
        return points

    def _check_markers(self, points: FloatArray) -> FloatArray:
        if len(points) != self._count:
            raise MeasurementError(
                f'it has {len(points)} point(s), expected {self._count}, one for each of '
                '--marker-s'
            )
        if (np.abs(points) > LARGEST).any():
            raise MeasurementError(
                f'a point is beyond {LARGEST:g}, expected finite numbers, or NaN if unseen'
            )
        seen = np.asarray(np.isfinite(points).all(axis=1))
        if not seen.any():
            raise MeasurementError('it shows no marker')
        return np.where(seen[:, np.newaxis], self._factor * points, np.nan)

    def check_together(self, frames: Sequence[FloatArray]) -> None:
        """Check the distances of tips or markers in all ``frames``, each (m, 3) [m].

        Raises:
            MeasurementError: if they are too far apart, or too near, for an arm of this length.
        """
        points = np.concatenate(frames)
        size = float(np.linalg.norm(np.nanmax(points, axis=0) - np.nanmin(points, axis=0)))
        low, high = 0.0, _OF_TIPS * self._length
        if self.marker_s is not None:
            low = _LENGTHS[0] * float(np.ptp(self.marker_s))
        self._check_size(size, low, high, f'measured points are up to {size:.4g} m apart')

    def _check_size(self, size: float, low: float, high: float, found: str) -> None:
        if low <= size <= high:
            return
        hint = ''
        for unit, factor in reversed(LENGTH_UNITS.items()):
            if unit != self._unit and low <= size / self._factor * factor <= high:
                hint = f'; are they in {unit}? then say --length-unit {unit}'
        raise MeasurementError(
            f'{found}, expected {low:.3g} to {high:.3g} m for an arm of {self._length:.4g} m{hint}'
        )


def check_marker_s(s: Sequence[float], length: float) -> FloatArray:
    """Check the arc coordinates ``s`` of markers on an arm of ``length`` [m], and return them.

    Raises:
        MeasurementError: if one is not on the arm, they are not increasing, or too many.
    """
    if len(s) > MOST_MARKERS:
        raise MeasurementError(f'--marker-s has {len(s)} values, expected at most {MOST_MARKERS}')
    for before, one in zip([-math.inf, *s], s):
        if not (math.isfinite(one) and 0.0 <= one <= length * (1.0 + 1e-9)):
            hint = ': in metres?' if 0.0 <= 1e-3 * one <= length else ''
            raise MeasurementError(
                f'--marker-s has {one:g}, expected arc coordinates from 0 to {length:g} m{hint}'
            )
        if min(one, length) <= before:
            raise MeasurementError(
                f'--marker-s has {one:g} after {before:g}, expected increasing arc coordinates [m]'
            )
    return np.minimum(np.array(s, dtype=np.float64), length)


class Count:
    """Counts the messages of a bag that are read, and all that are known so far.

    Attributes:
        done: number of messages read.
        total: number of all messages known.
    """

    def __init__(self, report: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Call ``report`` with both numbers as they change."""
        self._report, self.done, self.total = report, 0, 0

    def expect(self, more: int) -> None:
        """Add ``more`` messages to read; MeasurementError if they are too many."""
        self.total += more
        if self.total > MOST_MESSAGES:
            raise MeasurementError(
                f'{self.total} messages to read, expected at most {MOST_MESSAGES}'
            )
        self._report(self.done, self.total)

    def add(self, some: int = 1) -> None:
        """Count ``some`` messages as read."""
        self.done += some
        self._report(self.done, self.total)


@dataclass(frozen=True)
class Recording:
    """Tensions, encoder readings and measured midlines with their stamps, in order of time."""

    parameters: dict[str, Any]  #: parameters of the arm, as for `Config.from_parameters`
    #: stamp of each set of tensions (n,) [s], from the first of those or of the encoder readings
    #: on
    tension_time: FloatArray
    tensions: FloatArray  #: tensions (n, tendons) [N]; empty without load cells
    frame_time: FloatArray  #: stamp of each midline, on the same scale, (f,) [s]
    #: measured midlines, each (m, 3) [m]; tips are (1, 3). Frames of markers have a point for each
    #: of ``marker_s``, NaN for one that is not visible.
    frames: tuple[FloatArray, ...]
    frame_id: str  #: frame of the measured points
    notes: tuple[str, ...] = ()  #: remarks
    #: arc coordinate of each marker [m]; None for midlines and tips
    marker_s: FloatArray | None = None
    #: counts of the messages left out, by topic and reason
    refusals: Refusals = field(default_factory=Refusals)
    #: stamp of each set of encoder readings, on the scale of tensions, (e,) [s]
    displacement_time: FloatArray = field(default_factory=lambda: np.zeros(0))
    #: lengths reeled in by the winches, as their encoders read them, (e, tendons) [m]; NaN for
    #: tendons without
    displacements: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def is_driven(self) -> bool:
        """Whether tensions are only known from the lengths that winches reeled in."""
        return not len(self.tensions)

    @property
    def held(self) -> tuple[FloatArray, FloatArray]:
        """The stamps (n,) [s] and values (n, tendons) of the quantity that changes in steps.

        It is the tension [N] or, without load cells, the length reeled in [m], NaN if not read.
        """
        if not self.is_driven:
            return self.tension_time, self.tensions
        return self.displacement_time, self.displacements

    @property
    def is_tips(self) -> bool:
        """Whether tips were measured instead of midlines."""
        return self.marker_s is None and all(len(points) == 1 for points in self.frames)


@dataclass
class StampedRows:
    """Sets of tensions or of encoder readings, or frames of measured points, and their stamps."""

    source: str  #: topic or file
    stamps: list[int] = field(default_factory=list)  #: stamps [ns]
    #: values by tendon (tendons,) [N] or [m], or points (m, 3) [m], NaN for markers that are not
    #: visible
    rows: list[FloatArray] = field(default_factory=list)
    #: times at which the recorder received them [ns], of readings in a bag
    received: list[int] = field(default_factory=list)

    def add(self, stamp_ns: int, row: FloatArray) -> None:
        """Append a ``row`` with its stamp."""
        self.stamps.append(stamp_ns)
        self.rows.append(row)

    def in_order(self, origin: int, notes: list[str]) -> tuple[FloatArray, list[FloatArray]]:
        """Return ascending stamps from ``origin`` on (n,) [s], and rows; note if they were not."""
        given = np.array(self.stamps, dtype=np.int64)
        if back := int((np.diff(given) < 0).sum()):
            notes.append(
                f'{back} of {given.size} stamps on {self.source} run backwards; they are sorted'
            )
        order = np.argsort(given, kind='stable')
        time: FloatArray = np.asarray(1e-9 * (given[order] - origin))
        return time, [self.rows[place] for place in order]


def assemble(
    parameters: dict[str, Any],
    tensions: StampedRows | None,
    encoders: StampedRows | None,
    frames: StampedRows,
    points: MeasuredPoints,
    refusals: Refusals,
    notes: list[str],
) -> Recording:
    """Return a recording of ``tensions`` or ``encoders``, or both, and ``frames``.

    ``points`` has checked the frames.

    Raises:
        MeasurementError: if there are no frames, or they are not of this arm.
    """
    if not frames.rows:
        raise MeasurementError(f'nothing measured on {frames.source}{refusals.in_short}')
    if points.marker_s is not None or all(len(one) == 1 for one in frames.rows):
        points.check_together(frames.rows)
    read = [one for one in (tensions, encoders) if one is not None]
    origin = min(min(one.stamps) for one in read)
    zeros = sum(bool((~points.any(axis=1)).any()) for points in frames.rows)
    if 0 < zeros < len(frames.rows):
        notes.append(
            f'{zeros} of {len(frames.rows)} frames on {frames.source} have a point at exactly '
            '0, 0, 0: leave its cells empty, or NaN, if it was hidden'
        )
    nothing = np.zeros(0), np.zeros((0, 0))
    tension_time, pulled = nothing if tensions is None else tensions.in_order(origin, notes)
    encoder_time, reeled_in = nothing if encoders is None else encoders.in_order(origin, notes)
    frame_time, seen = frames.in_order(origin, notes)
    return Recording(
        parameters,
        tension_time,
        np.array(pulled),
        frame_time,
        tuple(seen),
        points.frame_id or '',
        tuple(notes),
        points.marker_s,
        refusals,
        encoder_time,
        np.array(reeled_in),
    )
