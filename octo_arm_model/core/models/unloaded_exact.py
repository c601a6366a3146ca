"""Arms without loads by the model `exact`: the energy of every cross section by itself is least.

Strains are smooth between anchorages, so they are found at Chebyshev points and interpolated to
the nodes. They are found at the nodes themselves in panels where their Chebyshev coefficients do
not decay, or where the description of the arm (a tabulated profile, say) differs at the nodes from
its interpolation from the points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.statics import Setup
from octo_arm_model.core.numerics.chebyshev import (
    barycentric_matrix,
    chebyshev_integration,
    tail_matrix,
)
from octo_arm_model.core.rod.grid import Panel, panels_of
from octo_arm_model.core.rod.solution import Solution
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import can_be, initial_strain, minimise
from octo_arm_model.core.section.sheaths.sheath import sections_of
from octo_arm_model.core.section.strain_measures import check_fibres, to_scaled, to_twist

# Points in each panel, and in each where sheaths are compliant: strains are then less smooth.
_POINTS, _IN_SHEATHS = 20, 24
# Interpolation is trusted where the last Chebyshev coefficients are below this part of the values.
RESOLVED = 1e-9


class PanelNodes(NamedTuple):
    """The nodes in a panel.

    Attributes:
        numbers: of the nodes, (n,).
        from_points: matrix from the points of the panel to them, (points, n).
    """

    numbers: IntArray
    from_points: FloatArray


class UnloadedExact:
    """Strains from tensions.

    Attributes:
        at_points: cross sections at the Chebyshev points of all panels in which tendons act.
        panels: the nodes in each of these panels.
        uneven: whether interpolation from its points misses the arm at its nodes, for each of
            these panels, (panels,).
        tail: matrix from values at the points of a panel to their last two Chebyshev coefficients,
            (points, 2).
    """

    def __init__(self, setup: Setup) -> None:
        """Tabulate the arm."""
        self._setup = setup
        each = _IN_SHEATHS if setup.arm.sheath_stiffness else _POINTS
        points, _ = chebyshev_integration(each)
        # Where no tendon acts the section stays as it is.
        panels = [panel for panel in panels_of(setup.arm) if panel.section > 0]
        self.panels = [_nodes_of(setup, panel, points) for panel in panels]
        s = np.concatenate([panel.start + panel.length * points for panel in panels])
        self.at_points = self._sections_at(s, np.repeat([panel.section for panel in panels], each))
        self._at_nodes: dict[int, SectionEnergy] = {}
        self.tail, self._each, count = tail_matrix(each), each, setup.grid.nodes.size
        # From the points of each panel to its nodes, the last two Chebyshev coefficients, and zero
        # for nodes that no tendon reaches.
        most = max(nodes.numbers.size for nodes in self.panels)
        self._from_points = np.zeros((len(self.panels), each, most + 3))
        self._from_points[:, :, -3:-1] = self.tail
        self._columns = np.full(count, most + 2)
        for panel, (numbers, from_points) in enumerate(self.panels):
            self._from_points[panel, :, : numbers.size] = from_points
            self._columns[numbers] = panel * (most + 3) + np.arange(numbers.size)
        described = _described(setup.arm, s), _described(setup.arm, setup.grid.nodes)
        self.uneven = np.array([
            _misses(described[0][:, panel * each : (panel + 1) * each], described[1], nodes)
            for panel, nodes in enumerate(self.panels)
        ], bool)  # fmt: skip

    def _sections_at(self, s: FloatArray, section: IntArray) -> SectionEnergy:
        return sections_of(self._setup.arm, s, section, self._setup.law, self._setup.shear)

    def solve(self, tensions: FloatArray) -> Solution:
        """Twist at every node under ``tensions`` (batch, tendons) [N].

        Raises:
            ConvergenceError: if a cross section finds no balance.
            SolveError: if there is none that can be trusted.
        """
        energy, local_tensions = self.at_points.pulled(tensions)
        found = minimise(energy, local_tensions, initial_strain(energy, local_tensions))
        check_fibres(energy, found.strain)
        energy.check_tendons(found.strain, local_tensions)
        energy.check_stable(found.strain, local_tensions)
        coarse = to_twist(energy.law, found.strain)
        # Deviations are interpolated, so that an arm without tensions stays exactly as it was.
        coarse[3] -= 1.0
        count, panels = len(tensions), len(self.panels)
        # In products of all strains of one arm, or of each of many arms, which BLAS does not share
        # among threads: see `Setup.batch`.
        rows = count if count > 1 else energy.strains
        by_panel = coarse.reshape(-1, rows, panels, self._each)
        interpolated = np.empty((*by_panel.shape[:-1], self._from_points.shape[-1]))
        np.matmul(by_panel.swapaxes(1, 2), self._from_points, out=interpolated.swapaxes(1, 2))
        twist = interpolated.reshape(energy.strains, count, -1).take(self._columns, axis=-1)
        twist[3] += 1.0
        residual, iterations = found.residual, np.full(count, found.iterations)
        tail = np.abs(interpolated[..., -3:-1]).reshape(energy.strains, count, panels, 2)
        size = np.maximum.reduce(np.abs(coarse), axis=2)
        size[:3] = np.maximum.reduce(size[:3])
        exceeds = tail > RESOLVED * size[:, :, np.newaxis, np.newaxis]
        if np.count_nonzero(exceeds) or np.count_nonzero(self.uneven):
            unresolved = exceeds.any(axis=(0, 3)) | self.uneven
            residual = residual.copy()
            for panel in np.flatnonzero(unresolved.any(axis=0)).tolist():
                arms = np.flatnonzero(unresolved[:, panel])
                self._refine(panel, arms, tensions, twist, residual, iterations)
        return Solution(twist, residual, iterations)

    def _refine(
        self, panel: int, arms: IntArray, tensions: FloatArray, twist: FloatArray,
        residual: FloatArray, iterations: IntArray,
    ) -> None:  # fmt: skip
        """Minimise at the nodes of a ``panel`` of the ``arms``, from the interpolated strains.

        Updates ``twist``, ``residual`` and ``iterations`` of these arms.

        Raises:
            SolveError: as `solve`.
        """
        setup, nodes = self._setup, self.panels[panel].numbers
        if panel not in self._at_nodes:
            self._at_nodes[panel] = self._sections_at(
                setup.grid.nodes[nodes], setup.grid.node_section[nodes]
            )
        energy, local_tensions = self._at_nodes[panel].pulled(tensions[arms])
        at = np.ix_(np.arange(energy.strains), arms, nodes)
        start = to_scaled(energy.law, twist[at])
        # Where the strain has a peak between the points, what is interpolated can turn a section
        # inside out, which has no energy to descend from.
        outside = ~can_be(energy, start[3], np.sqrt(start[1] ** 2 + start[2] ** 2))
        if np.count_nonzero(outside):
            start = np.where(outside, initial_strain(energy, local_tensions), start)
        try:
            found = minimise(energy, local_tensions, start)
            check_fibres(energy, found.strain)
        except SolveError as error:
            if error.number is not None:
                error.number = int(arms[error.number])
            raise
        twist[at] = to_twist(energy.law, found.strain)
        residual[arms] = np.maximum(residual[arms], found.residual)
        iterations[arms] += found.iterations


def _nodes_of(setup: Setup, panel: Panel, points: FloatArray) -> PanelNodes:
    """The nodes in a ``panel``, and the interpolation to them from its ``points`` (0 to 1)."""
    nodes, section = setup.grid.nodes, setup.grid.node_section
    inside = (section == panel.section) & (nodes >= panel.start) & (nodes <= panel.stop)
    numbers = np.flatnonzero(inside)
    targets = (nodes[numbers] - panel.start) / panel.length
    return PanelNodes(numbers, barycentric_matrix(points, targets).T.copy())


def _described(arm: Arm, s: FloatArray) -> FloatArray:
    """Radius, moduli and tendon offsets of ``arm`` at ``s`` (n,), each over its largest value.

    Returns:
        (rows, n) [-].
    """
    material, offsets = arm.material, np.concatenate(arm.tendon_offsets(s))
    radius, young, shear = (
        of(s) for of in (arm.body.radius, material.youngs_modulus_at, material.shear_modulus_at)
    )
    scaled = [row / np.abs(row).max() for row in (radius, young, shear)]
    return np.vstack([*scaled, offsets / max(float(np.abs(offsets).max()), 1e-300)])


def _misses(at_points: FloatArray, at_nodes: FloatArray, nodes: PanelNodes) -> bool:
    """Whether interpolation of `_described` values ``at_points`` misses those ``at_nodes``.

    Of one panel with its ``nodes``; ``at_nodes`` are those of the whole grid.
    """
    missed = at_points @ nodes.from_points - at_nodes[:, nodes.numbers]
    return bool((np.abs(missed) > RESOLVED).any())
