"""The wrench that loads put on every cross section, at collocation points."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.arm.loads import DeformedRod, Loads, Resultants, Tangent
from octo_arm_model.core.errors import ArmDefinitionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.loaded.kinematics import frames, matrix_of
from octo_arm_model.core.loaded.loading.load_tangents import RodPoints
from octo_arm_model.core.numerics.quaternion import Quaternions


def force_per_length(arm: Arm, s: FloatArray, loads: Loads) -> FloatArray:
    """Weight, buoyancy and distributed ``loads`` on ``arm`` at ``s`` (n,), (3, n) [N/m].

    Raises:
        ArmDefinitionError: if gravity acts on an arm of no density.
    """
    if any(loads.gravity) and not arm.material.density:
        raise ArmDefinitionError(
            'material.density', 0.0, 'a density > 0 [kg/m^3] where there is gravity'
        )
    area = np.pi * arm.body.radius(s) ** 2
    weight = (arm.material.density - loads.fluid_density) * area
    density = np.array(loads.gravity)[:, np.newaxis] * weight
    for load in loads.distributed:
        inside = (s >= load.s[0]) & (s <= load.s[-1])
        density[:, inside] += load.at(s[inside])
    return density


def dead_resultants(arm: Arm, rod: Collocation | DeformedRod, loads: Loads) -> Resultants:
    """Resultants of the dead ``loads`` on ``arm``, which are fixed in base_frame.

    On the cross sections at the points of ``rod``; without the wrench on the tip.

    Raises:
        ArmDefinitionError: if gravity acts on an arm of no density.
    """
    s = rod.s
    force = rod.integrate_from_tip(force_per_length(arm, s, loads))
    moment = np.zeros_like(force)
    for point in loads.points:
        # No point of an element lies at a load; one at the base acts on no section.
        beyond = s < point.s
        force[:, beyond] += np.array(point.force)[:, np.newaxis]
        moment[:, beyond] += np.array(point.moment)[:, np.newaxis]
    return Resultants(force, moment)


class LoadTable:
    """The loads on an arm at the points of a `Collocation`.

    Dead loads are tabulated once. The moment m of a force n follows m' = n x u'.

    Attributes:
        scaled: dead loads whose magnitudes change, if there are any.
        others: loads of other kinds.
        is_empty: whether there are no loads but the tendons and the wrench on the tip.
        has_moments: whether a point load has a moment, or a load of another kind may have one.
        straight: resultants of all loads on the straight rod.
        without_tangent: name of a load that states no tangent stiffness, or ''.
    """

    def __init__(
        self, arm: Arm, collocation: Collocation, base: Quaternions, loads: Loads
    ) -> None:
        """Tabulate ``loads`` on a rod whose base has the orientation ``base``.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
        """
        self._fixed, self.others = dead_resultants(arm, collocation, loads), loads.others
        self.scaled = loads.scaled
        scaled = self.scaled.loads if self.scaled is not None else ()
        self._parts = [dead_resultants(arm, collocation, one) for one in scaled]
        points = [point for one in (loads, *scaled) for point in one.points]
        self.has_moments = any(any(point.moment) for point in points) or bool(self.others)
        is_felt = any(point.s > 0.0 for point in points) or self._fixed.force.any()
        self.is_empty = not (is_felt or self.others or self.scaled)
        straight = np.zeros((3, collocation.s.size))
        rod = RodPoints(collocation, frames(straight, collocation, matrix_of(base)))
        self.straight = self.resultants(rod)
        self.without_tangent = next(
            (type(load).__name__ for load in self.others if load.tangents(rod) is None), ''
        )

    @property
    def dead(self) -> Resultants:
        """Resultants of all loads that are fixed in base_frame, without the wrench on the tip."""
        force, moment = self._fixed
        if self.scaled is not None:
            for magnitude, part in zip(self.scaled.magnitudes, self._parts, strict=True):
                force, moment = force + magnitude * part.force, moment + magnitude * part.moment
        return Resultants(force, moment)

    def resultants(self, rod: DeformedRod) -> Resultants:
        """Resultants of all loads on the deformed ``rod``, without the wrench on its tip."""
        force, moment = self.dead
        for load in self.others:
            more = load.resultants(rod)
            force, moment = force + more.force, moment + more.moment
        return Resultants(force, moment)

    def has_energy(self, tip_wrench: FloatArray) -> bool:
        """Whether all loads derive from an energy, with ``tip_wrench`` (6,) on the tip.

        A moment that keeps its direction does not.
        """
        # Of so few numbers Python is quicker than NumPy.
        return not (self.has_moments or any(tip_wrench[3:].tolist()))

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """Derivatives of the resultants by the shape of ``rod``.

        Of loads that state them; ``without_tangent`` names one that does not.
        """
        found = (load.tangents(rod) for load in self.others)
        return tuple(tangent for tangents in found for tangent in tangents or ())
