"""Loads at the nodes: their resultants beyond every node, and their part of the Jacobian.

Dead loads are fixed in base_frame; others are of a user's own kind, `arm.loads.Load`. Loads per
length that depend on the shape, such as contact, change with the turn phi = int R d kappa of a
section and its displacement dr = int (phi x r' + R d v), where int is the integral from the base.
A density of force f and of moment m changes the wrench beyond each node by

    dF = int' df,    dM = int' (r' x dF + dm),

where int' is the integral to the tip.
"""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, LoadError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Load, Loads, ScaledLoads, Tangent
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.rotations import quaternion_rates, rotation_matrices, skew
from octo_arm_model.rod.tables import Work


class DeadLoads:
    """The force and free moment of dead loads beyond every node, without the tip wrench.

    Attributes:
        has_moments: whether a point load has a moment, which has no energy.
    """

    def __init__(self, arm: Arm, elements: Elements, loads: Loads) -> None:
        """Tabulate the dead ones of ``loads`` on ``arm`` at the nodes of ``elements``."""
        self._fixed = self.tabulate(arm, elements, loads)
        self._scaled: ScaledLoads | None = loads.scaled
        parts = loads.scaled.loads if loads.scaled is not None else ()
        self._parts = [self.tabulate(arm, elements, part) for part in parts]
        points = [point for group in (loads, *parts) for point in group.points]
        self.has_moments = any(any(point.moment) for point in points)

    def at(self, factor: float, tip_wrench: FloatArray) -> FloatArray:
        """Return force and free moment beyond every node, (2, N, 3) [N, N m], in base_frame.

        They are those of ``factor`` times the loads, and of the ``tip_wrench`` (6,).
        """
        total = self._fixed
        if self._scaled is not None:
            for magnitude, part in zip(self._scaled.magnitudes, self._parts, strict=True):
                total = total + magnitude * part
        return np.asarray(factor * total + tip_wrench.reshape(2, 1, 3))

    def tabulate(self, arm: Arm, elements: Elements, loads: Loads) -> FloatArray:
        """Return force and free moment of dead ``loads`` beyond every node, (2, N, 3)."""
        resultants = np.zeros((2, elements.s.size, 3))
        resultants[0] = elements.to_tip @ force_per_length(arm, elements.s, loads)
        for point in loads.points:
            # No node lies at a load; one at the base acts on no section.
            beyond = elements.s < point.s
            resultants[0, beyond] += point.force
            resultants[1, beyond] += point.moment
        return resultants


