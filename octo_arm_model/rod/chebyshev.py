"""Integration and interpolation of smooth functions by their values at Chebyshev points."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray


def chebyshev_integration(count: int) -> tuple[FloatArray, FloatArray]:
    """Chebyshev points of [0, 1], ascending and with both ends, and their integration matrix.

    Returns:
        Points (count,), and the matrix (count, count) that a row of values at the points is
        multiplied by to give the integrals from 0 to each, exact up to degree count - 1.
    """
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    values = np.polynomial.chebyshev.chebvander(x, count - 1)
    antiderivatives = np.polynomial.chebyshev.chebint(np.eye(count), lbnd=-1.0, axis=0)
    integrals = np.polynomial.chebyshev.chebvander(x, count) @ antiderivatives
    return 0.5 * (x + 1.0), 0.5 * (integrals @ np.linalg.inv(values)).T


def barycentric_matrix(points: FloatArray, targets: FloatArray) -> FloatArray:
    """Matrix (targets, points) from values at Chebyshev ``points`` to those at ``targets``.

    Second (true) form of the barycentric formula with the weights of Salzer 1972.
    """
    weights = (-1.0) ** np.arange(points.size)
    weights[[0, -1]] *= 0.5
    distance = targets[:, np.newaxis] - points
    row, column = np.nonzero(np.abs(distance) < 1e-14)
    distance[row, :] = np.arange(1.0, points.size + 1.0)  # nonzero; replaced below
    matrix = weights / distance
    matrix /= matrix.sum(axis=1, keepdims=True)
    matrix[row] = 0.0
    matrix[row, column] = 1.0
    return matrix
