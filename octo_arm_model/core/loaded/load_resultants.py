"""Loads tabulated at the nodes of a grid, and the wrench they put on every cross section."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ArmDefinitionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.vectors import cross
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.quadrature import integrate_from_tip


class LoadTable:
    """The loads on an arm at the nodes of a grid.

    Attributes:
        force: resultant of everything beyond each node but the tip's wrench [N], (3, nodes).
        is_empty: whether there is nothing.
        has_moments: whether a point load has a moment.
    """

    def __init__(self, arm: Arm, grid: StationGrid, loads: Loads) -> None:
        """Tabulate ``loads``.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
        """
        if any(loads.gravity) and not arm.material.density:
            raise ArmDefinitionError(
                'material.density', 0.0, 'a density > 0 [kg/m^3] where there is gravity'
            )
        self._grid = grid
        start = np.array([panel.start for panel in grid.panels])[grid.node_panel]
        stop = np.array([panel.stop for panel in grid.panels])[grid.node_panel]
        area = np.pi * arm.body.radius(grid.nodes) ** 2
        weight = (arm.material.density - loads.fluid_density) * area
        self._density = np.array(loads.gravity)[:, np.newaxis] * weight
        for load in loads.distributed:
            inside = (start >= load.s[0]) & (stop <= load.s[-1])
            self._density[:, inside] += load.at(grid.nodes[inside])
        self.force = integrate_from_tip(self._density, grid)
        ends = grid.nodes[: grid.step.size + 1]
        self._points = []
        for point in loads.points:
            # On the side of the base; a load at the base itself is felt by nothing.
            beyond = stop <= point.s if point.s > 0.0 else np.zeros(stop.size, bool)
            self.force[:, beyond] += np.array(point.force)[:, np.newaxis]
            node = int(np.abs(ends - point.s).argmin())
            self._points.append((node, beyond, np.array(point.force), np.array(point.moment)))
        self.has_moments = any(any(point.moment) for point in loads.points)
        self.is_empty = not (self._density.any() or loads.points)

    def moment(
        self, position: FloatArray, force: FloatArray, tip_wrench: FloatArray, factor: float
    ) -> FloatArray:
        """Moment of everything beyond each node about it [N m], (3, nodes).

        For nodes at ``position`` (3, nodes), ``force`` (3, nodes) beyond them, the tip's wrench
        and ``factor`` times the other loads. Written with the moment about the origin, which
        point forces carry exactly.
        """
        tip = position[:, self._grid.step.size]
        about_origin = integrate_from_tip(cross(position, self._density), self._grid)
        for node, beyond, point_force, point_moment in self._points:
            moment = np.cross(position[:, node], point_force) + point_moment
            about_origin[:, beyond] += moment[:, np.newaxis]
        about_origin *= factor
        about_origin += (np.cross(tip, tip_wrench[:3]) + tip_wrench[3:])[:, np.newaxis]
        return about_origin - cross(position, force)
