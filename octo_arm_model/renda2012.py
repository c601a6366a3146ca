"""The paper's model as published: equations (10), (11) and (12).

Equation (10) is integrated from the tip; at each anchorage (11) adds the curvature that the new
tendons would cause alone. Written with the imbalance p = K omega - M(omega) between the
section's and the tendons' moments, (10) is p' = omega x M with

    omega = C (F + p)    M = F - D omega    C = (K + D)^-1
    F = (0, beta, alpha)    D = diag(A1 + B1, B1, A1)    K = diag(GI, EJ, EJ)

p = 0 is the closed form, omega_0 = C F = (0, xi_0, k_0). Multiplied out, everything without p
cancels, and what is left is

    p_t' = k_0 p_n - xi_0 p_b + (B1 - A1) C_n C_b p_n p_b
    p_n' = -p_t (c k_0 + B1 C_t C_b p_b)
    p_b' = +p_t (c xi_0 + A1 C_t C_n p_n)        c = (EJ + A1 + B1) C_t

So p stays zero from the tip to the first anchorage where the jump makes it otherwise. It is
smooth between anchorages, so each panel is collocated at Chebyshev points and swept until it
settles, all points at once (Picard iteration with spectral quadrature, Clenshaw and Norton
1963), instead of marching.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm import TENDONS_PER_SECTION, Arm
from octo_arm_model.chebyshev import barycentric_matrix, chebyshev_integration
from octo_arm_model.cross_section import Stiffness, longitudinal_strain
from octo_arm_model.errors import ConvergenceError
from octo_arm_model.grid import panels_of
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.strains import Strains
from octo_arm_model.tendons import TendonSums, TendonWeights

COLLOCATION_POINTS = 20
_POINTS, _INTEGRALS = chebyshev_integration(COLLOCATION_POINTS)
# Sweeps stop when p changes by less than this part of the largest moment in the arm, which
# leaves an error ten times smaller as each sweep gains more than one digit by then. Looking
# costs as much as sweeping, so it is done after every few sweeps.
TOLERANCE = 5e-8
MAX_SWEEPS = 200
_SWEEPS_BETWEEN_CHECKS = 2


class Renda2012:
    """Strains from tensions, from the tip to the base."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        self._weights = TendonWeights(arm, nodes, section)
        self._stiffness = Stiffness.at(arm, nodes)
        # From the tip; where no tendon acts there is no moment and nothing to integrate.
        panels = [panel for panel in reversed(panels_of(arm)) if panel.section > 0]
        s = np.concatenate([panel.stop - panel.length * _POINTS for panel in panels])
        numbers = np.repeat([panel.section for panel in panels], COLLOCATION_POINTS)
        self._point_weights = TendonWeights(arm, s, numbers)
        self._point_stiffness = Stiffness.at(arm, s)
        self._offset = np.array([part.offset_anchorage for part in arm.sections])
        self._panels = []
        for panel in panels[1:]:
            at_nodes = np.flatnonzero(section == panel.section)
            to_nodes = barycentric_matrix(_POINTS, (panel.stop - nodes[at_nodes]) / panel.length)
            # Integration runs towards the base, against s; the last row adds the initial value.
            integrate = np.vstack([-panel.length * _INTEGRALS, np.ones(COLLOCATION_POINTS)])
            self._panels.append((panel.section, integrate, at_nodes, to_nodes.T))

    def strains(self, tensions: FloatArray) -> Strains:
        """Strains (batch, nodes) under ``tensions`` (batch, tendons) [N].

        Raises:
            ConvergenceError: if equation (10) could not be integrated.
        """
        sums = self._weights.sums(tensions)
        p_t, p_n, p_b = self._imbalance(tensions, np.zeros((3, *sums.axial.shape)))
        bending = self._stiffness.bending
        strains = Strains(np.empty((4, *sums.axial.shape)))
        tau, xi, k, q = strains.values
        np.divide(p_t, self._stiffness.torsion + sums.second_n + sums.second_b, out=tau)
        np.divide(p_n - sums.first_b, bending + sums.second_b, out=xi)
        np.divide(p_b + sums.first_n, bending + sums.second_n, out=k)
        q[:] = longitudinal_strain(sums, self._stiffness, xi, k)
        return strains

    def _imbalance(self, tensions: FloatArray, imbalance: FloatArray) -> FloatArray:
        """Fill in p (3, batch, nodes), zero at first, where it is not zero."""
        coefficients = _Coefficients(self._point_weights.sums(tensions), self._point_stiffness)
        added = self._added_curvature(tensions)
        # Nothing lies beyond the first anchorage: there (11) is the closed form, and p is zero.
        last = COLLOCATION_POINTS - 1
        omega = coefficients.compliance[..., last] * coefficients.force[..., last]
        for section, integrate, at_nodes, to_nodes in self._panels:
            first, last = last + 1, last + COLLOCATION_POINTS
            omega += added[..., section - 1]
            start = omega / coefficients.compliance[..., first] - coefficients.force[..., first]
            p = coefficients.sweep(slice(first, last + 1), start, integrate, section)
            imbalance[..., at_nodes] = p @ to_nodes
            total = coefficients.force[..., last] + p[..., -1]
            omega = coefficients.compliance[..., last] * total
        return imbalance

    def _added_curvature(self, tensions: FloatArray) -> FloatArray:
        """What (11) adds to omega at each anchorage, (3, batch, sections) [1/m]."""
        offset, bending = self._offset, self._point_stiffness.bending[::COLLOCATION_POINTS]
        by_section = tensions.reshape(len(tensions), -1, TENDONS_PER_SECTION)
        t1, t2, t3, t4 = (by_section[..., j] for j in range(TENDONS_PER_SECTION))
        added = np.zeros((3, *t1.shape))
        added[1] = offset * (t4 - t2) / (offset**2 * (t4 + t2) + bending)
        added[2] = offset * (t1 - t3) / (offset**2 * (t1 + t3) + bending)
        return added


