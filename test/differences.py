"""Finite differences, for tests of analytic derivatives."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike


def jacobian(
    function: Callable[[np.ndarray], ArrayLike], at: ArrayLike, step: ArrayLike
) -> np.ndarray:
    """Return the derivative (..., n) of ``function`` at ``at`` (n,) by central differences.

    They are of fourth order, so that ``step`` (one, or one per component) can be so large that
    rounding of ``function`` does not matter.
    """
    at = np.asarray(at, dtype=float)
    columns = []
    for axis, h in enumerate(np.broadcast_to(step, at.shape)):
        move = np.zeros_like(at)
        move[axis] = h
        inner = np.asarray(function(at + move)) - np.asarray(function(at - move))
        outer = np.asarray(function(at + 2 * move)) - np.asarray(function(at - 2 * move))
        columns.append((8 * inner - outer) / (12 * h))
    return np.stack(columns, axis=-1)


def along(
    function: Callable[[np.ndarray], ArrayLike], at: ArrayLike, direction: ArrayLike
) -> np.ndarray:
    """Return `jacobian` times ``direction`` (n,) from four values; ``direction`` is the step."""
    at, direction = np.asarray(at, dtype=float), np.asarray(direction, dtype=float)
    return jacobian(lambda factor: function(at + factor * direction), [0.0], 1.0)[..., 0]
