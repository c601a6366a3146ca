"""The imbalance p of the paper's model between two anchorages; `renda2012` has its equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.cross_section import Stiffness
from octo_arm_model.errors import ConvergenceError
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.tendons import TendonSums

COLLOCATION_POINTS = 20
# Sweeps stop when p changes by less than this part of the largest moment in the arm, which
# leaves an error ten times smaller as each sweep gains more than one digit by then. Looking
# costs as much as sweeping, so it is done after every few sweeps.
TOLERANCE = 5e-8
DERIVATIVE_TOLERANCE = 1e-13
MAX_SWEEPS = 60
_SWEEPS_BETWEEN_CHECKS = 2


@dataclass(frozen=True)
class Piece:
    """Part of a panel, collocated at points of its own.

    Attributes:
        section: number of its section from the tip.
        jump: whether it begins at the anchorage of that section.
        points: where its points stand among those of all pieces.
        integrate: matrix from slopes and initial value to values, (points + 1, points).
        at_nodes: nodes that lie in it.
        to_nodes: matrix from its points to those nodes.
    """

    section: int
    jump: bool
    points: slice
    integrate: FloatArray
    at_nodes: IntArray
    to_nodes: FloatArray


class Coefficients:
    """Everything in the equations of p but p itself, at the points of all pieces."""

    def __init__(self, sums: TendonSums, stiffness: Stiffness) -> None:
        """Prepare for ``sums`` (batch, points) and ``stiffness`` (points,)."""
        a1, b1 = sums.second_n, sums.second_b
        polar = a1 + b1
        self.force = np.zeros((3, *a1.shape), a1.dtype)
        np.negative(sums.first_b, out=self.force[1])
        self.force[2] = sums.first_n
        self.compliance = np.empty_like(self.force)
        np.divide(1.0, stiffness.torsion + polar, out=self.compliance[0])
        np.divide(1.0, stiffness.bending + b1, out=self.compliance[1])
        np.divide(1.0, stiffness.bending + a1, out=self.compliance[2])
        c_t, c_n, c_b = self.compliance
        _, self._xi_0, self._k_0 = self.compliance * self.force
        lift = (stiffness.bending + polar) * c_t
        # The two bending components side by side: p_nb' = p_t (linear + product * p_bn).
        self._linear, self._product = np.empty((2, 2, *a1.shape), a1.dtype)
        np.multiply(-lift, self._k_0, out=self._linear[0])
        np.multiply(lift, self._xi_0, out=self._linear[1])
        np.multiply(-b1 * c_t, c_b, out=self._product[0])
        np.multiply(a1 * c_t, c_n, out=self._product[1])
        self._product_t = (b1 - a1) * c_n * c_b
        self._moment = np.abs(self.force).max(axis=(0, 2))[:, np.newaxis]
        # Small enough to see that derivatives, which are imaginary parts, have settled as well.
        part = DERIVATIVE_TOLERANCE if np.iscomplexobj(self.force) else TOLERANCE
        self._tolerance = part * self._moment

    def sweep(self, piece: Piece, start: FloatArray) -> tuple[FloatArray, float, int]:
        """Return p (3, batch, points) in ``piece``, ``start`` (3, batch) at its tip end.

        Also the last change over the largest moment in the arm, and the number of sweeps.

        Each sweep takes the newest components (Gauss-Seidel), which halves their number.
        """
        points, integrate = piece.points, piece.integrate
        xi_0, k_0 = self._xi_0[:, points], self._k_0[:, points]
        linear, product = self._linear[..., points], self._product[..., points]
        product_t = self._product_t[:, points]
        # Slopes carry the initial value in one more column, for the last row of the matrix.
        slope = np.empty((*start.shape, COLLOCATION_POINTS + 1), start.dtype)
        slope[..., -1] = start
        slope_t, slope_nb = slope[0, :, :-1], slope[1:, :, :-1]
        p = np.empty((*start.shape, COLLOCATION_POINTS), start.dtype)
        p[:] = start[..., np.newaxis]
        p_t, p_n, p_b = p
        p_nb, p_bn = p[1:], p[:0:-1]
        previous = np.empty_like(p)
        sweeps = 0
        while True:
            for left in range(_SWEEPS_BETWEEN_CHECKS, 0, -1):
                if left == 1:
                    previous[:] = p
                np.multiply(product_t, p_b, out=slope_t)
                slope_t += k_0
                slope_t *= p_n
                slope_t -= xi_0 * p_b
                np.matmul(slope[0], integrate, out=p_t)
                np.multiply(product, p_bn, out=slope_nb)
                slope_nb += linear
                slope_nb *= p_t
                np.matmul(slope[1:], integrate, out=p_nb)
            sweeps += _SWEEPS_BETWEEN_CHECKS
            change = np.abs(p - previous)
            # Counted rather than `all`, which takes five times as long; NaN does not count.
            if np.count_nonzero(change <= self._tolerance) == change.size:
                return p, self._relative(change), sweeps
            if sweeps >= MAX_SWEEPS:
                raise ConvergenceError(
                    f'equation (10) in section {piece.section}', self._relative(change), sweeps
                )

    def _relative(self, change: FloatArray) -> float:
        """Largest ``change`` over the largest moment in its arm."""
        moment = np.maximum(self._moment, 1e-300)
        return float((change / moment).max(initial=0.0))
