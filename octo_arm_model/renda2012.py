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
1963), instead of marching in small steps.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np

from octo_arm_model.arm import Arm
from octo_arm_model.body import Body
from octo_arm_model.chebyshev import barycentric_matrix, chebyshev_integration
from octo_arm_model.cross_section import Stiffness, twist_of
from octo_arm_model.errors import ConfigError, ConvergenceError
from octo_arm_model.grid import panels_of
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.imbalance import COLLOCATION_POINTS, Coefficients, Piece
from octo_arm_model.profiles import Profile
from octo_arm_model.statics import Solution
from octo_arm_model.tendon import Section
from octo_arm_model.tendons import TendonWeights

_POINTS, _INTEGRALS = chebyshev_integration(COLLOCATION_POINTS)
# Sweeping a whole panel at once is quickest, but where the arm turns far within one it diverges.
# Then each panel is cut into more pieces, one after the other.
PIECES = (1, 4, 16)


def papers_sections(arm: Arm) -> tuple[Section, ...]:
    """The sections of ``arm``, where the paper's equations cover it.

    Raises:
        ConfigError: if they do not; the message says what.
    """
    problem = ''
    if not isinstance(arm.body, Body):
        problem = 'a body whose radius is not linear in s (7)'
    material = (arm.material.youngs_modulus, arm.material.poisson_ratio)
    if any(isinstance(value, Profile) for value in material):
        problem = 'a material that varies along s (3)'
    sections = []
    for number, section in enumerate(arm.sections, start=1):
        if isinstance(section, Section) and section.is_papers:
            sections.append(section)
        else:
            problem = f'section {number}, whose tendons are not straight along n, b, -n, -b (5)'
    if problem:
        raise ConfigError(
            f"model is 'renda2012', which does not cover {problem}: choose exact or closed_form"
        )
    return tuple(sections)


class Renda2012:
    """Strains from tensions, from the tip to the base."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,).

        Raises:
            ConfigError: if the arm is not one the paper's equations cover.
        """
        papers_sections(arm)
        self._weights = TendonWeights(arm, nodes, section)
        self._stiffness = Stiffness.at(arm, nodes)
        self._march = functools.lru_cache(lambda pieces: _March(arm, nodes, section, pieces))
        self._march(PIECES[0])

    def solve(self, tensions: FloatArray) -> Solution:
        """Twist at every node under ``tensions`` (batch, tendons) [N].

        Raises:
            ConvergenceError: if equation (10) could not be integrated.
        """
        sums = self._weights.sums(tensions)
        imbalance = np.zeros((3, *sums.axial.shape), sums.axial.dtype)
        residual, sweeps = self._imbalance(tensions, imbalance)
        p_t, p_n, p_b = imbalance
        bending = self._stiffness.bending
        omega = np.empty((3, *sums.axial.shape), sums.axial.dtype)
        tau, xi, k = omega
        np.divide(p_t, self._stiffness.torsion + sums.second_n + sums.second_b, out=tau)
        np.divide(p_n - sums.first_b, bending + sums.second_b, out=xi)
        np.divide(p_b + sums.first_n, bending + sums.second_n, out=k)
        batch = len(tensions)
        twist = twist_of(omega, sums, self._stiffness)
        return Solution(twist, np.full(batch, residual), np.full(batch, sweeps))

    def _imbalance(self, tensions: FloatArray, imbalance: FloatArray) -> tuple[float, int]:
        """Fill in p (3, batch, nodes), zero at first, where it is not zero.

        Returns:
            Last relative change and number of sweeps, of the piece that took most.
        """
        for pieces in PIECES[:-1]:
            try:
                return self._march(pieces).imbalance(tensions, imbalance)
            except ConvergenceError:
                continue
        return self._march(PIECES[-1]).imbalance(tensions, imbalance)


class _March:
    """Goes from the tip to the base, piece by piece."""

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray, pieces: int) -> None:
        """Cut every panel into ``pieces`` and tabulate them."""
        # From the tip; where no tendon acts there is no moment and nothing to integrate.
        panels = [panel for panel in reversed(panels_of(arm)) if panel.section > 0]
        first_panel, *others = panels
        s = [np.array([first_panel.stop, first_panel.start])]
        numbers = [1, 1]
        self._pieces = []
        for panel in others:
            edges = np.linspace(panel.stop, panel.start, pieces + 1)
            for stop, start in itertools.pairwise(edges):
                length = stop - start
                is_base = start == panel.start
                inside = (section == panel.section) & (nodes <= stop)
                inside &= (nodes >= start) if is_base else (nodes > start)
                at_nodes = np.flatnonzero(inside)
                to_nodes = barycentric_matrix(_POINTS, (stop - nodes[at_nodes]) / length)
                # Integration runs towards the base, against s; the last row adds the start.
                integrate = np.vstack([-length * _INTEGRALS, np.ones(COLLOCATION_POINTS)])
                points = slice(len(numbers), len(numbers) + COLLOCATION_POINTS)
                is_anchorage = stop == panel.stop
                self._pieces.append(
                    Piece(panel.section, is_anchorage, points, integrate, at_nodes, to_nodes.T)
                )
                s.append(stop - length * _POINTS)
                numbers += [panel.section] * COLLOCATION_POINTS
        self._weights = TendonWeights(arm, np.concatenate(s), np.array(numbers))
        self._stiffness = Stiffness.at(arm, np.concatenate(s))
        self._offset = np.array([part.offset_anchorage for part in papers_sections(arm)])
        self._bending = Stiffness.at(
            arm, np.array([part.anchorage for part in arm.sections])
        ).bending

    def imbalance(self, tensions: FloatArray, imbalance: FloatArray) -> tuple[float, int]:
        """Fill in p (3, batch, nodes) below the first anchorage.

        Returns:
            Last relative change and number of sweeps, of the piece that took most.

        Raises:
            ConvergenceError: if the sweeps of a piece do not settle.
        """
        coefficients = Coefficients(self._weights.sums(tensions), self._stiffness)
        force, compliance = coefficients.force, coefficients.compliance
        added = self._added_curvature(tensions)
        # Nothing lies beyond the first anchorage: there (11) is the closed form, and p is zero.
        omega = compliance[..., 1] * force[..., 1]
        residual, sweeps = 0.0, 0
        for piece in self._pieces:
            first, last = piece.points.start, piece.points.stop - 1
            if piece.jump:
                omega += added[..., piece.section - 1]
            start = omega / compliance[..., first] - force[..., first]
            p, change, count = coefficients.sweep(piece, start)
            residual, sweeps = max(residual, change), max(sweeps, count)
            imbalance[..., piece.at_nodes] = p @ piece.to_nodes
            omega = compliance[..., last] * (force[..., last] + p[..., -1])
        return residual, sweeps

    def _added_curvature(self, tensions: FloatArray) -> FloatArray:
        """What (11) adds to omega at each anchorage, (3, batch, sections) [1/m]."""
        offset, bending = self._offset, self._bending
        by_section = tensions.reshape(len(tensions), -1, 4)
        t1, t2, t3, t4 = (by_section[..., j] for j in range(4))
        added = np.zeros((3, *t1.shape), t1.dtype)
        added[1] = offset * (t4 - t2) / (offset**2 * (t4 + t2) + bending)
        added[2] = offset * (t1 - t3) / (offset**2 * (t1 + t3) + bending)
        return added
