"""Integration and interpolation of smooth functions by their values at Chebyshev points."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray


def chebyshev_integration(count: int) -> tuple[FloatArray, FloatArray]:
    """Chebyshev points of [0, 1] in ascending order, both ends among them, and their integrals.

    Returns:
        Points (count,), and the matrix (count, count) that, from the right, takes values at the
        points to the integral from 0 to each point, exact for polynomials of degree count - 1.
    """
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    values = np.polynomial.chebyshev.chebvander(x, count - 1)
    antiderivatives = np.polynomial.chebyshev.chebint(np.eye(count), lbnd=-1.0, axis=0)
    integrals = np.polynomial.chebyshev.chebvander(x, count) @ antiderivatives
    return 0.5 * (x + 1.0), 0.5 * (integrals @ np.linalg.inv(values)).T


def barycentric_matrix(points: FloatArray, targets: FloatArray) -> FloatArray:
    """Matrix that interpolates values at Chebyshev ``points`` to ``targets``.

    Second (true) form of the barycentric formula with the weights of Salzer 1972.
    """
    weights = (-1.0) ** np.arange(points.size)
    weights[[0, -1]] *= 0.5
    distance = targets[:, np.newaxis] - points
    row, column = np.nonzero(np.abs(distance) < 1e-14)
    distance[row, :] = np.arange(1.0, points.size + 1.0)  # replaced below; must not be zero
    matrix = weights / distance
    matrix /= matrix.sum(axis=1, keepdims=True)
    matrix[row] = 0.0
    matrix[row, column] = 1.0
    return matrix


def tail_matrix(count: int) -> FloatArray:
    """Matrix (count, 2) that, from the right, takes values to the last two Chebyshev coefficients.

    They are small where the points resolve the function.
    """
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    values = np.polynomial.chebyshev.chebvander(x, count - 1)
    return np.asarray(np.linalg.inv(values)[-2:].T, dtype=np.float64)
