"""Newton's step of tensions that stay >= 0: which tendons are taut after it, and which slack."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from octo_arm_model.core.compiled.models.tension_step_kernels import EXCHANGES, SINGULAR
from octo_arm_model.core.hints import FloatArray


def complementary_step(
    changes: FloatArray,
    wrong: FloatArray,
    tensions: FloatArray,
    driven: NDArray[np.bool_],
    stays_slack: float,
) -> FloatArray | None:
    """Step (tendons,) of ``tensions`` [N] that takes out what is ``wrong`` [m].

    As `tension_step_kernels.find_step`, which explains it; None where there is none.
    """
    taut, diagonal = driven & (tensions > 0.0), changes.diagonal()
    for _ in range(EXCHANGES):
        step = np.where(driven & ~taut, -tensions, 0.0)
        (index,) = taut.nonzero()
        if index.size:
            factors, pivots, _ = dgetrf(changes[index[:, np.newaxis], index])
            sizes = np.abs(factors.diagonal())
            if not sizes.min() > SINGULAR * sizes.max():
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
