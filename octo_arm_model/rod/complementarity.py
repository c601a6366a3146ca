"""Newton's step of tensions that stay >= 0: which tendons are taut after it, and which slack."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.optimize import nnls

from octo_arm_model.arm.hints import FloatArray

_EXCHANGES = 40  # of tendons between slack and taut in one step, at most
_SINGULAR = 1e-10  # pivot over the largest, below which the tensions are not determined
# Error of the displacement up to which a slack tendon stays slack: parts of the lengths and of the
# largest error, as a step is not more accurate than that. With less, antagonistic tendons would
# alternate between slack and taut.
_STAYS_SLACK, _UNSURE = 1e-10, 1e-4


def complementary_step(
    changes: FloatArray,
    wrong: FloatArray,
    tensions: FloatArray,
    driven: NDArray[np.bool_],
    length: float,
) -> FloatArray:
    """Step (J,) of ``tensions`` [N] that takes out what is ``wrong`` (J,) [m].

    By the derivatives ``changes`` (J, J) [m/N] of what is reeled in; nothing is wrong where a
    tendon is not ``driven``. A linear complementarity
    problem: every ``driven`` tendon is taut, its error zero, or slack, its tension zero and its
    error at most a small part of ``length`` [m], that of the arm. By principal pivoting the tendon
    that violates this most is exchanged until none does. Where errors do not determine the
    tensions of taut tendons the least change is taken; where they contradict each other, the
    tendon of least tension becomes slack.
    """
    taut = driven & (tensions > 0.0)
    left = max(float(wrong.max()), -float((wrong * taut).min()), 0.0)
    stays_slack = max(_STAYS_SLACK * length, _UNSURE * left)
    if not taut.any():
        taut = driven & (wrong > stays_slack)
    size = np.abs(changes.diagonal())
    for _ in range(_EXCHANGES):
        step = np.where(taut | ~driven, 0.0, -tensions)
        right = wrong - changes @ step
        (index,) = taut.nonzero()
        if index.size:
            part, own = changes[index[:, np.newaxis], index], right[index]
            factors, pivots, _ = dgetrf(part)
            pivot = np.abs(factors.diagonal())
            if pivot.min() > _SINGULAR * pivot.max():
                step[index] = dgetrs(factors, pivots, own)[0]
            else:
                step[index] = np.linalg.lstsq(part, own, rcond=_SINGULAR)[0]
                if np.abs(part @ step[index] - own).max() > stays_slack:
                    taut[index[tensions[index].argmin()]] = False
                    continue
        new = tensions + step
        excess = np.where(taut, -size * new, wrong - changes @ step - stays_slack) * driven
        worst = excess.argmax()
        if not excess[worst] > 0.0:
            return step
        taut[worst] = not taut[worst]
    return _least(changes, wrong, tensions, driven)


def _least(
    changes: FloatArray, wrong: FloatArray, tensions: FloatArray, driven: NDArray[np.bool_]
) -> FloatArray:
    """The same by the quadratic programme of which it is the condition, of a symmetric part.

    Least (T' - T) C (T' - T) / 2 - wrong (T' - T) over T' >= 0, for C = U^T U.
    """
    (index,) = driven.nonzero()
    part = changes[np.ix_(index, index)]
    values, vectors = np.linalg.eigh(0.5 * (part + part.T))
    root = np.sqrt(np.maximum(values, 1e-10 * values[-1]))
    goal = (vectors.T @ wrong[index]) / root + root * (vectors.T @ tensions[index])
    step = np.zeros_like(tensions)
    step[index] = nnls(root[:, np.newaxis] * vectors.T, goal)[0] - tensions[index]
    return step
