"""Measured midlines: the end at the base, and distances to the model.

A tip alone is a midline of one point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.shapes.curves import along, lengths_along, nearest

# The spread of the tip over that of the base is at least this.
_MOVES = 3.0
# Fraction of the frames within the spread of an end: the others may be outliers.
_COUNTED = 0.8
# Where a midline may begin, in parts of the length of the arm.
_STARTS = (-0.1, 0.25)


class MidlineErrors(NamedTuple):
    """Distances between a measured and a modelled midline, or between markers and the model.

    Distances are from each measured point to the nearest of the model's curve; Hausdorff's also
    the other way, from the beginning of the midline on. A tip alone has only ``tip``. Of markers
    distances are those to the points of the model at their arc coordinates; Hausdorff's is None,
    and that of the tip is None where no marker is there.

    Attributes:
        tip: from tip to tip [m].
        mean: mean distance [m].
        max: largest distance [m].
        hausdorff: largest distance either way [m].
    """

    tip: float | None
    mean: float | None
    max: float | None
    hausdorff: float | None


def midline_errors(measured: FloatArray, model: FloatArray) -> MidlineErrors:
    """Errors of ``model`` (n, 3) against ``measured`` (m, 3), both from base to tip."""
    tip = float(np.linalg.norm(measured[-1] - model[-1]))
    if len(measured) == 1:
        return MidlineErrors(tip, None, None, None)
    distance, _ = nearest(measured, model)
    start = max(fraction_at_start(measured, model), 0.0)
    length = lengths_along(model)
    beyond = model[length > start * length[-1]]
    begun = np.concatenate([along(model, np.array([start])), beyond])
    back, _ = nearest(begun, measured)
    largest = float(distance.max())
    return MidlineErrors(tip, float(distance.mean()), largest, max(largest, float(back.max())))


def marker_errors(away: FloatArray, has_tip: bool) -> MidlineErrors:
    """Errors of markers ``away`` (m, 3) from the model, the last of them the tip or not."""
    distance = np.linalg.norm(away, axis=1)
    tip = float(distance[-1]) if has_tip else None
    return MidlineErrors(tip, float(distance.mean()), float(distance.max()), None)


def fraction_at_start(measured: FloatArray, model: FloatArray, check: bool = False) -> float:
    """Fraction of the length of ``model`` at which the midline ``measured`` begins [-].

    Negative on the extension of the model before its base: a bound at 0 would turn the noise of
    the first point into a bias.

    Raises:
        MeasurementError: if it is to ``check`` and not near the base.
    """
    if len(measured) == 1:
        return 0.0
    # Only the proximal part: a coiled arm may come near its base again.
    low, high = _STARTS
    length = lengths_along(model)
    near = model[(length > 0.0) & (length < high * length[-1])]
    ends = along(model, np.array(_STARTS))
    part = float(nearest(measured[:1], np.concatenate([ends[:1], near, ends[1:]]))[1][0])
    if check and not 1e-9 < part < 1.0 - 1e-9:
        raise MeasurementError(
            f'a midline begins outside {low:.0%} to {high:.0%} of the arm, expected near the '
            'base; is the alignment right?'
        )
    return low + (high - low) * part


def is_tip_first(midlines: Sequence[FloatArray], base: FloatArray | None) -> tuple[bool, str]:
    """Whether ``midlines`` begin at the tip, and the reason.

    The end that moves less while the tensions change is the base. Where the difference is small,
    it is the end nearer to ``base``, if that is known in the frame of the midlines.

    Raises:
        MeasurementError: if neither is clear.
    """
    ends = [np.array([points[end] for points in midlines]) for end in (0, -1)]
    spread = [_spread(end) for end in ends]
    first, last = (f'{1e3 * one:.1f} mm' for one in spread)
    moved = f'the first points spread by {first}, the last by {last}'
    if max(spread) > _MOVES * min(spread):
        return spread[0] > spread[1], moved
    if base is not None:
        away = [float(np.linalg.norm(np.median(end, axis=0) - base)) for end in ends]
        if max(away) > _MOVES * min(away):
            first, last = (f'{1e3 * one:.1f} mm' for one in away)
            why = f'the first points are {first} from the base, the last {last}'
            return away[0] > away[1], why
    raise MeasurementError(
        f'which end of the midlines is the base cannot be told: {moved}; '
        'say --base-end first or last'
    )


def _spread(ends: FloatArray) -> float:
    away = np.linalg.norm(ends - np.median(ends, axis=0), axis=1)
    return float(np.quantile(away, _COUNTED))
