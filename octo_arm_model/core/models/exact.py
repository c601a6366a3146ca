"""Beyond the paper: no small-stretch approximation, and a choice of elastic laws.

Without loads the steady state minimises the energy of every cross section by itself (`sectional`).
Strains are smooth between anchorages, so they are found at Chebyshev points and interpolated to
the nodes; where that does not resolve them (a tabulated profile, say) they are found at all nodes.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.numerics.chebyshev import (
    barycentric_matrix,
    chebyshev_integration,
    tail_matrix,
)
from octo_arm_model.core.rod.grid import panels_of
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.section.elastic_laws import Law
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import Minimum, can_be, initial_strain, minimise

POINTS = 20  # in each panel
# Interpolation is trusted where the last Chebyshev coefficients are below this part of the values.
RESOLVED = 1e-9
SHORTEST_FIBRE = 0.02  # of its reference length


class Exact:
    """Strains from tensions, cross section by cross section."""

    def __init__(
        self, arm: Arm, nodes: FloatArray, section: IntArray, law: Law, shear: bool = False
    ) -> None:
        """Tabulate ``arm`` at ``nodes`` (n,), each in its ``section`` (n,)."""
        self._make = functools.partial(SectionEnergy, arm, law=law, shear=shear)
        self._nodes, self._section = nodes, section
        points, _ = chebyshev_integration(POINTS)
        s, numbers, self._spans = [], [], []
        for panel in panels_of(arm):
            # Where no tendon acts nothing happens.
            if panel.section > 0:
                inside = (
                    (section == panel.section) & (nodes >= panel.start) & (nodes <= panel.stop)
                )
                at_nodes = np.flatnonzero(inside)
                targets = (nodes[at_nodes] - panel.start) / panel.length
                self._spans.append((at_nodes, barycentric_matrix(points, targets).T.copy()))
                s.append(panel.start + panel.length * points)
                numbers += [panel.section] * POINTS
        self._at_points = self._make(np.concatenate(s), np.array(numbers))
        self._tail = tail_matrix(POINTS)

    @functools.cached_property
    def at_nodes(self) -> SectionEnergy:
        """Cross sections at the nodes."""
        return self._make(self._nodes, self._section)

    def solve(self, tensions: FloatArray) -> Solution:
        """Twist at every node under ``tensions`` (batch, tendons) [N].

        Raises:
            ConvergenceError: if a cross section finds no balance.
        """
        energy = self._at_points
        local_tensions = energy.local_tensions(tensions)
        found = minimise(energy, local_tensions, initial_strain(energy, local_tensions))
        check_fibres(energy, found.strain)
        coarse = to_twist(energy.law, found.strain)
        # Deviations are interpolated, so that an arm without tensions stays exactly as it was.
        coarse[3] -= 1.0
        twist = np.zeros((energy.strains, len(tensions), self._nodes.size))
        by_panel = coarse.reshape(*coarse.shape[:2], -1, POINTS)
        tail = np.abs(by_panel @ self._tail).max(axis=(1, 2, 3))
        size = np.abs(coarse).max(axis=(1, 2))
        angular = size[:3].max()
        size[:3] = angular
        for panel, (at_nodes, to_nodes) in enumerate(self._spans):
            twist[..., at_nodes] = by_panel[:, :, panel] @ to_nodes
        twist[3] += 1.0
        if (tail > RESOLVED * size).any():
            return self._refine(tensions, twist, found)
        return Solution(twist, found.residual, np.full(len(tensions), found.iterations))

    def _refine(self, tensions: FloatArray, twist: FloatArray, coarse: Minimum) -> Solution:
        """From nearly right strains at the nodes to right ones."""
        energy = self.at_nodes
        local_tensions = energy.local_tensions(tensions)
        start = to_scaled(energy.law, twist)
        # Where the strain has a peak between the points, what is interpolated can turn a section
        # inside out, which has no energy to descend from.
        outside = ~can_be(energy, start[3], np.sqrt(start[1] ** 2 + start[2] ** 2))
        if np.count_nonzero(outside):
            start = np.where(outside, initial_strain(energy, local_tensions), start)
        found = minimise(energy, local_tensions, start)
        iterations = coarse.iterations + found.iterations
        return Solution(
            to_twist(energy.law, found.strain), found.residual, np.full(len(tensions), iterations)
        )


def check_fibres(energy: SectionEnergy, strain: FloatArray) -> None:
    """Refuse scaled ``strain`` that compresses a fibre to (next to) nothing.

    The elastic laws that widen resist that without end, which no material does.

    Raises:
        SolveError: if it does; the message says where.
    """
    if not energy.law.widens:
        return
    bend = np.sqrt(strain[1] * strain[1] + strain[2] * strain[2])
    shortest = strain[3] - energy.radius * bend
    if not shortest.min(initial=1.0) > SHORTEST_FIBRE:
        number, node = np.unravel_index(np.argmin(shortest), shortest.shape)
        raise SolveError(
            f'tensions compress a fibre of the arm to nothing at s = {energy.s[node]:.4g} m (to '
            f'{shortest[number, node]:.2g} of its length, must be > {SHORTEST_FIBRE})',
            int(number),
        )


def to_twist(law: Law, strain: FloatArray) -> FloatArray:
    """Twist of the frame (n, batch, nodes) from the scaled strain; see `sectional`."""
    if not law.widens:
        return strain
    twist = strain.copy()
    twist[:3] /= law.widening(strain[3])[0]
    return twist


def to_scaled(law: Law, twist: FloatArray) -> FloatArray:
    """Scaled strain (n, batch, nodes) from the twist of the frame."""
    if not law.widens:
        return twist
    strain = twist.copy()
    strain[:3] *= law.widening(twist[3])[0]
    return strain
