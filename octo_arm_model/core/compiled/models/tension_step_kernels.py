"""Newton's step of tensions that stay >= 0: what `numba_build` compiles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.hints import FloatArray

EXCHANGES = 40  # of slack and taut tendons in one step
SINGULAR = 1e-10  # pivot over the largest, from which on tensions are not determined
# By how much the path of a slack tendon may be too short for it to stay so, of the lengths or of
# what is wrong, which no step is as exact as: tendons that hold each other would be slack and taut
# by turns for less.
STAYS_SLACK, UNSURE = 1e-10, 1e-4


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
    stays_slack: float, step: FloatArray,
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
            excess = wrong[k] - stays_slack
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


def lacking(wrong: FloatArray, scale: float) -> float:
    """What a slack tendon may lack of lengths of that ``scale`` and stay slack [m]."""
    return max(STAYS_SLACK * scale, UNSURE * np.abs(wrong).max())


def take_step(tensions: FloatArray, step: FloatArray) -> None:
    """Move ``tensions`` by a ``step``, which ends where they are zero."""
    for k in range(step.size):
        new = max(tensions[k] + step[k], 0.0)
        step[k] = new - tensions[k]
        tensions[k] = new
