"""A new kind of load: a force that rotates with the cross section on which it acts."""

from dataclasses import dataclass

import numpy as np

from octo_arm_model import Loads, Solver, load_config
from octo_arm_model.arm.loads import DeformedRod, Resultants, Tangent
from octo_arm_model.rod.rotations import skew


@dataclass(frozen=True)
class FollowingForce:
    """A force in the axes of the cross section at s."""

    s: float  # [m]
    force: tuple[float, float, float]  # along t, n, b of its cross section [N]
    knots: tuple[float, ...] = ()

    @property
    def breaks(self) -> tuple[float, ...]:
        """The arc coordinate at which the resultants jump [m]."""
        return (self.s,)

    def resultants(self, rod: DeformedRod) -> Resultants:
        """Return force [N] and moment [N m] of the load beyond each point."""
        turned = (rod.rotation_at(self.s) @ self.force)[:, np.newaxis]
        force = np.where(rod.s < self.s, turned, 0.0)
        return Resultants(force, np.zeros_like(force))

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """Return the derivatives of the resultants by a rotation of the cross section."""
        # Turned by a small rotation vector phi, the force changes by phi x force.
        by_turn = -skew(rod.rotation_at(self.s) @ self.force)[..., np.newaxis]
        force = np.where(rod.s < self.s, by_turn, 0.0)
        return (Tangent(self.s, force, np.zeros_like(force)),)


arm = load_config('renda2012_prototype').arm
loads = Loads(others=(FollowingForce(arm.length, (0.0, 0.02, 0.0)),))
solver = Solver(arm, 'exact', loads=loads)
shape = solver.solve([[1.0, 0.0, 0.0, 0.0]])
print('tip [m]:', shape.tip)
print('moved by 1 N more [m]:', solver.sensitivity(shape).by_tension.tip[:3, 0])
