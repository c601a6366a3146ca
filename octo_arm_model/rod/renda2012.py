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
converges, all points at once (Picard iteration with spectral quadrature, Clenshaw and Norton
1963), instead of marching in small steps.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.body import Body
from octo_arm_model.arm.errors import ConfigError, ConvergenceError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.profile import Profile
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.arm.tendon import Section
from octo_arm_model.rod.chebyshev import barycentric_matrix, chebyshev_integration
from octo_arm_model.rod.paper_balance import (
    Strains,
    added_curvature,
    curvatures,
    imbalance_of,
    twist_of,
)
from octo_arm_model.rod.picard import COLLOCATION_POINTS, Element, Sweeps
from octo_arm_model.rod.stations import panels_of
from octo_arm_model.rod.tendon_sums import TendonWeights, transmission
from octo_arm_model.rod.vectors import runs_of, times

_POINTS, _INTEGRALS = chebyshev_integration(COLLOCATION_POINTS)
# How tendons 1 to 4 of a section bend it about n and about b.
_BENDS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])
# A whole panel in one element is quickest, but where the arm turns far within it sweeps diverge.
# Then each panel is cut into more elements, one after the other.
ELEMENTS = (1, 4, 16)


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
    if arm.friction:
        problem = 'friction of the tendons'
    if problem:
        raise ConfigError(
            f"model is 'renda2012', which does not cover {problem}: choose exact or closed_form"
        )
    return tuple(sections)


