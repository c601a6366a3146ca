"""Offset of the camera's clock, from the motion of the tip and the tensions.

Where tendons rub, the tip comes late as well: after each reversal of a tension it stays behind.
But friction keeps it behind at rest too, where an offset of the clock does nothing. So the tip is
compared with the model's under the tensions and under what friction would make of them, both at
once: what friction explains no offset is needed for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.rod.interpolation import interpolated
from octo_arm_model.rod.solver import Solver

RANGE = 2.0  # [s] searched either way
_STEP = 0.01  # [s]
_STATIONS = 31
# Tensions solved, and frames used, at most.
_SAMPLES = 5000
# Residual of the best offset over the median of all: above this no offset is clear.
_CLEAR = 0.5
# Part of the tension that friction takes: well above the noise of load cells. What other friction
# does differs from this mostly in size, which is fitted.
_PLAY = 0.1
_STIFFER = 0.7  # part of the tensions, under which the arm is as under all if it were stiffer
_KEPT = 0.9  # fraction of the frames: the worst may be outliers
_FRAMES = 30  # at least: three for each of the ten numbers that fit a coordinate of the tips


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
    ``tensions`` (n, tendons) at ``tension_time`` (n,), under a part of these and under these
    `rubbed`, is fitted to the tips; the offset of least residual is taken, or the one nearest to
    zero of those that do as well. The affine function absorbs the pose of the camera, a wrong
    modulus, most of the model's error and the size of the friction. A lag of the arm in time
    counts as an offset of the clock. ``progress`` is called with the numbers of offsets tried and
    of all.

    Returns:
        The offset; None where no minimum is clear, as for an arm at rest, or frames are so few
        that the function passes near them at any offset.
    """
    if len(tips) < _FRAMES:
        return None
    some = np.linspace(0, len(tensions) - 1, min(len(tensions), _SAMPLES)).astype(int)
    plain = dataclasses.replace(arm, friction=(), sheath_stiffness=())
    stations = max(_STATIONS, len(arm.sections) + 2)
    solver = Solver(plain, 'closed_form', stations, Pose(), compiled=None)
    try:
        tips_of = [
            solver.solve(pulled[some].reshape(-1, *arm.tension_shape)).tip
            for pulled in (tensions, _STIFFER * tensions, rubbed(tensions))
        ]
    except SolveError:
        return None
    expected = np.concatenate(tips_of, axis=1)
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
    # Where frames show the arm at rest alone a range of offsets does equally well: as far as noise
    # tells, by which the mean square of n frames scatters by some 1/n.
    equal = np.flatnonzero(left <= (1.0 + 1.0 / len(times)) * left[best] + 1e-12 * left.max())
    return round(float(offsets[equal[np.abs(offsets[equal]).argmin()]]), 3)


def rubbed(tensions: FloatArray) -> FloatArray:
    """The ``tensions`` (n, tendons) [N] left where friction takes the part `_PLAY` of them.

    The play operator: the tension that arrives stays while it is within this part of that given,
    and is drawn along at its edge.
    """
    arrives = np.empty_like(tensions)
    last = np.zeros(tensions.shape[1])
    lows, highs = (1.0 - _PLAY) * tensions, (1.0 + _PLAY) * tensions
    for row, low, high in zip(arrives, lows, highs):
        last = np.minimum(np.maximum(last, low), high)
        row[:] = last
    return arrives


def _residual(
    times: FloatArray, tips: FloatArray, tension_time: FloatArray, expected: FloatArray
) -> float:
    """Mean squared residual of ``tips`` at ``times``, without the worst frames [m^2]."""
    at = interpolated(times, tension_time, expected)
    regressors = np.column_stack([np.ones(len(times)), at])
    found = np.linalg.lstsq(regressors, tips, rcond=1e-9)[0]
    squares = np.sort(((tips - regressors @ found) ** 2).sum(axis=1))
    return float(squares[: max(1, int(_KEPT * len(squares)))].mean())
