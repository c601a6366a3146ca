"""Newton's step of tensions that stay >= 0: which tendons are taut after it, and which slack."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from octo_arm_model.core.hints import FloatArray

_EXCHANGES = 40  # of tendons between slack and taut in one step, at most
_SINGULAR = 1e-10  # pivot over the largest, below which the tensions are not determined
# Error of the displacement up to which a slack tendon stays slack: parts of the lengths and of the
# largest error, as a step is not more accurate than that. With less, antagonistic tendons would
# alternate between slack and taut.
_STAYS_SLACK, _UNSURE = 1e-10, 1e-4


def lacking(wrong: FloatArray, scale: float) -> float:
    """Error up to which a slack tendon stays slack [m], for tendon lengths of ``scale`` [m]."""
    return max(_STAYS_SLACK * scale, _UNSURE * float(np.abs(wrong).max()))


def complementary_step(
    changes: FloatArray,
    wrong: FloatArray,
    tensions: FloatArray,
    driven: NDArray[np.bool_],
    stays_slack: float,
) -> FloatArray | None:
    """Step (tendons,) of ``tensions`` [N] that takes out what is ``wrong`` [m].

    From the derivatives ``changes`` (tendons, tendons) [m/N] of the displacements. A linear
    complementarity problem: every driven tendon is taut, its error zero, or slack, its tension
    zero and its error at most ``stays_slack`` [m]. By principal pivoting the tendon that violates
    this most is exchanged until none does; where the tensions of taut tendons are not determined,
    the one of least tension becomes slack. None where that does not end.
    """
    taut, diagonal = driven & (tensions > 0.0), changes.diagonal()
    for _ in range(_EXCHANGES):
        step = np.where(driven & ~taut, -tensions, 0.0)
        (index,) = taut.nonzero()
        if index.size:
            factors, pivots, _ = dgetrf(changes[index[:, np.newaxis], index])
            sizes = np.abs(factors.diagonal())
            if not sizes.min() > _SINGULAR * sizes.max():
                taut[index[tensions[index].argmin()]] = False
                continue
            step[index] = dgetrs(factors, pivots, (wrong - changes @ step)[index])[0]
        excess = np.where(
            taut, -diagonal * (tensions + step), wrong - changes @ step - stays_slack
        )
        excess[~driven] = 0.0
        worst = excess.argmax()
        if not excess[worst] > 0.0:
            return step
        taut[worst] = not taut[worst]
    return None