class _Coefficients:
    """Everything in the equations of p but p itself, at the collocation points of all panels."""

    def __init__(self, sums: TendonSums, stiffness: Stiffness) -> None:
        """Prepare for ``sums`` (batch, points) and ``stiffness`` (points,)."""
        a1, b1 = sums.second_n, sums.second_b
        polar = a1 + b1
        self.force = np.zeros((3, *a1.shape))
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
        self._linear, self._product = np.empty((2, 2, *a1.shape))
        np.multiply(-lift, self._k_0, out=self._linear[0])
        np.multiply(lift, self._xi_0, out=self._linear[1])
        np.multiply(-b1 * c_t, c_b, out=self._product[0])
        np.multiply(a1 * c_t, c_n, out=self._product[1])
        self._product_t = (b1 - a1) * c_n * c_b
        self._tolerance = TOLERANCE * np.abs(self.force).max(axis=(0, 2))[:, np.newaxis]

    def sweep(
        self, points: slice, start: FloatArray, integrate: FloatArray, section: int
    ) -> FloatArray:
        """Return p (3, batch, points) in one panel, ``start`` (3, batch) at its tip end.

        Each sweep takes the newest components (Gauss-Seidel), which halves their number.
        """
        xi_0, k_0 = self._xi_0[:, points], self._k_0[:, points]
        linear, product = self._linear[..., points], self._product[..., points]
        product_t = self._product_t[:, points]
        # Slopes carry the initial value in one more column, for the last row of the matrix.
        slope = np.empty((*start.shape, COLLOCATION_POINTS + 1))
        slope[..., -1] = start
        slope_t, slope_nb = slope[0, :, :-1], slope[1:, :, :-1]
        p = np.empty((*start.shape, COLLOCATION_POINTS))
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
                return p
            if sweeps >= MAX_SWEEPS:
                worst = float((change / self._tolerance).max() * TOLERANCE)
                raise ConvergenceError(f'equation (10) in section {section}', worst, sweeps)
