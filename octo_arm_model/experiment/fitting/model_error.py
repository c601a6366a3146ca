"""The error of the model, as loads that were held back from the fit show it.

At each held-back load the residuals have a part that a change of material or tensions at this load
alone would explain, and a rest that none explains. The first differs from load to load and is what
the jackknife sees. The rest, less the noise of the camera, is of the model. An error of the model
of the same size may as well lie along what the parameters change, the same at all loads: that
shifts the estimates, and no measurement at these loads shows it. `floor_of` bounds this shift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape


def noise_of(shapes: Sequence[MeasuredShape]) -> float:
    """Root mean square distance of the mean midlines from the truth by the camera's noise [m]."""
    return float(np.sqrt(np.mean([shape.noise**2 / shape.frames for shape in shapes])))


def unexplained(
    away: Sequence[FloatArray], jacobian: Sequence[FloatArray], columns: Sequence[int]
) -> float:
    """Root mean square distance [m] that no change at single steps explains.

    Of the residuals ``away`` of each step (m, 3) [m] and their derivatives (m, 3, n), of which the
    ``columns`` may change from step to step.
    """
    squares = []
    for residuals, derivatives in zip(away, jacobian, strict=True):
        flat, by = residuals.ravel(), derivatives.reshape(residuals.size, -1)[:, columns]
        rest = flat - by @ np.linalg.lstsq(by, flat, rcond=None)[0] if len(columns) else flat
        squares.append(rest @ rest / len(residuals))
    return float(np.sqrt(np.mean(squares)))


def floor_of(size: float, jacobian: Sequence[FloatArray], points: Sequence[int]) -> FloatArray:
    """Shift of each of x, (n,), by a model error of root mean square ``size`` [m] along it.

    Args:
        size: of the error, at what the camera sees.
        jacobian: derivatives (m, 3, n) of all residuals of each step.
        points: how many of the m are of the camera, the last ones.
    """
    stacked = np.concatenate([part.reshape(-1, part.shape[-1]) for part in jacobian])
    inverse = np.linalg.pinv(stacked)
    seen = np.concatenate([
        np.repeat(np.arange(len(part)) >= len(part) - count, 3)
        for part, count in zip(jacobian, points, strict=True)
    ])  # fmt: skip
    along = np.linalg.norm(inverse[:, seen], axis=1)
    return np.asarray(size * np.sqrt(sum(points)) * along)


def tip_error(away: Sequence[FloatArray], shapes: Sequence[MeasuredShape], length: float) -> float:
    """Standard deviation of each coordinate of the tip, in parts of the ``length`` [-].

    From held-back residuals ``away`` (m, 3) [m] of each step, without the camera's noise.
    """
    squares = np.mean([part[-1] @ part[-1] for part in away]) - noise_of(shapes) ** 2
    return float(np.sqrt(max(squares, 0.0) / 3.0)) / length
