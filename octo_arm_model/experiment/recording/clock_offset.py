"""Offset of the camera's clock, from the motion of the tip and the tensions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.kinematics import Pose
from octo_arm_model.core.solver import Solver

RANGE = 2.0  # [s] searched either way
_STEP = 0.01  # [s]
_STATIONS = 31
# Tensions solved, and frames used, at most.
_SAMPLES = 5000
# Residual of the best offset over the median of all: above this no offset is clear.
_CLEAR = 0.5
_EQUAL = 0.01  # residuals that differ by less than this part count as equal
_KEPT = 0.9  # fraction of the frames: the worst may be outliers


def clock_offset(
    arm: Arm,
    tension_time: FloatArray,
    tensions: FloatArray,
    frame_time: FloatArray,
    tips: FloatArray,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> float | None:
    """Seconds to add to ``frame_time`` (f,) so that ``tips`` (f, 3) agree with the tensions.

    For each offset up to `RANGE` an affine function of the tips of the model closed_form, under
    ``tensions`` (n, tendons) at ``tension_time`` (n,), is fitted to the tips; the offset of least
    residual is taken, or the one nearest to zero of those that do as well. The affine function
    absorbs the pose of the camera and most of the model's error. The lag of the arm behind its
    tensions counts as an offset of the clock. ``progress`` is called with the numbers of
    offsets tried and of all.

    Returns:
        The offset; None where no minimum is clear, as for an arm at rest.
    """
    some = np.linspace(0, len(tensions) - 1, min(len(tensions), _SAMPLES)).astype(int)
    solver = Solver(arm, 'closed_form', max(_STATIONS, len(arm.sections) + 2), Pose())
    try:
        expected = solver.solve(tensions[some].reshape(-1, *arm.tension_shape)).tip
    except SolveError:
        return None
    seen = np.linspace(0, len(tips) - 1, min(len(tips), _SAMPLES)).astype(int)
    times, tips = frame_time[seen], tips[seen]
    offsets = np.arange(-RANGE, RANGE + 0.5 * _STEP, _STEP)
    left = np.empty(len(offsets))
    for number, offset in enumerate(offsets):
        left[number] = _residual(times + offset, tips, tension_time[some], expected)
        progress(number + 1, len(offsets))
    best = int(left.argmin())
    if best in (0, len(left) - 1) or left[best] >= _CLEAR * np.median(left):
        return None
    # Where frames show the arm at rest alone a range of offsets does equally well.
    equal = np.flatnonzero(left <= (1.0 + _EQUAL) * left[best])
    return round(float(offsets[equal[np.abs(offsets[equal]).argmin()]]), 3)


def _residual(
    times: FloatArray, tips: FloatArray, tension_time: FloatArray, expected: FloatArray
) -> float:
    """Mean squared residual of ``tips`` at ``times``, without the worst frames [m^2]."""
    columns = [np.ones(len(times))]
    columns += [np.interp(times, tension_time, column) for column in expected.T]
    regressors = np.stack(columns, axis=1)
    found = np.linalg.lstsq(regressors, tips, rcond=1e-9)[0]
    squares = np.sort(((tips - regressors @ found) ** 2).sum(axis=1))
    return float(squares[: max(1, int(_KEPT * len(squares)))].mean())
