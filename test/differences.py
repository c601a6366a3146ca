"""Derivatives by finite differences, for tests of analytic ones."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike


def jacobian(
    function: Callable[[np.ndarray], ArrayLike], at: ArrayLike, step: ArrayLike
) -> np.ndarray:
    """Derivative (..., n) of ``function`` of a vector, at ``at`` (n,): central differences.

    Of fourth order: its own error at ``step`` (or one for each component) is that of a step
    several orders smaller, where the rounding of ``function`` would be all there is.
    """
    at = np.asarray(at, dtype=float)
    columns = []
    for axis, h in enumerate(np.broadcast_to(step, at.shape)):
        move = np.zeros_like(at)
        move[axis] = h
        near = np.asarray(function(at + move)) - np.asarray(function(at - move))
        far = np.asarray(function(at + 2 * move)) - np.asarray(function(at - 2 * move))
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, axis=-1)


def along(
    function: Callable[[np.ndarray], ArrayLike], at: ArrayLike, direction: ArrayLike
) -> np.ndarray:
    """Derivative of ``function`` along ``direction`` (n,), which is as long as a step.

    `jacobian` times ``direction``, by four values of ``function`` however many components it has.
    """
    at, direction = np.asarray(at, dtype=float), np.asarray(direction, dtype=float)
    return jacobian(lambda part: function(at + part * direction), [0.0], 1.0)[..., 0]
