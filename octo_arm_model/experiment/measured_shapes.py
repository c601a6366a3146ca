"""One shape for each steady step: its tensions and the mean midline or markers of its frames.

Errors of the model and of a tension are shared by all frames of a step, those of the camera are
not. So frames are averaged and fits count steps: more frames make a step's midline more accurate,
but they are no independent observations. Markers are compared as points, never as a curve through
them; one that a frame does not show is NaN there.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.midlines import resample
from octo_arm_model.experiment.steady_windows import Window

POINTS = 101  # of a step's midline
_FINE = 401  # points by which its length is measured
# A frame so many times as far from the median shape as the median frame is an outlier.
OUTLYING = 3.0
FLOOR = 1e-6  # [m]: rounding is no outlier
# With fewer frames outliers cannot be identified: their median is taken.
FEW = 5


@dataclass(frozen=True)
class MeasuredShape:
    """Measured shape of one steady step.

    Attributes:
        window: when, and its tensions.
        points: mean midline from base to tip in the camera's frame, evenly along its length
            (`POINTS`, 3), or the tip (1, 3) [m].
        frames: how many frames it is the mean of.
        outliers: number of frames left out.
        noise: root mean square distance of a frame from the mean [m]; 0 for one frame.
        lines: the midlines of all frames, outliers among them.
        s: arc coordinate of each of ``points`` where these are markers [m]; None of a midline.
    """

    window: Window
    points: FloatArray
    frames: int
    outliers: int
    noise: float
    lines: tuple[FloatArray, ...] = ()
    s: FloatArray | None = None

    @property
    def tension(self) -> float:
        """Sum of all tensions [N]."""
        return float(self.window.tensions.sum())


def mean_shape(window: Window, lines: Sequence[FloatArray]) -> MeasuredShape:
    """Mean of ``lines`` (n, 3), from base to tip; those of one point are tips."""
    is_tip = len(lines[0]) == 1
    fraction = np.linspace(0.0, 1.0, POINTS)
    stack = np.array([line if is_tip else resample(line, fraction) for line in lines])
    median = np.median(stack, axis=0)
    away = _frame_distances(stack, median)
    kept = np.ones(len(stack), dtype=bool)
    middle = median
    if len(stack) >= FEW:
        kept = away <= OUTLYING * np.median(away) + FLOOR
        middle = stack[kept].mean(axis=0)
    if not is_tip:
        # Spaced anew: noise lengthens frames, most where points are dense, the mean hardly.
        fine = resample(middle, np.linspace(0.0, 1.0, _FINE))
        middle = resample(fine, fraction)
    noise = float(np.sqrt((_frame_distances(stack[kept], middle) ** 2).mean()))
    left_out = int((~kept).sum())
    return MeasuredShape(window, middle, len(stack) - left_out, left_out, noise, tuple(lines))


def _frame_distances(stack: FloatArray, middle: FloatArray) -> FloatArray:
    """Root mean square distance of each midline of a stack (frames, n, 3) from one."""
    return np.sqrt(((stack - middle) ** 2).sum(axis=-1).mean(axis=-1))


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