class Renda2012:
    """Strains from tensions, from the tip to the base.

    Attributes:
        weights: from tensions to sums over the tendons at every node.
        stiffness: of the cross section at every node.
    """

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,).

        Raises:
            ConfigError: if the arm is not one the paper's equations cover.
        """
        papers_sections(arm)
        self.weights = TendonWeights(arm, nodes, section)
        self.stiffness = SectionStiffness.at(arm, nodes)
        integration = functools.partial(Integration, arm, nodes, section)
        self._integration = functools.lru_cache(integration)
        self._integration(ELEMENTS[0])

    def solve(self, tensions: FloatArray) -> Strains:
        """Twist at every node under ``tensions`` (..., tendons) [N].

        Raises:
            ConvergenceError: if equation (10) could not be integrated.
        """
        sums = self.weights.sums(tensions)
        p = np.zeros((3, *sums.axial.shape), sums.axial.dtype)
        residual, sweeps = self._imbalance(tensions, p)
        p_t, p_n, p_b = p
        _, torsion, bending = self.stiffness
        strains = curvatures(p_t, p_n, p_b, *sums[1:5], torsion, bending)
        return Strains(twist_of(*strains, sums, self.stiffness), residual, sweeps)

    @property
    def integration(self) -> Integration:
        """The integration over whole panels, which nearly all arms take."""
        return self._integration(ELEMENTS[0])

    def _imbalance(
        self, tensions: FloatArray, imbalance: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Fill in the imbalance p (3, ..., nodes) [N m], which is passed as zeros.

        Elements are refined, see `ELEMENTS`, where their sweeps do not converge.

        Returns:
            Last relative change and number of sweeps of each arm, the largest of its elements.

        Raises:
            ConvergenceError: if the finest elements do not converge either.
        """
        for elements in ELEMENTS[:-1]:
            try:
                return self._integration(elements).imbalance(tensions, imbalance)
            except ConvergenceError:
                if tensions.ndim == 1:
                    continue
                # Finer elements for those arms alone that need them.
                return self._one_by_one(tensions, imbalance)
        return self._integration(ELEMENTS[-1]).imbalance(tensions, imbalance)

    def _one_by_one(
        self, tensions: FloatArray, imbalance: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Call `_imbalance` for each arm of a batch.

        Raises:
            ConvergenceError: if one cannot be integrated.
        """
        residual, sweeps = np.zeros(len(tensions)), np.zeros(len(tensions), np.int64)
        for arm, one in enumerate(tensions):
            try:
                residual[arm], sweeps[arm] = self._imbalance(one, imbalance[:, arm])
            except ConvergenceError as error:
                error.in_batch([arm])
                raise
        return residual, sweeps


class Integration:
    """Integration of (10) from the tip to the base, element by element.

    Attributes:
        elements: from tip to base, without the panel that begins at the first anchorage, where p
            is zero.
        weights: from tensions to sums over the tendons at the points of all elements.
        stiffness: of the cross sections at these points.
        at_anchorages: matrix from tensions to first and second moments, along n and b, at every
            anchorage, of the tendons that end there, (tendons, 2 x 2 x sections).
        bending: bending stiffness at every anchorage [N m^2], (sections,).
    """

    def __init__(self, arm: Arm, nodes: FloatArray, section: IntArray, count: int) -> None:
        """Cut every panel into ``count`` elements and tabulate them."""
        # From the tip; where no tendon acts there is no moment and nothing to integrate.
        panels = [panel for panel in reversed(panels_of(arm)) if panel.section > 0]
        first_panel, *others = panels
        s = [np.array([first_panel.stop, first_panel.start])]
        numbers = [1, 1]
        self.elements = []
        for panel in others:
            edges = np.linspace(panel.stop, panel.start, count + 1)
            for stop, start in itertools.pairwise(edges):
                length = stop - start
                is_base = start == panel.start
                inside = (section == panel.section) & (nodes <= stop)
                inside &= (nodes >= start) if is_base else (nodes > start)
                to_nodes = [
                    (run, barycentric_matrix(_POINTS, (stop - nodes[run]) / length).T)
                    for run in runs_of(inside)
                ]
                integrate = -length * _INTEGRALS  # towards the base, against s
                points = slice(len(numbers), len(numbers) + COLLOCATION_POINTS)
                is_anchorage = stop == panel.stop
                self.elements.append(
                    Element(panel.section, is_anchorage, points, integrate, to_nodes)
                )
                s.append(stop - length * _POINTS)
                numbers += [panel.section] * COLLOCATION_POINTS
        self.weights = TendonWeights(arm, np.concatenate(s), np.array(numbers))
        self.stiffness = SectionStiffness.at(arm, np.concatenate(s))
        # From tensions to b (T4 - T2) and b (T1 - T3), b^2 (T4 + T2) and b^2 (T1 + T3) by section.
        sections = len(arm.sections)
        at_anchorages = np.zeros((sections, 4, 2, 2, sections))
        anchorages = np.array([part.anchorage for part in arm.sections])
        arrives = transmission(arm, anchorages, np.arange(1, sections + 1))
        arrives = arrives.reshape(sections, 4, sections)
        for i, part in enumerate(papers_sections(arm)):
            levers = part.offset_anchorage * _BENDS
            at_anchorages[i, :, 0, :, i] = arrives[i, :, i, np.newaxis] * levers
            at_anchorages[i, :, 1, :, i] = arrives[i, :, i, np.newaxis] * levers**2
        self.at_anchorages = at_anchorages.reshape(4 * sections, -1)
        self.bending = SectionStiffness.at(arm, anchorages).bending

    def imbalance(
        self, tensions: FloatArray, imbalance: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Fill in the imbalance p (3, ..., nodes) [N m] between the base and the first anchorage.

        Returns:
            Last relative change and number of sweeps of each arm, the largest of its elements.

        Raises:
            ConvergenceError: if the sweeps of an element do not converge.
        """
        sums = self.weights.sums(tensions)
        sweeps_of = Sweeps(sums, self.stiffness)
        # Arguments of `curvatures` and `imbalance_of` at each point.
        _, torsion, bending = self.stiffness
        at_points = [values.T for values in (*sums[1:5], torsion, bending)]
        added = self._added_curvature(tensions)
        # Nothing lies beyond the first anchorage: there (11) is the closed form, and p is zero.
        tau, xi, k = curvatures(0.0, 0.0, 0.0, *(values[1] for values in at_points))
        residual, sweeps = np.zeros(xi.shape), np.zeros(xi.shape, np.int64)
        for element in self.elements:
            first, last = element.points.start, element.points.stop - 1
            if element.jump:
                xi, k = (xi, k) + added[element.section - 1]
            start = imbalance_of(tau, xi, k, *(values[first] for values in at_points))
            p, change, count = sweeps_of.sweep(element, np.array(start))
            residual, sweeps = np.maximum(residual, change), np.maximum(sweeps, count)
            for run, matrix in element.to_nodes:
                imbalance[..., run] = times(p, matrix)
            tau, xi, k = curvatures(*p[..., -1], *(values[last] for values in at_points))
        return residual, sweeps

    def _added_curvature(self, tensions: FloatArray) -> FloatArray:
        """What (11) adds to xi and k at each anchorage, (sections, 2, ...) [1/m]."""
        sums = times(tensions, self.at_anchorages).reshape(*tensions.shape[:-1], 2, 2, -1)
        return added_curvature(sums[..., 0, :, :], sums[..., 1, :, :], self.bending).T
