"""One shape for each steady step: its tensions and the mean midline of its frames.

Errors of the model and of a tension are shared by all frames of a step, those of the camera are
not. So frames are averaged and fits count steps: more frames make a step's midline more accurate,
but they are no independent observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.shapes.curves import resample
from octo_arm_model.experiment.shapes.steady_windows import Window

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
    away = _distance(stack, median)
    kept = np.ones(len(stack), dtype=bool)
    middle = median
    if len(stack) >= FEW:
        kept = away <= OUTLYING * np.median(away) + FLOOR
        middle = stack[kept].mean(axis=0)
    if not is_tip:
        # Spaced anew: noise lengthens frames, most where points are dense, the mean hardly.
        fine = resample(middle, np.linspace(0.0, 1.0, _FINE))
        middle = resample(fine, fraction)
    noise = float(np.sqrt((_distance(stack[kept], middle) ** 2).mean()))
    left_out = int((~kept).sum())
    return MeasuredShape(window, middle, len(stack) - left_out, left_out, noise, tuple(lines))


def _distance(stack: FloatArray, middle: FloatArray) -> FloatArray:
    """Root mean square distance of each midline of a stack (frames, n, 3) from one."""
    return np.sqrt(((stack - middle) ** 2).sum(axis=-1).mean(axis=-1))
