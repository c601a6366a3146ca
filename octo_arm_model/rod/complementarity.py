"""Newton's step of tensions that stay >= 0: which tendons are taut after it, and which slack."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.optimize import nnls

from octo_arm_model.arm.hints import FloatArray

_EXCHANGES = 40  # of tendons between slack and taut in one step, at most
_UNSURE = 1e-4  # error of a step over the largest error before it


class Tolerance(NamedTuple):
    """What displacements do not tell of tensions.

    Attributes:
        singular: pivot over the largest, below which tensions are not determined: of tendons
            that lengths do not tell apart, or that friction alone does.
        slack: error of the displacement up to which a slack tendon stays slack [m]. With less,
            antagonistic tendons would alternate between slack and taut.
        contradiction: by how much lengths may contradict each other [m]; where they do by more,
            the tendon of least tension becomes slack.
    """

    singular: float
    slack: float
    contradiction: float

    @classmethod
    def of(cls, length: float, has_friction: bool) -> Tolerance:
        """Of an arm of a ``length`` [m]."""
        if has_friction:
            return cls(1e-5, 1e-10 * length, 1e-6 * length)
        return cls(1e-10, 1e-10 * length, 1e-10 * length)


def complementary_step(
    changes: FloatArray,
    wrong: FloatArray,
    tensions: FloatArray,
    driven: NDArray[np.bool_],
    tolerance: Tolerance,
) -> tuple[FloatArray, float]:
    """Step (J,) of ``tensions`` [N] that takes out what is ``wrong`` (J,) [m].

    By the derivatives ``changes`` (J, J) [m/N] of what is reeled in; nothing is wrong where a
    tendon is not ``driven``. A linear complementarity problem: every ``driven`` tendon is taut,
    its error zero, or slack, its tension zero and its error at most as the ``tolerance`` says. By
    principal pivoting the tendon that violates this most is exchanged until none does. Where
    errors do not determine the tensions of taut tendons the least change is taken.

    Returns:
        The step, and the largest error that lengths which contradict each other leave [m].
    """
    taut = driven & (tensions > 0.0)
    left = max(float(wrong.max()), -float((wrong * taut).min()), 0.0)
    unsure = _UNSURE * left
    stays_slack = max(tolerance.slack, unsure)
    if not taut.any():
        taut = driven & (wrong > stays_slack)
    size = np.abs(changes.diagonal())
    for _ in range(_EXCHANGES):
        step = np.where(taut | ~driven, 0.0, -tensions)
        right, kept = wrong - changes @ step, 0.0
        (index,) = taut.nonzero()
        if index.size:
            scale = 1.0 / np.sqrt(size[index])
            part, own = changes[index[:, np.newaxis], index], right[index]
            scaled = part * scale * scale[:, np.newaxis]
            factors, pivots, _ = dgetrf(scaled)
            pivot = np.abs(factors.diagonal())
            if pivot.min() > tolerance.singular * pivot.max():
                step[index] = scale * dgetrs(factors, pivots, scale * own)[0]
            else:
                least = np.linalg.lstsq(scaled, scale * own, rcond=tolerance.singular)[0]
                step[index] = scale * least
                kept = float(np.abs(part @ step[index] - own).max())
                if kept > max(tolerance.contradiction, unsure):
                    taut[index[tensions[index].argmin()]] = False
                    continue
        new = tensions + step
        excess = np.where(taut, -size * new, wrong - changes @ step - stays_slack) * driven
        worst = excess.argmax()
        if not excess[worst] > 0.0:
            return step, kept
        taut[worst] = not taut[worst]
    return _least(changes, wrong, tensions, driven), 0.0


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
