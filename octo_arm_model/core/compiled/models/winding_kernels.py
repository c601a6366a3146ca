"""Tensions that hold tendons at prescribed lengths: what `numba_build` compiles.

Of an arm of the model exact that was held at lengths nearby, as `analysis.winding` finds them.
Where that takes more than a few steps it is left to NumPy.
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
PROGRESS = 0.1  # what each step must leave less than of the error
TENSIONS_MET = 1e-9  # change of tensions, relative, that is none
MET, ROUNDING = 1e-9, 1e-13  # of the lengths: error that is none before such a change, and at all
LOST, ON_THE_WAY, FOUND = -1, 0, 1  # what became of a step


class Winches(NamedTuple):
    """What is wanted of tendons that keep their places in the cross sections.

    Attributes:
        path: see `find_lengths`, (tendons, 4, nodes).
        weights: likewise, (tendons, nodes).
        widens: whether the law of the arm is neo_hookean.
        given: displacements that are wanted [m], the tendons' compliances [m/N] and unloaded
            lengths [m], (3, tendons).
        driven: whether a tendon is held at its displacement, else at its tension, (tendons,).
    """

    path: FloatArray
    weights: FloatArray
    widens: bool
    given: FloatArray
    driven: NDArray[np.bool_]


class Reeled(NamedTuple):
    """A solution nearby, which the one that is wanted is filled in over.

    Attributes:
        tensions: of all tendons [N], (tendons,); those that are given as they are wanted.
        moved: how much these have changed since [N], likewise.
        changes: derivative of the displacements by the tensions, nearly [m/N], (tendons,
            tendons), which rank-one updates correct (Broyden 1965).
        displacement: of all tendons [m], (tendons,).
    """

    tensions: FloatArray
    moved: FloatArray
    changes: FloatArray
    displacement: FloatArray


def first_step(winches: Winches, reeled: Reeled, step: FloatArray) -> float:
    """Change the tensions by what is wanted, and fill in the whole ``step`` of them.

    Returns:
        The largest change of a displacement that this is for [m]; NaN where there is no step.
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
    """Change the tensions by what is ``left`` to be wound in under a ``twist`` (4, nodes).

    ``step`` is that made before, to leave at most ``progress`` of what was left ``last`` [m].

    Returns:
        What is left [m], and whether that is nothing: `FOUND`, else `ON_THE_WAY`; `LOST` where
        these steps do not lead there.
    """
    tensions, _, changes, displacement = reeled
    wanted, compliance, rest = winches.given
    scale, count = rest.max(), step.size
    lengths, wrong, left, square = np.empty(count), np.zeros(count), 0.0, 0.0
    find_lengths(winches.path, winches.weights, winches.widens, twist, lengths)
    # Of less than that no derivatives are seen.
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
    """Fill in the tensions that hold ``winches``, and the shape, as `Results` has it.

    Of an arm without loads; of one with loads see `CompiledLengths.wind_loaded`.

    Returns:
        What `find_exact_twist` does; -1 where tensions were not found.
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
