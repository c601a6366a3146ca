"""Markers: points at known arc coordinates, compared as points and never as a curve through them.

A marker that a frame does not show is NaN there. Each is the mean of the frames that show it, and
in a step where none does it is left out.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.shapes.mean_midlines import FEW, FLOOR, OUTLYING, MeasuredShape
from octo_arm_model.experiment.shapes.steady_windows import Window

_TIP = 1e-3  # of the length: a marker so near to the tip is there


def is_at_tip(s: FloatArray, length: float) -> bool:
    """Whether the last of markers at ``s`` is at the tip."""
    return bool(s[-1] >= (1.0 - _TIP) * length)


def mean_markers(
    window: Window, frames: Sequence[FloatArray], s: FloatArray
) -> MeasuredShape | None:
    """Mean of ``frames`` (markers, 3) of markers at ``s``; None where none is seen.

    A marker farther from its median place than three times its median distance from it, and three
    times that of all markers, is an outlier of its frame, and left out there.
    """
    stack = np.array(frames)
    with warnings.catch_warnings():
        # Of markers that no frame shows the mean is NaN.
        warnings.simplefilter('ignore', RuntimeWarning)
        median = np.nanmedian(stack, axis=0)
        away = np.linalg.norm(stack - median, axis=-1)
        seen = np.isfinite(away)
        if not seen.any():
            return None
        # The tip moves more than the base; a base that does not move at all has rounding alone.
        usual = np.maximum(np.nanmedian(away, axis=0), np.median(away[seen]))
        outlying = seen & (away > OUTLYING * usual + FLOOR)
        enough = seen.sum(axis=0) >= FEW
        outlying &= enough
        middle = median.copy()
        kept = np.where((seen & ~outlying)[..., np.newaxis], stack, np.nan)
        middle[enough] = np.nanmean(kept[:, enough], axis=0)
        noise = float(np.sqrt(np.nanmean(((kept - middle) ** 2).sum(axis=-1))))
    shown = seen.any(axis=0)
    return MeasuredShape(
        window, middle[shown], int(seen.any(axis=1).sum()), int(outlying.any(axis=1).sum()),
        noise, tuple(frame[np.isfinite(frame).all(axis=1)] for frame in frames), s[shown],
    )  # fmt: skip
