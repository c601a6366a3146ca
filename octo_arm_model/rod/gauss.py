"""Collocation at Gauss points: integrals and interpolation within one element, [0, 1]."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray

_legendre = np.polynomial.legendre


class GaussRule(NamedTuple):
    """Gauss points of [0, 1] and matrices that integrate values at them.

    Attributes:
        points: c, (n,).
        weights: b, quadrature weights over [0, 1], (n,).
        from_start: a, matrix from a column of values to integrals from 0 to each point, (n, n).
        to_end: b - a, likewise to integrals from each point to 1, (n, n).
        tail: likewise to the last two Legendre coefficients, (2, n).
    """

    points: FloatArray
    weights: FloatArray
    from_start: FloatArray
    to_end: FloatArray
    tail: FloatArray

    def interpolate(self, targets: FloatArray) -> FloatArray:
        """Matrix (m, n) from values at the points to values at ``targets`` (m,)."""
        count = self.points.size
        values = _legendre.legvander(2.0 * self.points - 1.0, count - 1)
        at = _legendre.legvander(2.0 * targets - 1.0, count - 1)
        return np.asarray(np.linalg.solve(values.T, at.T).T)

    @property
    def differentiation(self) -> FloatArray:
        """Matrix (n, n) from values at the points to derivatives there."""
        x, count = 2.0 * self.points - 1.0, self.points.size
        values = _legendre.legvander(x, count - 1)
        slopes = _legendre.legvander(x, count - 2) @ _legendre.legder(2.0 * np.eye(count))
        return np.asarray(np.linalg.solve(values.T, slopes.T).T)

    def integrate(self, targets: FloatArray) -> FloatArray:
        """Matrix (m, n) from values at the points to integrals from 0 to ``targets`` (m,)."""
        return _integrals(self.points, targets)


@functools.cache
def gauss_rule(count: int) -> GaussRule:
    """The rule of ``count`` Gauss-Legendre points."""
    x, weights = _legendre.leggauss(count)
    points = 0.5 * (x + 1.0)
    from_start = _integrals(points, points)
    inverse = np.linalg.inv(_legendre.legvander(x, count - 1))
    tail = np.asarray(inverse[-2:], dtype=np.float64)
    weights = np.asarray(0.5 * weights, dtype=np.float64)
    return GaussRule(points, weights, from_start, weights - from_start, tail)


def _integrals(points: FloatArray, targets: FloatArray) -> FloatArray:
    count = points.size
    values = _legendre.legvander(2.0 * points - 1.0, count - 1)
    antiderivatives = _legendre.legint(np.eye(count), lbnd=-1.0, axis=0)
    at = 0.5 * _legendre.legvander(2.0 * targets - 1.0, count) @ antiderivatives
    return np.asarray(np.linalg.solve(values.T, at.T).T)
