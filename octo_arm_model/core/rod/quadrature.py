"""Integrals along the arm of values at the nodes of a grid."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.grid import StationGrid


def integrate_from_tip(values: FloatArray, grid: StationGrid) -> FloatArray:
    """Integral of ``values`` (..., nodes) from each node to the tip.

    Simpson's rule over whole intervals. From a middle to the end of its interval the parabola
    through the same three values is integrated.
    """
    h, count = grid.step, grid.step.size
    first, last = values[..., :count], values[..., 1 : count + 1]
    middle = values[..., count + 1 :]
    whole = (h / 6.0) * (first + 4.0 * middle + last)
    # From the middle of an interval to its end.
    half = (h / 24.0) * (8.0 * middle + 5.0 * last - first)
    total = np.zeros(values.shape)
    total[..., :count] = np.add.accumulate(whole[..., ::-1], axis=-1)[..., ::-1]
    total[..., count + 1 :] = half + total[..., 1 : count + 1]
    return total


def integration_weights(grid: StationGrid) -> FloatArray:
    """Weights (nodes,) whose product with values is their integral along the whole arm."""
    h, count = grid.step, grid.step.size
    weights = np.zeros(grid.nodes.size)
    weights[:count] += h / 6.0
    weights[1 : count + 1] += h / 6.0
    weights[count + 1 :] = 2.0 * h / 3.0
    return weights


def integrate_from_base(values: FloatArray, grid: StationGrid) -> FloatArray:
    """Integral of ``values`` (..., nodes) from the base; by the rules of `integrate_from_tip`."""
    h, count = grid.step, grid.step.size
    first, last = values[..., :count], values[..., 1 : count + 1]
    middle = values[..., count + 1 :]
    total = np.zeros(values.shape)
    np.add.accumulate(
        (h / 6.0) * (first + 4.0 * middle + last), axis=-1, out=total[..., 1 : count + 1]
    )
    half = (h / 24.0) * (5.0 * first + 8.0 * middle - last)
    total[..., count + 1 :] = half + total[..., :count]
    return total
