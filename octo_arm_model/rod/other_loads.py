"""Loads of a user's own kind, `arm.loads.Load`, at the nodes of a rod."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.arm.errors import LoadError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Load, Tangent
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.local_loads import along, in_sections
from octo_arm_model.rod.rotations import quaternion_rates, rotation_matrices, skew
from octo_arm_model.rod.tables import Work


class NodeRod:
    """The rod as it is at the nodes, a `DeformedRod`; arrays end in the nodes.

    Attributes:
        s: arc coordinates of the nodes [m], (N,).
    """

    def __init__(self, loads: OtherLoads, quaternion: FloatArray, z: FloatArray) -> None:
        """Of orientations ``quaternion`` (N, 4), w, x, y, z, and twists ``z`` (N, m)."""
        self._loads, self._quaternion, self._z = loads, quaternion, z
        self.s = loads.elements.s

    def rotation_at(self, s: float) -> FloatArray:
        """Orientation (3, 3) of the cross section at ``s`` [m], columns t, n and b."""
        # By an integral, as that is far more exact at the ends of elements than interpolation.
        found = self._loads.base + self._loads.up_to(s) @ self._rates
        found /= np.sqrt(found @ found)
        return np.asarray(rotation_matrices(found[:, np.newaxis])[..., 0])

    def integrate_from_tip(self, values: FloatArray) -> FloatArray:
        """Integral along s of ``values`` (..., N) from each node to the tip."""
        return np.asarray(values @ self._loads.elements.to_tip.T)

    @functools.cached_property
    def _rates(self) -> FloatArray:
        rates = np.empty_like(self._quaternion)
        quaternion_rates(self._quaternion, self._z[:, :3], rates)
        return rates


class OtherLoads:
    """Resultants of loads that may change with the shape, and their derivatives by it.

    Attributes:
        loads: the loads.
        elements: of the nodes.
        base: orientation of the base, w, x, y, z, (4,).
        up_to: for an arc coordinate [m], the row (N,) of the integral from the base to it.
        without_tangent: name of a load that states no tangent stiffness, or ''.
    """

    def __init__(self, loads: tuple[Load, ...], elements: Elements, base: FloatArray) -> None:
        """Ask ``loads`` on the straight rod whether they state tangents."""
        self.has_obstacles = False
        self.loads, self.elements, self.base, self.without_tangent = loads, elements, base, ''
        if not loads:
            return  # Most rods have none, and make no matrices for them.
        self.up_to = functools.lru_cache(256)(self._up_to)
        straight = self.straight()
        self.without_tangent = next(
            (type(load).__name__ for load in loads if load.tangents(straight) is None), ''
        )

    def straight(self) -> NodeRod:
        """The straight rod."""
        nodes = self.elements.s.size
        return NodeRod(self, np.tile(self.base, (nodes, 1)), np.zeros((nodes, 4)))

    def resultants(self, rod: NodeRod) -> FloatArray:
        """Force and free moment of all beyond every node, in base_frame, (2, N, 3) [N, N m]."""
        total = np.zeros((2, self.elements.s.size, 3))
        for load in self.loads:
            force, moment = load.resultants(rod)
            total[0] += np.asarray(force).T
            total[1] += np.asarray(moment).T
        return total

    def add_tangents(self, factor: float, z: FloatArray, work: Work) -> None:
        """Add what ``factor`` times the loads add to the Jacobian at ``z``, in ``work``."""
        rod = NodeRod(self, work.quaternion, z)
        for load in self.loads:
            for tangent in load.tangents(rod) or ():
                self._add_tangent(factor, tangent, z.shape[1], work)

    def _add_tangent(self, factor: float, tangent: Tangent, strains: int, work: Work) -> None:
        # Nodes, component, and that of the rotation vector of the cross section.
        force = factor * np.moveaxis(np.asarray(tangent.force), 2, 0)
        moment = factor * np.moveaxis(np.asarray(tangent.moment), 2, 0)
        # Minus the change of the wrench by the rotation of the section ...
        moment = moment + along(self.elements.to_tip, skew(work.slope) @ force)
        rows = in_sections(work.rotation, force, moment, strains)
        # ... which is the integral of R d kappa up to it.
        columns, inverse = np.zeros_like(rows), work.rotation.swapaxes(1, 2)
        columns[:, :3] = self.up_to(tangent.s)[:, np.newaxis, np.newaxis] * inverse
        work.jacobian[:] -= rows.reshape(-1, 3) @ columns.reshape(-1, 3).T

    def require_tangents(self, what: str) -> None:
        """Refuse ``what`` needs the tangent stiffness of every load, if one states none."""
        if self.without_tangent:
            raise LoadError(
                f'{self.without_tangent} states no tangent stiffness, which {what} needs'
            )

    def _up_to(self, s: float) -> FloatArray:
        return np.asarray(self.elements.integration(np.array([s]))[0])
