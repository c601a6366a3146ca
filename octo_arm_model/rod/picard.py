"""The imbalance p of the paper's model between two anchorages; `renda2012` has its equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray, Number
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod.tendon_sums import TendonSums

COLLOCATION_POINTS = 20
# Sweeps stop when p changes by less than this part of the largest moment in the arm, which
# leaves an error ten times smaller as each sweep gains more than one digit by then. A check
# costs as much as a sweep, so it is made after every few.
TOLERANCE = 5e-8
DERIVATIVE_TOLERANCE = 1e-13
MAX_SWEEPS = 60
SWEEPS_BETWEEN_CHECKS = 2


@dataclass(frozen=True)
class Element:
    """Part of a panel, between two anchorages or loads, with collocation points of its own.

    Attributes:
        section: number of its section from the tip.
        jump: whether it begins at the anchorage of that section.
        points: range of its points among those of all elements.
        integrate: matrix from slopes to values less the initial one, (points, points).
        to_nodes: ranges of nodes that lie in it, each with the matrix from its points to those.
    """

    section: int
    jump: bool
    points: slice
    integrate: FloatArray
    to_nodes: list[tuple[slice, FloatArray]]


def slope_coefficients(
    first_n: Number, first_b: Number, second_n: Number, second_b: Number,
    torsion: Number, bending: Number,
) -> tuple[Number, ...]:  # fmt: skip
    """Coefficients of p', which do not depend on p; see `renda2012`.

    From first and second moments of the tendons, torsional and bending stiffness.

    Returns:
        xi_0, k_0 and the product for `slope_along`, then the linear coefficients for `slope_aside`
        of p_n and of p_b, then its products for p_n and for p_b.
    """
    polar = second_n + second_b
    c_t, c_n, c_b = 1.0 / (torsion + polar), 1.0 / (bending + second_b), 1.0 / (bending + second_n)
    xi_0, k_0 = -c_n * first_b, c_b * first_n
    lift = (bending + polar) * c_t
    return (
        xi_0, k_0, (second_b - second_n) * c_n * c_b,
        -lift * k_0, lift * xi_0, -second_b * c_t * c_b, second_n * c_t * c_n,
    )  # fmt: skip


def slope_along(p_n: Number, p_b: Number, xi_0: Number, k_0: Number, product: Number) -> Number:
    """p_t' [N], from p_n and p_b [N m]."""
    return (product * p_b + k_0) * p_n - xi_0 * p_b


def slope_aside(p_t: Number, other: Number, linear: Number, product: Number) -> Number:
    """p_n' [N], from p_t and, as the ``other``, p_b; or p_b' from p_t and p_n."""
    return (product * other + linear) * p_t


class Sweeps:
    """Picard iteration for p in one element after another."""

    def __init__(self, sums: TendonSums, stiffness: SectionStiffness) -> None:
        """Prepare for ``sums`` (..., points) and ``stiffness`` (points,) at all points."""
        n, b = sums.first_n, sums.first_b
        self._coefficients = np.array(
            slope_coefficients(
                n, b, sums.second_n, sums.second_b, stiffness.torsion, stiffness.bending
            )
        )
        moment = np.maximum(np.abs(n), np.abs(b)).max(axis=-1, keepdims=True)
        self._per_moment = 1.0 / np.maximum(moment, 1e-300)
        # Small enough that derivatives, which are imaginary parts, have converged as well.
        self._tolerance = DERIVATIVE_TOLERANCE if np.iscomplexobj(n) else TOLERANCE

    def sweep(
        self, element: Element, start: FloatArray
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Solve for p in an ``element``, from its value ``start`` (3, ...) at the end to the tip.

        Each sweep uses the newest components (Gauss-Seidel), which halves the number of sweeps.

        Returns:
            p (3, ..., points) [N m] and, for each arm, its last change over the largest moment in
            the arm and the number of sweeps.

        Raises:
            ConvergenceError: if an arm does not converge.
        """
        xi_0, k_0, product_t, linear_n, linear_b, product_n, product_b = np.ascontiguousarray(
            self._coefficients[..., element.points]
        )
        arms = start.shape[1:]
        start = np.repeat(start[..., np.newaxis], COLLOCATION_POINTS, axis=-1)
        p = start.copy()
        (p_t, p_n, p_b), aside = p, p[1:]
        start_t, start_aside = start[0], start[1:]
        # Products as by `times`, but written into p; for one arm `dot` is quicker.
        product, row = (np.dot, ()) if p.ndim == 2 else (np.matmul, np.s_[..., np.newaxis, :])
        to_t, to_n, to_b = p[row]
        integrate = element.integrate
        found: tuple[FloatArray, FloatArray, IntArray] | None = None
        sweeps = 0
        while True:
            for left in range(SWEEPS_BETWEEN_CHECKS, 0, -1):
                if left == 1:
                    previous = p.copy()
                slope = slope_along(p_n, p_b, xi_0, k_0, product_t)
                product(slope[row], integrate, to_t)
                p_t += start_t
                slope_n = slope_aside(p_t, p_b, linear_n, product_n)
                slope_b = slope_aside(p_t, p_n, linear_b, product_b)
                product(slope_n[row], integrate, to_n)
                product(slope_b[row], integrate, to_b)
                aside += start_aside
            sweeps += SWEEPS_BETWEEN_CHECKS
            previous -= p
            change = (np.abs(previous) * self._per_moment).max(axis=(0, -1))
            now = change <= self._tolerance  # which NaN is not
            if now.all() and found is None:
                return p, change, np.full(arms, sweeps)
            if now.any():
                # A converged arm is not swept further, so that it does not depend on the others.
                if found is None:
                    found = p.copy(), change.copy(), np.full(arms, sweeps)
                    converged = np.zeros(arms, np.bool_)
                now &= ~converged
                np.copyto(found[0], p, where=now[..., np.newaxis])
                np.copyto(found[1], change, where=now)
                np.copyto(found[2], sweeps, where=now)
                converged |= now
                if converged.all():
                    return found
            if sweeps >= MAX_SWEEPS:
                worst = float(change.max())
                raise ConvergenceError(
                    f'equation (10) in section {element.section}', worst, sweeps
                )
