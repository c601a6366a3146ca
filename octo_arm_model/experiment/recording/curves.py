"""Curves given by points, measured or modelled: lengths, places along them, distances."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from octo_arm_model.core.hints import FloatArray, IntArray

_REPEATED = 1e-9  # of the length: points nearer together are one


def lengths_along(points: FloatArray) -> FloatArray:
    """Length along ``points`` (..., n, 3) up to each of them [m], (..., n)."""
    pieces = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*pieces.shape[:-1], 1)), np.cumsum(pieces, -1)], axis=-1)


def without_spikes(points: FloatArray) -> FloatArray:
    """The ``points`` (n, 3), each coordinate the median of three neighbours; the ends stay."""
    smooth = points.copy()
    if len(points) > 2:
        smooth[1:-1] = np.median(np.stack([points[:-2], points[1:-1], points[2:]]), axis=0)
    return smooth


def resample(points: FloatArray, fraction: FloatArray) -> FloatArray:
    """Points at each ``fraction`` (m,) of the length along ``points`` (n, 3), (m, 3).

    A single wrong point would lengthen the way to all that follow, so lengths are measured
    without spikes. Between few points straight lines would cut the bends; Akima's curve does not,
    and a wrong point bends it only where it is.
    """
    length = lengths_along(without_spikes(points))
    # Points that repeat are no place to interpolate between.
    new = np.append(True, np.diff(length) > _REPEATED * length[-1])
    at = fraction * length[-1]
    if new.sum() < 3:
        return np.stack([np.interp(at, length, column) for column in points.T], axis=-1)
    curve = Akima1DInterpolator(length[new], points[new])
    return np.asarray(curve(np.minimum(at, length[new][-1])), dtype=np.float64)


def _places(curve: FloatArray, fraction: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Piece each ``fraction`` lies on, how far along it [-], and the lengths up to its start."""
    length = lengths_along(curve)
    at = fraction * length[-1]
    piece = np.clip(np.searchsorted(length, at, side='right') - 1, 0, len(curve) - 2)
    return piece, (at - length[piece]) / (length[piece + 1] - length[piece]), length


def along(curve: FloatArray, fraction: FloatArray) -> FloatArray:
    """Points at each ``fraction`` (m,) of the length of ``curve`` (n, 3), (m, 3).

    Below 0 and above 1 they lie straight on.
    """
    piece, part, _ = _places(curve, fraction)
    return curve[piece] + part[:, np.newaxis] * (curve[piece + 1] - curve[piece])


def along_change(
    curve: FloatArray, change: FloatArray, fraction: FloatArray, by_fraction: FloatArray
) -> FloatArray:
    """Derivative of `along`, (m, 3, p).

    For derivatives ``change`` (n, 3, p) of the points and ``by_fraction`` (m, p) of the
    fractions. As pieces of the curve grow and shrink, what is at a fraction slides along it.
    """
    piece, part, length = _places(curve, fraction)
    chord, by_chord = np.diff(curve, axis=0), np.diff(change, axis=0)
    pieces, growth = _growth(chord, by_chord)
    grown = np.concatenate([np.zeros((1, growth.shape[1])), np.cumsum(growth, axis=0)])
    passed = grown[piece] + part[:, np.newaxis] * growth[piece]
    slide = fraction[:, np.newaxis] * grown[-1] + length[-1] * by_fraction - passed
    slide /= pieces[piece][:, np.newaxis]
    moved = change[piece] + part[:, np.newaxis, np.newaxis] * by_chord[piece]
    return moved + chord[piece][:, :, np.newaxis] * slide[:, np.newaxis, :]


def place_change(
    curve: FloatArray, change: FloatArray, fraction: float, point: FloatArray, by_point: FloatArray
) -> FloatArray:
    """Derivative (p,) of the ``fraction`` of the length at which ``curve`` is nearest to a point.

    For derivatives ``change`` (n, 3, p) of the curve and ``by_point`` (3, p) of ``point`` (3,).
    """
    (piece,), (part,), length = _places(curve, np.array([fraction]))
    chord, by_chord = np.diff(curve, axis=0), np.diff(change, axis=0)
    pieces, growth = _growth(chord, by_chord)
    away, by_away = point - curve[piece], by_point - change[piece]
    along_chord = away @ by_chord[piece] + chord[piece] @ by_away
    by_part = along_chord / pieces[piece] ** 2 - 2.0 * part * growth[piece] / pieces[piece]
    passed = growth[:piece].sum(axis=0) + part * growth[piece] + pieces[piece] * by_part
    return np.asarray((passed - fraction * growth.sum(axis=0)) / length[-1])


def _growth(chord: FloatArray, by_chord: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lengths of pieces (n,) and their derivatives (n, p)."""
    pieces = np.linalg.norm(chord, axis=-1)
    return pieces, np.einsum('ni,nip->np', chord / pieces[:, np.newaxis], by_chord)


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
    piece = away.argmin(axis=1)
    row = np.arange(len(points))
    length = lengths_along(curve)
    at = length[piece] + part[row, piece] * np.diff(length)[piece]
    return away[row, piece], at / length[-1]
