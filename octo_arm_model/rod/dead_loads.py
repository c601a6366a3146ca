"""Loads that are fixed in base_frame: the wrench that they put on every node."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads, ScaledLoads
from octo_arm_model.rod.elements import Elements


class DeadLoads:
    """Force and free moment of dead loads beyond every node, without the wrench on the tip.

    Attributes:
        has_moments: whether a point load has a moment, which has no energy.
    """

    def __init__(self, arm: Arm, elements: Elements, loads: Loads) -> None:
        """Tabulate the dead ones of ``loads`` on ``arm`` at the nodes of ``elements``."""
        self._fixed = self.tabulate(arm, elements, loads)
        self._scaled: ScaledLoads | None = loads.scaled
        parts = loads.scaled.loads if loads.scaled is not None else ()
        self._parts = [self.tabulate(arm, elements, part) for part in parts]
        points = [point for one in (loads, *parts) for point in one.points]
        self.has_moments = any(any(point.moment) for point in points)

    def at(self, factor: float, tip_wrench: FloatArray) -> FloatArray:
        """Force and free moment beyond every node, (2, N, 3) [N, N m], in base_frame.

        ``factor`` times the loads, and the ``tip_wrench`` (6,) on the tip.
        """
        total = self._fixed
        if self._scaled is not None:
            for magnitude, part in zip(self._scaled.magnitudes, self._parts, strict=True):
                total = total + magnitude * part
        return np.asarray(factor * total + tip_wrench.reshape(2, 1, 3))

    def tabulate(self, arm: Arm, elements: Elements, loads: Loads) -> FloatArray:
        """Force and free moment of other dead ``loads`` at the same nodes, as `at`, (2, N, 3)."""
        found = np.zeros((2, elements.s.size, 3))
        found[0] = elements.to_tip @ force_per_length(arm, elements.s, loads)
        for point in loads.points:
            # No node lies at a load; one at the base acts on no section.
            beyond = elements.s < point.s
            found[0, beyond] += point.force
            found[1, beyond] += point.moment
        return found


def force_per_length(arm: Arm, s: FloatArray, loads: Loads) -> FloatArray:
    """Weight, buoyancy and distributed ``loads`` on ``arm`` at ``s`` (n,) [m], (n, 3) [N/m].

    Raises:
        ArmDefinitionError: if gravity acts on an arm of no density.
    """
    if any(loads.gravity) and not arm.material.density:
        raise ArmDefinitionError(
            'material.density', 0.0, 'a density > 0 [kg/m^3] where there is gravity'
        )
    body = arm.body.geometry(s)
    weight = arm.material.density * body.area - loads.fluid_density * body.displaced
    if arm.discs.mass:
        weight = weight + arm.discs.mass / arm.discs.thickness * arm.discs.cover(s)
    density = weight[:, np.newaxis] * np.array(loads.gravity)
    for load in loads.distributed:
        inside = (s >= load.s[0]) & (s <= load.s[-1])
        density[inside] += load.at(s[inside]).T
    return density
