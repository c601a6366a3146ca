"""Linear two-point boundary value problems along the arm.

    y' = A(s) y + f(s)    y_1..3 = 0 at the base    y_4..6 = 0 at the tip

by Simpson's rule with the middle from Hermite's cubic (Lobatto IIIA, fourth order), all intervals
in one banded system. Marching from one end would multiply errors by as much as the arm can bend.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgbsv

from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray

_BAND = 8  # rows and columns from the diagonal that two neighbouring ends reach


class TwoPointProblem:
    """Solver for problems on given intervals."""

    def __init__(self, step: FloatArray) -> None:
        """Prepare for intervals of length ``step`` (n,) [m]."""
        self._step = step
        count = step.size
        self._size = 6 * (count + 1)
        # Where the blocks of interval i stand in the banded matrix: rows 3 + 6 i on, of which the
        # first three of all are those of the base.
        row, column = np.indices((6, 6))
        start = 6 * np.arange(count)
        self._first = (
            (2 * _BAND + 3 + row - column)[..., np.newaxis],
            column[..., np.newaxis] + start,
        )
        self._last = self._first[0] - 6, self._first[1] + 6

    def solve(self, a: FloatArray, f: FloatArray) -> tuple[FloatArray, int]:
        """Solution y (6, columns, nodes) for A (6, 6, nodes) and f (6, columns, nodes).

        Nodes are the ends of the intervals, then their middles. Also the sign of the determinant
        of the whole system, 1 or -1.

        Raises:
            ConvergenceError: if the problem is singular.
        """
        h, count = self._step, self._step.size
        a_ends, a_middle = a[..., : count + 1], a[..., count + 1 :]
        f_ends, f_middle = f[..., : count + 1], f[..., count + 1 :]
        squared = np.einsum('ijn,jkn->ikn', a_middle * (h * h / 12.0), a_ends[..., :-1])
        first = -(h / 6.0) * a_ends[..., :-1] - (h / 3.0) * a_middle - squared
        squared = np.einsum('ijn,jkn->ikn', a_middle * (h * h / 12.0), a_ends[..., 1:])
        last = -(h / 6.0) * a_ends[..., 1:] - (h / 3.0) * a_middle + squared
        for i in range(6):
            first[i, i] -= 1.0
            last[i, i] += 1.0
        lean = f_ends[..., :-1] - f_ends[..., 1:]
        right = (h / 6.0) * (f_ends[..., :-1] + 4.0 * f_middle + f_ends[..., 1:])
        right += np.einsum('ijn,jcn->icn', a_middle * (h * h / 12.0), lean)

        columns = f.shape[1]
        band = np.zeros((3 * _BAND + 1, self._size))
        band[self._first] = first
        band[self._last] = last
        for i in range(3):
            band[2 * _BAND, i] = 1.0
            band[2 * _BAND, self._size - 3 + i] = 1.0
        sides = np.zeros((self._size, columns))
        sides[3:-3] = right.transpose(2, 0, 1).reshape(-1, columns)
        factors, pivots, solution, singular = dgbsv(_BAND, _BAND, band, sides, overwrite_ab=True)
        if singular:
            raise ConvergenceError('the balance under load', np.inf, 0)
        ends = solution.reshape(count + 1, 6, columns).transpose(1, 2, 0)
        y = np.empty(f.shape)
        y[..., : count + 1] = ends
        slope = np.einsum('ijn,jcn->icn', a_ends, ends) + f_ends
        middle = 0.5 * (ends[..., :-1] + ends[..., 1:])
        y[..., count + 1 :] = middle + (h / 8.0) * (slope[..., :-1] - slope[..., 1:])
        exchanges = np.count_nonzero(pivots != np.arange(self._size))
        negative = np.count_nonzero(factors[2 * _BAND] < 0.0)
        return y, 1 - 2 * int((exchanges + negative) % 2)
