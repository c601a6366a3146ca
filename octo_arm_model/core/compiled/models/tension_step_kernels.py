"""Kernels for a Newton step of tensions under the constraint that they stay >= 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.compiled.numerics.dense_kernels import factorise, solve_transposed
from octo_arm_model.core.hints import FloatArray

EXCHANGES = 40  # of tendons between slack and taut in one step, at most
SINGULAR = 1e-10  # pivot over the largest, below which the tensions are not determined
# Error of the displacement up to which a slack tendon stays slack: parts of the lengths and of the
# largest error, as a step is not more accurate than that. With less, antagonistic tendons would
# alternate between slack and taut.
STAYS_SLACK, UNSURE = 1e-10, 1e-4


def solve_some(
    matrix: FloatArray, right: FloatArray, some: NDArray[np.bool_], found: FloatArray
) -> bool:
    """Solve the equations ``some`` (n,) of ``matrix`` (n, n) for the unknowns of the same index.

    ``found`` (n,) has the values of the other unknowns and receives the solution.

    Returns:
        Whether the system is regular.
    """
    (index,) = np.nonzero(some)
    n = index.size
    system, side, pivots = np.empty((n, n)), np.empty((1, n)), np.empty(n, np.int64)
    for i in range(n):
        side[0, i] = right[index[i]]
        for k in range(right.size):
            if not some[k]:
                side[0, i] -= matrix[index[i], k] * found[k]
        for j in range(n):
            system[j, i] = matrix[index[i], index[j]]
    if not factorise(system, pivots):
        return False
    over = np.abs(np.diag(system))  # 1 / pivots
    if n and not over.min() > SINGULAR * over.max():
        return False
    solve_transposed(system.reshape(1, n, n), pivots.reshape(1, n), side.reshape(1, 1, n))
    for i in range(n):
        found[index[i]] = side[0, i]
    return True


def find_step(
    changes: FloatArray, wrong: FloatArray, tensions: FloatArray, driven: NDArray[np.bool_],
    stays_slack: float, step: FloatArray,
) -> bool:  # fmt: skip
    """Fill in the Newton ``step`` (tendons,) of the tensions [N], which keeps them >= 0.

    From the derivatives ``changes`` (tendons, tendons) [m/N] and errors ``wrong`` (tendons,) [m]
    of the displacements. A linear complementarity problem: every driven tendon is taut, its error
    zero, or slack, its tension zero and its error at most ``stays_slack`` [m]. By
    principal pivoting the tendon that violates this most is exchanged until none does; where the
    tensions of taut tendons are not determined, the one of least tension becomes slack.

    Returns:
        Whether a step was found.
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
    """Error up to which a slack tendon stays slack [m], for tendon lengths of ``scale`` [m]."""
    return max(STAYS_SLACK * scale, UNSURE * np.abs(wrong).max())


def take_step(tensions: FloatArray, step: FloatArray) -> None:
    """Add ``step`` to ``tensions``, cut so that none becomes negative."""
    for k in range(step.size):
        new = max(tensions[k] + step[k], 0.0)
        step[k] = new - tensions[k]
        tensions[k] = new