def force_per_length(arm: Arm, s: FloatArray, loads: Loads) -> FloatArray:
    """Return weight, buoyancy and distributed ``loads`` at ``s`` (n,) [m], (n, 3) [N/m].

    Raises:
        ArmDefinitionError: if gravity acts on an arm without density.
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


# Of a user's own kind ----------------------------------------------------------------------------


class NodeRod:
    """The deformed rod at the nodes, a `DeformedRod`; the last axis of arrays is the nodes.

    Attributes:
        s: arc coordinates of the nodes [m], (N,).
    """

    def __init__(self, loads: OtherLoads, quaternion: FloatArray, z: FloatArray) -> None:
        """Store orientations ``quaternion`` (N, 4), w, x, y, z, and twists ``z`` (N, m)."""
        self._loads, self._quaternion, self._z = loads, quaternion, z
        self.s = loads.elements.s

    def rotation_at(self, s: float) -> FloatArray:
        """Return the orientation (3, 3) of the section at ``s`` [m], columns t, n and b."""
        # An integral is far more exact at the ends of elements than interpolation.
        quaternion = self._loads.base + self._loads.up_to(s) @ self._rates
        quaternion /= np.sqrt(quaternion @ quaternion)
        return np.asarray(rotation_matrices(quaternion[:, np.newaxis])[..., 0])

    def integrate_from_tip(self, values: FloatArray) -> FloatArray:
        """Return the integral along s of ``values`` (..., N) from each node to the tip."""
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
        elements: elements with the nodes.
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
        """Return the straight rod."""
        nodes = self.elements.s.size
        return NodeRod(self, np.tile(self.base, (nodes, 1)), np.zeros((nodes, 4)))

    def resultants(self, rod: NodeRod) -> FloatArray:
        """Return force and free moment of all loads beyond every node, (2, N, 3) [N, N m]."""
        total = np.zeros((2, self.elements.s.size, 3))
        for load in self.loads:
            force, moment = load.resultants(rod)
            total[0] += np.asarray(force).T
            total[1] += np.asarray(moment).T
        return total

    def add_tangents(self, factor: float, z: FloatArray, work: Work) -> None:
        """Add derivatives of ``factor`` times the loads at ``z`` to the Jacobian in ``work``."""
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

    def require_tangents(self) -> None:
        """Raise LoadError if a load states no tangent stiffness, which derivatives need."""
        if name := self.without_tangent:
            raise LoadError(f'{name} states no tangent stiffness, which sensitivity needs')

    def _up_to(self, s: float) -> FloatArray:
        return np.asarray(self.elements.integration(np.array([s]))[0])


# By where the arm is -----------------------------------------------------------------------------


def tangents_of_nodes(parts: FloatArray, points: int) -> FloatArray:
    """Return the tangents of `add_tangents` of densities that depend on their own node alone.

    ``parts`` (N, 2, 2, 3, 3) are the derivatives of force and moment by displacement and rotation
    of each node, in elements of so many ``points``.
    """
    number, elements = np.arange(points), len(parts) // points
    tangents = np.zeros((2, 2, elements, points, 3, points, 3))
    by_element = parts.reshape(elements, points, 2, 2, 3, 3)
    tangents[:, :, :, number, :, number] = by_element.transpose(1, 2, 3, 0, 4, 5)
    return tangents.reshape(2, 2, elements, 3 * points, -1)


def kinematics(from_base: FloatArray, work: Work, strains: int) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of turns of sections and of r' by the twists, (N, 3, N m).

    ``from_base`` (N, N) is the matrix of integrals to each node; the shape is in ``work``.
    """
    nodes = len(work.slope)
    columns = np.zeros((nodes, 3, nodes, strains))
    part, axes = from_base[:, np.newaxis, :, np.newaxis], work.rotation
    np.multiply(part, axes.transpose(1, 0, 2), out=columns[..., :3])
    turn = columns.reshape(nodes, 3, -1)
    slope, number = -(skew(work.slope) @ turn), np.arange(nodes)
    own = slope.reshape(nodes, 3, nodes, strains)
    own[number, :, number, 3:] += work.rotation[:, :, : strains - 3]
    return turn, slope


def pose_rates(
    to_nodes: FloatArray, rotation: FloatArray, slope: FloatArray, z: FloatArray
) -> FloatArray:
    """Return the derivatives by s of displacements and rotations (N, 6, columns) of the nodes.

    The twists change by ``z`` (N, m, columns). ``to_nodes`` (N, N) integrates from the base.
    """
    rates = np.empty((len(z), 6, z.shape[2]))
    np.matmul(rotation, z[:, :3], out=rates[:, 3:])
    turn = along(to_nodes, rates[:, 3:])
    np.matmul(rotation[..., : z.shape[1] - 3], z[:, 3:], out=rates[:, :3])
    rates[:, :3] -= skew(slope) @ turn
    return rates


def add_tangents(elements: Elements, work: Work, strains: int, tangents: FloatArray) -> None:
    """Add the derivatives of loads to the Jacobian in ``work``.

    ``tangents`` (2, 2, E, 3 p, 3 p) are the derivatives of the densities of force [N/m] and moment
    [N] at the p nodes of each element by the displacements [m] and rotations of these nodes.
    """
    turn, slope = kinematics(elements.from_base, work, strains)
    move = along(elements.from_base, slope)
    pose = [part.reshape(*tangents.shape[2:4], -1) for part in (move, turn)]
    force, moment = densities = np.zeros((2, *move.shape))
    for density, of_density in zip(densities, tangents):
        for part, by_part in zip(pose, of_density):
            if by_part.any():
                density += (by_part @ part).reshape(density.shape)
    force = along(elements.to_tip, force)
    moment = along(elements.to_tip, moment + skew(work.slope) @ force)
    rows = in_sections(work.rotation, force, moment, strains)
    work.jacobian[:] -= rows.reshape(work.jacobian.shape)


def in_sections(
    rotation: FloatArray, force: FloatArray, moment: FloatArray, strains: int
) -> FloatArray:
    """Return ``force`` and ``moment`` (N, 3, k) in the axes of sections, (N, m, k)."""
    inverse = rotation.swapaxes(1, 2)
    return np.concatenate([inverse @ moment, inverse[:, : strains - 3] @ force], axis=1)


def along(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """Return a ``matrix`` (n, P) times ``values`` (P, c, k)."""
    return (matrix @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])
