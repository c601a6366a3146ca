"""Kernels for the tensions that hold tendons at prescribed displacements.

For the model exact, from a solution at displacements nearby, as in `analysis.winding`. Where a few
steps do not suffice, NumPy solves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.compiled.models.arm_tables import GridTables
from octo_arm_model.core.compiled.models.exact_kernels import find_exact_twist
from octo_arm_model.core.compiled.models.frame_kernels import read_out
from octo_arm_model.core.compiled.models.tension_step_kernels import find_step, lacking, take_step
from octo_arm_model.core.compiled.section.length_kernels import find_lengths
from octo_arm_model.core.compiled.section.section_tables import ExactTables
from octo_arm_model.core.hints import FloatArray

MOST_STEPS = 6
PROGRESS = 0.1  # largest admissible ratio of successive errors
TENSIONS_MET = 1e-9  # relative change of converged tensions
MET, ROUNDING = 1e-9, 1e-13  # errors over lengths: converged with such a change, and in any case
LOST, ON_THE_WAY, FOUND = -1, 0, 1  # verdicts of `next_step`


class Winches(NamedTuple):
    """Tendons without compliant sheaths, and their prescribed displacements.

    Attributes:
        path: see `find_lengths`, (tendons, 4, nodes).
        weights: likewise, (tendons, nodes).
        widens: whether the law of the arm is neo_hookean.
        given: prescribed displacements [m], compliances of the tendons [m/N] and unloaded lengths
            [m], (3, tendons).
        driven: whether the displacement of a tendon is prescribed, else its tension, (tendons,).
    """

    path: FloatArray
    weights: FloatArray
    widens: bool
    given: FloatArray
    driven: NDArray[np.bool_]


class Reeled(NamedTuple):
    """A solution nearby, overwritten by the new one.

    Attributes:
        tensions: tensions [N], (tendons,); prescribed ones have their new values.
        moved: change of the prescribed tensions since that solution [N], (tendons,).
        changes: approximate derivative of the displacements by the tensions [m/N], (tendons,
            tendons), with rank-one updates (Broyden 1965).
        displacement: displacements of all tendons [m], (tendons,).
    """

    tensions: FloatArray
    moved: FloatArray
    changes: FloatArray
    displacement: FloatArray


def first_step(winches: Winches, reeled: Reeled, step: FloatArray) -> float:
    """Take the first Newton step of the tensions; fill in their whole change ``step`` [N].

    Returns:
        The largest error of a displacement before it [m]; NaN where no step was found.
    """
    tensions, moved, changes, displacement = reeled
    wanted, rest, driven = winches.given[0], winches.given[2], winches.driven
    wrong, size = np.zeros(step.size), 0.0
    for k in range(step.size):
        if driven[k]:
            wrong[k] = wanted[k] - displacement[k]
            for j in range(step.size):
                wrong[k] -= changes[k, j] * moved[j]
            if tensions[k] > 0.0 or wrong[k] > 0.0:
                size = max(size, abs(wrong[k]))
    if not find_step(changes, wrong, tensions, driven, lacking(wrong, rest.max()), step):
        return np.nan
    take_step(tensions, step)
    for k in range(step.size):
        step[k] += moved[k]
    return size


def next_step(
    winches: Winches, reeled: Reeled, twist: FloatArray, progress: float, last: float,
    step: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Take the next Newton step of the tensions, from the solution of ``twist`` (4, nodes).

    ``step`` (tendons,) [N] is the last step, which updates the derivatives, and receives the next.
    The error has to be at most ``progress`` times the ``last`` one [m].

    Returns:
        The largest error of a displacement [m], and `FOUND` if converged, without a step, `LOST`
        where the steps do not converge, or `ON_THE_WAY`.
    """
    tensions, _, changes, displacement = reeled
    wanted, compliance, rest = winches.given
    scale, count = rest.max(), step.size
    lengths, wrong, left, square = np.empty(count), np.zeros(count), 0.0, 0.0
    find_lengths(winches.path, winches.weights, winches.widens, twist, lengths)
    # Steps for smaller errors do not determine derivatives.
    if last > MET * scale:
        for k in range(count):
            square += step[k] * step[k]
    for k in range(count):
        found = rest[k] - lengths[k] + compliance[k] * tensions[k]
        if square > 0.0:
            missed = found - displacement[k]
            for j in range(count):
                missed -= changes[k, j] * step[j]
            for j in range(count):
                changes[k, j] += missed * step[j] / square
        displacement[k] = found
        wrong[k] = wanted[k] - found if winches.driven[k] else 0.0
        if tensions[k] > 0.0 or wrong[k] > 0.0:
            left = max(left, abs(wrong[k]))
    if not (left <= progress * last or left <= MET * scale):
        return left, LOST
    if not find_step(changes, wrong, tensions, winches.driven, lacking(wrong, scale), step):
        return left, LOST
    is_met = left <= MET * scale and np.abs(step).max() <= TENSIONS_MET * tensions.max()
    if is_met or left <= ROUNDING * scale:
        return left, FOUND
    take_step(tensions, step)
    return left, ON_THE_WAY


def wind(
    tables: ExactTables, grid: GridTables, winches: Winches, reeled: Reeled, twist: FloatArray,
    strains: FloatArray, position: FloatArray, quaternion: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Solve for the tensions ``reeled`` of an unloaded arm; fill in its shape, as `Results`.

    For loaded arms see `CompiledLengths.wind_loaded`.

    Returns:
        As `find_exact_twist`; -1 where the tensions do not converge.
    """
    step = np.zeros(reeled.tensions.size)
    coarse = np.empty((4, tables.sections.axial.size))
    last = first_step(winches, reeled, step)
    if np.isnan(last):
        return np.inf, -1
    for number in range(MOST_STEPS):
        residual, steps = find_exact_twist(tables, reeled.tensions, number > 0, coarse, twist)
        if steps < 0:
            return residual, -1
        progress = PROGRESS if number else 1.0
        last, verdict = next_step(winches, reeled, twist, progress, last, step)
        if verdict == FOUND:
            is_fine = read_out(grid, twist, strains, position, quaternion)
            return residual, steps if is_fine else -1
        if verdict == LOST:
            break
    return np.inf, -1
