"""Midlines as sequences of points: lengths, interpolation, and distances to the model.

A segment is the straight line between two neighbouring points. A tip alone is a midline of one
point.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.ndimage import median_filter

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.stations import interpolated

_REPEATED = 1e-9  # distance over the length below which points count as one
# Smallest ratio of the spread of the tip to that of the base.
_MOVES = 3.0
# Fraction of the frames within the spread of an end: the others may be outliers.
_COUNTED = 0.8
# Range of the start of a midline, in parts of the length of the arm.
_STARTS = (-0.1, 0.25)


def lengths_along(points: FloatArray) -> FloatArray:
    """Return the length along ``points`` (..., n, 3) up to each of them [m], (..., n)."""
    lengths = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*lengths.shape[:-1], 1)), np.cumsum(lengths, -1)], axis=-1)


def without_spikes(points: FloatArray) -> FloatArray:
    """Return ``points`` (n, columns) after a median filter of width 3, which keeps the ends."""
    return np.asarray(median_filter(points, (3, 1), mode='nearest'))


def resample(points: FloatArray, fraction: FloatArray) -> FloatArray:
    """Return the points (m, 3) at each ``fraction`` (m,) of the length along ``points`` (n, 3).

    Lengths are those without spikes, because an outlier would increase the length up to all later
    points. Akima's interpolation follows bends between few points, and an outlier changes it only
    nearby.
    """
    length = lengths_along(without_spikes(points))
    # The nodes of an interpolation must differ.
    new = np.append(True, np.diff(length) > _REPEATED * length[-1])
    at = fraction * length[-1]
    if new.sum() < 3:
        return interpolated(at, length, points)
    curve = Akima1DInterpolator(length[new], points[new])
    return np.asarray(curve(np.minimum(at, length[new][-1])), dtype=np.float64)


class Curve:
    """A curve from base to tip, straight between its points.

    Attributes:
        points: the points (n, 3) [m].
        lengths: length of the curve up to each point [m], (n,).
    """

    def __init__(self, points: FloatArray) -> None:
        """Create the curve through ``points`` (n, 3) [m]."""
        self.points, self.lengths = points, lengths_along(points)
        self._chords = np.diff(points, axis=0)
        self._squares = np.maximum((self._chords**2).sum(axis=1), np.finfo(float).tiny)

    def along(self, fraction: FloatArray) -> FloatArray:
        """Return the points (m, 3) at each ``fraction`` (m,) of the length.

        For fractions below 0 and above 1 the first and last segments are extended.
        """
        at = fraction * self.lengths[-1]
        segment = np.searchsorted(self.lengths[1:-1], at, side='right')
        part = (at - self.lengths[segment]) / (self.lengths[segment + 1] - self.lengths[segment])
        return self.points[segment] + part[:, np.newaxis] * self._chords[segment]

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Find the point of the curve that is nearest to each of ``points`` (m, 3).

        Returns:
            Distance [m] and fraction of the length of the curve [-], each (m,).
        """
        to_point = points[:, np.newaxis] - self.points[:-1]
        fraction = np.clip((to_point * self._chords).sum(axis=-1) / self._squares, 0.0, 1.0)
        distance = np.linalg.norm(to_point - fraction[..., np.newaxis] * self._chords, axis=-1)
        row, segment = np.arange(len(points)), distance.argmin(axis=1)
        at = self.lengths[segment] + fraction[row, segment] * np.diff(self.lengths)[segment]
        return distance[row, segment], at / self.lengths[-1]

    def fraction_at(self, start: FloatArray, check: bool = False) -> float:
        """Return the fraction of the length where a midline with this first point (3,) begins.

        It may be negative, in front of the base: a bound at 0 would turn the noise of the first
        point into a bias.

        Raises:
            MeasurementError: if ``check`` is set and the midline does not begin near the base.
        """
        low, high = _STARTS
        # Only the start of the arm is searched, because a coiled arm may come near its base again.
        ends = self.along(np.array(_STARTS))
        near = (self.lengths > 0.0) & (self.lengths < high * self.lengths[-1])
        beginning = Curve(np.concatenate([ends[:1], self.points[near], ends[1:]]))
        fraction = float(beginning.nearest(start[np.newaxis])[1][0])
        if check and not 1e-9 < fraction < 1.0 - 1e-9:
            raise MeasurementError(
                f'a midline begins outside {low:.0%} to {high:.0%} of the arm, expected near the '
                'base; is the alignment right?'
            )
        return low + (high - low) * fraction

    def fractions(self, midline: FloatArray, check: bool = False) -> FloatArray:
        """Return the fractions of the length paired with the points of a ``midline`` (m, 3), (m,).

        Raises:
            MeasurementError: if ``check`` is set and the midline does not begin near the base.
        """
        if len(midline) == 1:
            return np.ones(1)
        return np.linspace(self.fraction_at(midline[0], check), 1.0, len(midline))


class MidlineErrors(NamedTuple):
    """Distances between a measured and a modelled midline, or between markers and the model.

    Distances are from each measured point to the nearest point of the model's curve; Hausdorff's
    also the other way, from the start of the midline on. A tip alone has only ``tip``. Distances
    of markers are those to the points of the model at their arc coordinates; there is no Hausdorff
    distance, and a tip only if a marker is there. What is not measured is NaN.
    """

    tip: float  #: from tip to tip [m]
    mean: float = np.nan  #: mean distance [m]
    max: float = np.nan  #: largest distance [m]
    hausdorff: float = np.nan  #: largest distance either way [m]


def midline_errors(measured: FloatArray, model: Curve) -> MidlineErrors:
    """Return the errors of ``model`` against ``measured`` (m, 3), both from base to tip."""
    tip = float(np.linalg.norm(measured[-1] - model.points[-1]))
    if len(measured) == 1:
        return MidlineErrors(tip)
    distance, _ = model.nearest(measured)
    start = max(model.fraction_at(measured[0]), 0.0)
    beyond = model.points[model.lengths > start * model.lengths[-1]]
    back, _ = Curve(measured).nearest(np.concatenate([model.along(np.array([start])), beyond]))
    largest = float(distance.max())
    return MidlineErrors(tip, float(distance.mean()), largest, max(largest, float(back.max())))


def is_tip_first(midlines: Sequence[FloatArray], base: FloatArray | None) -> tuple[bool, str]:
    """Whether ``midlines`` begin at the tip, and the reason.

    The end that moves less while the tensions change is the base. If the difference is small, it
    is the end nearer to ``base`` (3,) [m], if that is known in the frame of the midlines.

    Raises:
        MeasurementError: if neither criterion is clear.
    """
    ends = [np.array([points[end] for points in midlines]) for end in (0, -1)]
    criteria = [
        ([*map(_spread, ends)], 'the first points spread by {:.1f} mm, the last by {:.1f}')
    ]
    if base is not None:
        away = [float(np.linalg.norm(np.median(end, axis=0) - base)) for end in ends]
        criteria.append((away, 'the first points are {:.1f} mm from the base, the last {:.1f}'))
    reasons = [words.format(*(1e3 * np.array(sizes))) + ' mm' for sizes, words in criteria]
    for (sizes, _), reason in zip(criteria, reasons):
        if max(sizes) > _MOVES * min(sizes):
            return sizes[0] > sizes[1], reason
    raise MeasurementError(
        f'which end of the midlines is the base cannot be told: {reasons[0]}; '
        'say --base-end first or last'
    )


def _spread(ends: FloatArray) -> float:
    away = np.linalg.norm(ends - np.median(ends, axis=0), axis=1)
    return float(np.quantile(away, _COUNTED))
