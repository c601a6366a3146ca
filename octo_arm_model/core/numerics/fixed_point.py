"""Fixed points x = g(x) by Anderson acceleration (Anderson 1965; Walker and Ni 2011)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray

_DEPTH = 6  # earlier iterates in the combination
_WORSE = 2.0  # growth of the residual at which earlier iterates are discarded
_REGULAR = 1e-14  # regularisation of the least-squares problem, relative


def fixed_point(
    step: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    tolerance: float,
    most: int,
    what: str,
) -> tuple[FloatArray, int]:
    """Solve x = ``step`` (x) from ``start`` (rows, n), each row independently.

    Converged where a step changes each row by at most ``tolerance`` times the larger of one and
    its largest element. For a linear step it is a truncated GMRES, which converges where
    plain iteration may not.

    Returns:
        The solution (rows, n) and the number of steps.

    Raises:
        ConvergenceError: after more than ``most`` steps; ``what`` names the unknowns.
    """
    x = start
    x_changes: list[FloatArray] = []
    residual_changes: list[FloatArray] = []
    last: tuple[FloatArray, FloatArray] | None = None
    best, worst = np.inf, np.inf
    for iteration in range(1, most + 1):
        value = step(x)
        residual = value - x
        size = np.maximum(np.abs(value).max(axis=1, initial=0.0), 1.0)
        worst = float((np.abs(residual).max(axis=1, initial=0.0) / size).max(initial=0.0))
        if worst <= tolerance:
            return value, iteration
        if last is not None:
            if worst > _WORSE * best:
                x_changes, residual_changes = [], []
            else:
                x_changes = [*x_changes[1 - _DEPTH :], x - last[0]]
                residual_changes = [*residual_changes[1 - _DEPTH :], residual - last[1]]
        best = min(best, worst)
        last = x, residual
        x = value if not residual_changes else _mixed(value, residual, x_changes, residual_changes)
    raise ConvergenceError(what, worst, most)


def _mixed(
    value: FloatArray,
    residual: FloatArray,
    x_changes: list[FloatArray],
    residual_changes: list[FloatArray],
) -> FloatArray:
    """Combination of the iterates that minimises the residual if the step is linear."""
    changes = np.stack(residual_changes, axis=1)
    # Rows that have converged have no changes, and keep their value.
    scale = np.sqrt(np.einsum('rkn,rkn->rk', changes, changes))
    scale = np.where(scale > 0.0, scale, 1.0)
    changes = changes / scale[..., np.newaxis]
    gram = np.einsum('rkn,rln->rkl', changes, changes)
    gram += _REGULAR * len(residual_changes) * np.eye(len(residual_changes))
    side = np.einsum('rkn,rn->rk', changes, residual)
    weights = np.linalg.solve(gram, side[..., np.newaxis])[..., 0] / scale
    both = np.stack(x_changes, axis=1) + np.stack(residual_changes, axis=1)
    return np.asarray(value - np.einsum('rk,rkn->rn', weights, both))
