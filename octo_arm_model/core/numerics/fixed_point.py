"""Fixed points x = g(x), by the mixing of Anderson (1965; Walker and Ni 2011)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray

_DEPTH = 6  # earlier iterates that are mixed
_WORSE = 2.0  # growth of the residual that makes it begin anew
_REGULAR = 1e-14  # part of the squares of earlier changes that keeps them independent


def fixed_point(
    step: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    tolerance: float,
    most: int,
    what: str,
) -> tuple[FloatArray, int]:
    """The x = ``step`` (x) near ``start`` (rows, n), each row by itself, and the steps it took.

    Each row is right once it moves by no more than ``tolerance`` times the larger of one and its
    largest element. Of a linear step this is GMRES, which converges where plain iteration may not.

    Raises:
        ConvergenceError: if that takes more than ``most`` steps; ``what`` names the unknowns.
    """
    x = start
    moved_x: list[FloatArray] = []
    moved_left: list[FloatArray] = []
    last: tuple[FloatArray, FloatArray] | None = None
    best, worst = np.inf, np.inf
    for iteration in range(1, most + 1):
        value = step(x)
        left = value - x
        size = np.maximum(np.abs(value).max(axis=1, initial=0.0), 1.0)
        worst = float((np.abs(left).max(axis=1, initial=0.0) / size).max(initial=0.0))
        if worst <= tolerance:
            return value, iteration
        if last is not None:
            if worst > _WORSE * best:
                moved_x, moved_left = [], []
            else:
                moved_x = [*moved_x[1 - _DEPTH :], x - last[0]]
                moved_left = [*moved_left[1 - _DEPTH :], left - last[1]]
        best = min(best, worst)
        last = x, left
        x = value if not moved_left else _mixed(value, left, moved_x, moved_left)
    raise ConvergenceError(what, worst, most)


def _mixed(
    value: FloatArray, left: FloatArray, moved_x: list[FloatArray], moved_left: list[FloatArray]
) -> FloatArray:
    """The mixture of what has been tried that would leave least were the step linear."""
    changes = np.stack(moved_left, axis=1)
    # Rows that are right already have no changes left, and are not mixed.
    scale = np.sqrt(np.einsum('rkn,rkn->rk', changes, changes))
    scale = np.where(scale > 0.0, scale, 1.0)
    changes = changes / scale[..., np.newaxis]
    gram = np.einsum('rkn,rln->rkl', changes, changes)
    gram += _REGULAR * len(moved_left) * np.eye(len(moved_left))
    side = np.einsum('rkn,rn->rk', changes, left)
    weights = np.linalg.solve(gram, side[..., np.newaxis])[..., 0] / scale
    both = np.stack(moved_x, axis=1) + np.stack(moved_left, axis=1)
    return np.asarray(value - np.einsum('rk,rkn->rn', weights, both))
