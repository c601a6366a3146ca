"""Tensions that hold tendons at prescribed lengths: what `numba_build` compiles.

Of an unloaded arm of the model exact that was held at lengths nearby, as `analysis.winding` finds
them. Where that takes more than a few steps it is left to NumPy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.compiled.models.arm_tables import GridTables
from octo_arm_model.core.compiled.models.exact_kernels import find_exact_twist
from octo_arm_model.core.compiled.models.frame_kernels import read_out
from octo_arm_model.core.compiled.section.length_kernels import find_lengths
from octo_arm_model.core.compiled.section.section_tables import ExactTables
from octo_arm_model.core.hints import FloatArray

MOST_STEPS = 6
PROGRESS = 0.1  # what each step must leave less than of the error
EXCHANGES = 40  # of slack and taut tendons in one step
SINGULAR = 1e-10  # pivot over the largest, from which on tensions are not determined
TENSIONS_MET = 1e-9  # change of tensions, relative, that is none
MET, ROUNDING = 1e-9, 1e-13  # of the lengths: error that is none before such a change, and at all


def solve_some(
    matrix: FloatArray, right: FloatArray, some: NDArray[np.bool_], found: FloatArray
) -> bool:
    """Solve for ``some`` of the unknowns ``found`` of ``matrix`` (n, n) while the others stay.

    Returns:
        Whether that determines them.
    """
    (index,) = np.nonzero(some)
    n = index.size
    system, side = np.empty((n, n)), np.empty(n)
    for i in range(n):
        side[i] = right[index[i]]
        for k in range(right.size):
            if not some[k]:
                side[i] -= matrix[index[i], k] * found[k]
        for j in range(n):
            system[i, j] = matrix[index[i], index[j]]
    largest = 0.0
    for j in range(n):
        pivot = j + np.argmax(np.abs(system[j:, j]))
        largest = max(largest, abs(system[pivot, j]))
        if not abs(system[pivot, j]) > SINGULAR * largest:
            return False
        for k in range(n):
            system[j, k], system[pivot, k] = system[pivot, k], system[j, k]
        side[j], side[pivot] = side[pivot], side[j]
        for i in range(j + 1, n):
            factor = system[i, j] / system[j, j]
            side[i] -= factor * side[j]
            for k in range(j, n):
                system[i, k] -= factor * system[j, k]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            side[j] -= system[j, k] * side[k]
        side[j] /= system[j, j]
        found[index[j]] = side[j]
    return True


def find_step(
    changes: FloatArray, wrong: FloatArray, tensions: FloatArray, driven: NDArray[np.bool_],
    rounding: float, step: FloatArray,
) -> bool:  # fmt: skip
    """Fill in Newton's ``step`` of the tensions, after which tendons are taut or slack.

    One after another, the taut one that would have to push most becomes slack or the slack one
    whose path would be shortest taut, until there are none (principal pivoting). Of tendons that
    hold each other, whose tensions are not determined, the least taut becomes slack.

    Returns:
        Whether there is one.
    """
    taut = driven & (tensions > 0.0)
    for _ in range(EXCHANGES):
        step[:] = 0.0
        for k in range(step.size):
            if driven[k] and not taut[k]:
                step[k] = -tensions[k]
        if not solve_some(changes, wrong, taut, step):
            least = np.argmin(np.where(taut, tensions, np.inf))
            taut[least] = False
            continue
        worst, most = -1, 0.0
        for k in range(step.size):
            if not driven[k]:
                continue
            excess = wrong[k] - rounding
            for j in range(step.size):
                excess -= changes[k, j] * step[j]
            if taut[k]:
                excess = -changes[k, k] * (tensions[k] + step[k])
            if excess > most:
                worst, most = k, excess
        if worst < 0:
            return True
        taut[worst] = not taut[worst]
    return False


def take_step(tensions: FloatArray, step: FloatArray) -> None:
    """Move ``tensions`` by a ``step``, which ends where they are zero."""
    for k in range(step.size):
        new = max(tensions[k] + step[k], 0.0)
        step[k] = new - tensions[k]
        tensions[k] = new


def wind(
    tables: ExactTables, grid: GridTables, path: FloatArray, weights: FloatArray, widens: bool,
    given: FloatArray, driven: NDArray[np.bool_], tensions: FloatArray, changes: FloatArray,
    displacement: FloatArray, twist: FloatArray, strains: FloatArray, position: FloatArray,
    quaternion: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Fill in the ``tensions`` that hold ``driven`` tendons, and the shape, as `Results` has it.

    ``given`` (3, tendons) has the displacements that are wanted [m], the tendons' compliances
    [m/N] and unloaded lengths [m]. ``tensions`` and ``displacement`` are nearly right, and
    ``changes`` (tendons, tendons) those of the displacements with the tensions, which rank-one
    updates correct (Broyden 1965).

    Returns:
        What `find_exact_twist` does; -1 where tensions were not found.
    """
    wanted, compliance, rest = given[0], given[1], given[2]
    scale, count = rest.max(), tensions.size
    step, wrong, lengths = np.zeros(count), np.zeros(count), np.empty(count)
    last, before = np.inf, np.zeros(count)
    for k in range(count):
        wrong[k] = wanted[k] - displacement[k] if driven[k] else 0.0
    if not find_step(changes, wrong, tensions, driven, ROUNDING * scale, step):
        return np.inf, -1
    take_step(tensions, step)
    for _ in range(MOST_STEPS):
        residual, steps = find_exact_twist(tables, tensions, twist)
        if steps < 0:
            return residual, -1
        find_lengths(path, weights, widens, twist, lengths)
        left = 0.0
        for k in range(count):
            displacement[k] = rest[k] - lengths[k] + compliance[k] * tensions[k]
            wrong[k] = wanted[k] - displacement[k] if driven[k] else 0.0
            if tensions[k] > 0.0 or wrong[k] > 0.0:
                left = max(left, abs(wrong[k]))
        if not left <= PROGRESS * last and left > ROUNDING * scale:
            return residual, -1
        square = 0.0
        for k in range(count):
            square += step[k] * step[k]
        if square > 0.0 and last < np.inf:
            for k in range(count):
                missed = displacement[k] - before[k]
                for j in range(count):
                    missed -= changes[k, j] * step[j]
                for j in range(count):
                    changes[k, j] += missed * step[j] / square
        if not find_step(changes, wrong, tensions, driven, ROUNDING * scale, step):
            return residual, -1
        is_met = left <= MET * scale and np.abs(step).max() <= TENSIONS_MET * tensions.max()
        if is_met or left <= ROUNDING * scale:
            is_fine = read_out(grid, twist, strains, position, quaternion)
            return residual, steps if is_fine else -1
        last = left
        before[:] = displacement
        take_step(tensions, step)
    return np.inf, -1
