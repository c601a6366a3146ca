"""Curves given by points: lengths, points at fractions of the length, distances.

A segment is the straight line between two neighbouring points.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.ndimage import median_filter

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.interpolation import interpolated

_REPEATED = 1e-9  # of the length: points nearer together are one


def lengths_along(points: FloatArray) -> FloatArray:
    """Length along ``points`` (..., n, 3) up to each of them [m], (..., n)."""
    lengths = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*lengths.shape[:-1], 1)), np.cumsum(lengths, -1)], axis=-1)


def without_spikes(points: FloatArray) -> FloatArray:
    """The ``points`` (n, columns), each number the median of three neighbours; the ends stay."""
    return np.asarray(median_filter(points, (3, 1), mode='nearest'))


def resample(points: FloatArray, fraction: FloatArray) -> FloatArray:
    """Points at each ``fraction`` (m,) of the length along ``points`` (n, 3), (m, 3).

    An outlier would lengthen the curve up to all points after it, so lengths are those without
    spikes. Akima's interpolation follows bends between few points, and an outlier changes it only
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


def _places(curve: FloatArray, fraction: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Segment each ``fraction`` lies on, how far along it [-], and the lengths up to its start."""
    length = lengths_along(curve)
    at = fraction * length[-1]
    segment = np.clip(np.searchsorted(length, at, side='right') - 1, 0, len(curve) - 2)
    return segment, (at - length[segment]) / (length[segment + 1] - length[segment]), length


def along(curve: FloatArray, fraction: FloatArray) -> FloatArray:
    """Points at each ``fraction`` (m,) of the length of ``curve`` (n, 3), (m, 3).

    Below 0 and above 1 the first and last segments are extended.
    """
    segment, part, _ = _places(curve, fraction)
    return curve[segment] + part[:, np.newaxis] * (curve[segment + 1] - curve[segment])


def along_change(
    curve: FloatArray, change: FloatArray, fraction: FloatArray, by_fraction: FloatArray
) -> FloatArray:
    """Derivative of `along`, (m, 3, p).

    For derivatives ``change`` (n, 3, p) of the points and ``by_fraction`` (m, p) of the
    fractions. As segments change in length, a point of constant fraction moves along the curve.
    """
    segment, part, length = _places(curve, fraction)
    chord, by_chord = np.diff(curve, axis=0), np.diff(change, axis=0)
    lengths, growth = _growth(chord, by_chord)
    grown = np.concatenate([np.zeros((1, growth.shape[1])), np.cumsum(growth, axis=0)])
    passed = grown[segment] + part[:, np.newaxis] * growth[segment]
    slide = fraction[:, np.newaxis] * grown[-1] + length[-1] * by_fraction - passed
    slide /= lengths[segment][:, np.newaxis]
    moved = change[segment] + part[:, np.newaxis, np.newaxis] * by_chord[segment]
    return moved + chord[segment][:, :, np.newaxis] * slide[:, np.newaxis, :]


def place_change(
    curve: FloatArray, change: FloatArray, fraction: float, point: FloatArray, by_point: FloatArray
) -> FloatArray:
    """Derivative (p,) of the ``fraction`` of the length at which ``curve`` is nearest to a point.

    For derivatives ``change`` (n, 3, p) of the curve and ``by_point`` (3, p) of ``point`` (3,).
    """
    (segment,), (part,), length = _places(curve, np.array([fraction]))
    chord, by_chord = np.diff(curve, axis=0), np.diff(change, axis=0)
    lengths, growth = _growth(chord, by_chord)
    away, by_away = point - curve[segment], by_point - change[segment]
    along_chord = away @ by_chord[segment] + chord[segment] @ by_away
    by_part = along_chord / lengths[segment] ** 2 - 2.0 * part * growth[segment] / lengths[segment]
    passed = growth[:segment].sum(axis=0) + part * growth[segment] + lengths[segment] * by_part
    return np.asarray((passed - fraction * growth.sum(axis=0)) / length[-1])


def _growth(chord: FloatArray, by_chord: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lengths of segments (n,) and their derivatives (n, p)."""
    lengths = np.linalg.norm(chord, axis=-1)
    return lengths, np.einsum('ni,nip->np', chord / lengths[:, np.newaxis], by_chord)


def nearest(points: FloatArray, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where on ``curve`` (n, 3) each of ``points`` (m, 3) is nearest to.

    Returns:
        Distance [m] and fraction of the length of the curve [-], each (m,).
    """
    start, chord = curve[:-1], np.diff(curve, axis=0)
    squared = np.maximum((chord**2).sum(axis=1), np.finfo(float).tiny)
    to_point = points[:, np.newaxis] - start
    part = np.clip((to_point * chord).sum(axis=-1) / squared, 0.0, 1.0)
    away = np.linalg.norm(to_point - part[..., np.newaxis] * chord, axis=-1)
    segment = away.argmin(axis=1)
    row = np.arange(len(points))
    length = lengths_along(curve)
    at = length[segment] + part[row, segment] * np.diff(length)[segment]
    return away[row, segment], at / length[-1]
