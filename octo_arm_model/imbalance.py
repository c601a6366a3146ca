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
        to_nodes: runs of nodes that lie in it, each with the matrix from its points to those.
    """

    section: int
    jump: bool
    points: slice
    integrate: FloatArray
    to_nodes: list[tuple[slice, FloatArray]]


class Coefficients:
    """Everything in the equations of p but p itself, at the points of all pieces."""

    def __init__(self, sums: TendonSums, stiffness: Stiffness) -> None:
        """Prepare for ``sums`` (..., points) and ``stiffness`` (points,)."""
        a1, b1 = sums.second_n, sums.second_b
        polar = a1 + b1
        self.force = np.zeros((3, *a1.shape), a1.dtype)
        f_n = np.negative(sums.first_b, out=self.force[1])
        f_b = self.force[2]
        f_b[...] = sums.first_n
        self.compliance = np.empty_like(self.force)
        c_t, c_n, c_b = self.compliance
        np.divide(1.0, stiffness.torsion + polar, out=c_t)
        np.divide(1.0, stiffness.bending + b1, out=c_n)
        np.divide(1.0, stiffness.bending + a1, out=c_b)
        xi_0, k_0 = c_n * f_n, c_b * f_b
        lift = (stiffness.bending + polar) * c_t
        # p_t' = p_n (k_0 + product_t p_b) - xi_0 p_b
        # p_n' = p_t (linear_n + product_n p_b), p_b' = p_t (linear_b + product_b p_n)
        self._slopes = (
            k_0, xi_0, (b1 - a1) * c_n * c_b, -lift * k_0, -b1 * c_t * c_b, lift * xi_0,
            a1 * c_t * c_n,
        )  # fmt: skip
        moment = np.maximum(np.abs(f_n), np.abs(f_b)).max(axis=-1, keepdims=True)
        self._per_moment = 1.0 / np.maximum(moment, 1e-300)
        # Small enough to see that derivatives, which are imaginary parts, have settled as well.
        self._tolerance = DERIVATIVE_TOLERANCE if np.iscomplexobj(self.force) else TOLERANCE

    def sweep(self, piece: Piece, start: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return p (3, ..., points) in ``piece``, ``start`` (3, ...) at its tip end.

        Also, for each arm, its last change over the largest moment in it and the number of its
        sweeps. Each sweep takes the newest components (Gauss-Seidel), which halves their number.

        Raises:
            ConvergenceError: if an arm does not settle.
        """
        k_0, xi_0, product_t, linear_n, product_n, linear_b, product_b = (
            np.ascontiguousarray(values[..., piece.points]) for values in self._slopes
        )
        arms = start.shape[1:]
        # Slopes carry the initial value in one more column, for the last row of the matrix.
        slope = np.empty((*start.shape, COLLOCATION_POINTS + 1), start.dtype)
        slope[..., -1] = start
        slope_t, slope_n, slope_b = slope[..., :-1]
        p = np.empty((*start.shape, COLLOCATION_POINTS), start.dtype)
        p[...] = slope[..., -1:]
        p_t, p_n, p_b = p
        turn = np.empty_like(p_t)
        # As `times` does, each product into its place; for one arm `dot` is quicker.
        product, row = (np.dot, ...) if p.ndim == 2 else (np.matmul, np.s_[..., np.newaxis, :])
        with_t, with_n, with_b = slope[row]
        to_t, to_n, to_b = p[row]
        integrate = piece.integrate
        found: tuple[FloatArray, FloatArray, IntArray] | None = None
        sweeps = 0
        while True:
            for left in range(_SWEEPS_BETWEEN_CHECKS, 0, -1):
                if left == 1:
                    previous = p.copy()
                np.multiply(product_t, p_b, out=slope_t)
                slope_t += k_0
                slope_t *= p_n
                slope_t -= np.multiply(xi_0, p_b, out=turn)
                product(with_t, integrate, out=to_t)
                np.multiply(product_n, p_b, out=slope_n)
                slope_n += linear_n
                slope_n *= p_t
                np.multiply(product_b, p_n, out=slope_b)
                slope_b += linear_b
                slope_b *= p_t
                product(with_n, integrate, out=to_n)
                product(with_b, integrate, out=to_b)
            sweeps += _SWEEPS_BETWEEN_CHECKS
            previous -= p
            change = (np.abs(previous) * self._per_moment).max(axis=(0, -1))
            now = change <= self._tolerance  # which NaN is not
            if now.all() and found is None:
                return p, change, np.full(arms, sweeps)
            if now.any():
                # An arm that has settled stays as it is, and so comes out the same whatever the
                # others take.
                if found is None:
                    found = p.copy(), change.copy(), np.full(arms, sweeps)
                    settled = np.zeros(arms, np.bool_)
                now &= ~settled
                np.copyto(found[0], p, where=now[..., np.newaxis])
                np.copyto(found[1], change, where=now)
                np.copyto(found[2], sweeps, where=now)
                settled |= now
                if settled.all():
                    return found
            if sweeps >= MAX_SWEEPS:
                worst = float(change.max())
                raise ConvergenceError(f'equation (10) in section {piece.section}', worst, sweeps)
