"""Loads tabulated at collocation points: the wrench they put on every cross section."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import Loads
from octo_arm_model.core.errors import ArmDefinitionError
from octo_arm_model.core.loaded.collocation import Collocation


class LoadTable:
    """The loads on an arm at the points of a `Collocation`.

    All of them are dead: fixed in base_frame, so that the resultant force does not depend on the
    shape, and the moment m of it follows m' = n x u'.

    Attributes:
        force: resultant n of everything beyond each point but the tip's wrench [N], (3, points).
        moment: sum of the moments of point loads beyond each point [N m], (3, points).
        is_empty: whether there is nothing.
        has_moments: whether a point load has a moment.
    """

    def __init__(self, arm: Arm, collocation: Collocation, loads: Loads) -> None:
        """Tabulate ``loads``.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
        """
        if any(loads.gravity) and not arm.material.density:
            raise ArmDefinitionError(
                'material.density', 0.0, 'a density > 0 [kg/m^3] where there is gravity'
            )
        s = collocation.s
        area = np.pi * arm.body.radius(s) ** 2
        weight = (arm.material.density - loads.fluid_density) * area
        density = np.array(loads.gravity)[:, np.newaxis] * weight
        for load in loads.distributed:
            inside = (s >= load.s[0]) & (s <= load.s[-1])
            density[:, inside] += load.at(s[inside])
        self.force = collocation.integrate_from_tip(density)
        self.moment = np.zeros_like(self.force)
        for point in loads.points:
            # No point of an element lies at a load; one at the base is felt by nothing.
            beyond = s < point.s
            self.force[:, beyond] += np.array(point.force)[:, np.newaxis]
            self.moment[:, beyond] += np.array(point.moment)[:, np.newaxis]
        self.has_moments = any(any(point.moment) for point in loads.points)
        self.is_empty = not (density.any() or any(point.s > 0.0 for point in loads.points))
