"""The loads of the motion of a rod: inertia, added mass, drag and viscosity.

Discretised in time, velocity and acceleration are linear functions of places. So a time step is a
balance under loads that depend on the shape. With the velocity w of a node relative to the water,
its acceleration a, the tangent t and its rate t', the loads per reference length are

    force    -rho A a_abs - m_a (P w)' - rho_w R |w| (C_n w + (pi C_t / 2 - C_n) (t . w) t)
             + rho_w A u',                       P = 1 - t t^T,    m_a = C_a rho_w A            (1)
    moment   -rho (J_b n x n'' + J_n b x b'') - m_a (t . w) t x w                               (2)

for the directors n and b, second moments of area J_n about n and J_b about b, and the acceleration
u' of the water; the moment of the added mass is Munk's, without which the energy of rod and water
would change. In (1) the momentum of the water is differentiated: (P w)' = P a - (t' t^T + t t'^T)
w. Viscosity adds D z' to the sections' gradient.
"""

import math

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import MotionProperties
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod.contact import NodeMotion
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.equilibrium import Condition, NodeCondition, Problem, State
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.loads import add_tangents, kinematics, tangents_of_nodes
from octo_arm_model.rod.rotations import dot, outer, skew
from octo_arm_model.rod.section_arrays import cross
from octo_arm_model.rod.tables import (
    ADDED,
    COLUMNS,
    DISPLACED,
    LEVER,
    MASS,
    POSITION,
    RADIUS,
    ROTARY_B,
    ROTARY_N,
    TANGENT,
    Motion,
    MotionTables,
    Tables,
    TimeRule,
)

_ROUNDED = 4e-16  # rounding error of places over the length


class MovingProblem(Problem):
    """The residual and Jacobian of a rod that moves by a `TimeRule`.

    Attributes:
        rule: velocities and accelerations; at first those of a rod at rest.
        reference: moment and force that are added to `Work.scale` for residuals, (m,).
        origin: origin of positions [m], (3,), as rounding of large ones would accelerate the rod.
        base: position from the origin [m] and quaternion w, x, y, z of the base, (7,).
        is_viscous: whether viscosity damps the rod.
        rounding: residual by rounding errors of places, times the square of a time step [s^2].
    """

    def __init__(
        self,
        arm: Arm,
        elements: Elements,
        tables: Tables,
        loads: Loads,
        form: Form,
        strains: int,
        properties: MotionProperties,
    ) -> None:
        """Prepare the equations of ``arm`` with ``tables`` at the nodes of ``elements``.

        Raises:
            ArmDefinitionError: if the arm has no density.
        """
        super().__init__(arm, elements, tables, loads, form, strains)
        if not arm.material.density:
            expected = 'a density > 0 [kg/m^3] of an arm that moves'
            raise ArmDefinitionError('material.density', 0.0, expected)
        for name in ('normal_drag', 'tangential_drag', 'added_mass'):
            if not arm.body.is_round and (value := getattr(properties, name)):
                expected = '0 of a rectangular body, of which drag and added mass are not known'
                raise ArmDefinitionError(f'motion.{name}', value, expected)
        water, nodes, density = loads.fluid_density, elements.s.size, arm.material.density
        body, drag = arm.body.geometry(elements.s), water * tables.body[:, RADIUS]
        across, along = properties.normal_drag, 0.5 * math.pi * properties.tangential_drag
        section = np.stack(
            [
                density * body.area,
                density * body.about_b,
                density * body.about_n,
                water * body.displaced,
                properties.added_mass * water * body.displaced,
                across * drag,
                (along - across) * drag,
            ],
            axis=1,
        )
        if arm.discs.mass:
            disc_mass = arm.discs.mass / arm.discs.thickness * arm.discs.cover(elements.s)
            rotary = 0.25 * arm.body.disc_radius**2
            section[:, : ROTARY_B + 1] += np.outer(disc_mass, [1.0, rotary, rotary])
        self.moving = MotionTables(
            elements.from_base,
            elements.to_tip,
            section,
            bool(section[:, DISPLACED:].any()),
            _viscosities(arm, elements.s, strains, properties),
        )
        self.is_viscous = bool(self.moving.viscous.any())
        resisting = elements.to_tip @ (section[:, MASS] + section[:, ADDED])
        resisting = np.maximum(resisting, elements.to_tip @ resisting / tables.body[:, LEVER])
        self.rounding = _ROUNDED * arm.length * float((resisting / self.tables.least_scale).max())
        self.origin, self.base = np.zeros(3), np.array([*np.zeros(3), *tables.base])
        self.rest = TimeRule(
            0.0,
            0.0,
            np.zeros((nodes, COLUMNS)),
            np.zeros((nodes, COLUMNS)),
            np.zeros((nodes, strains)),
            np.zeros((2, 3)),
        )
        self.rule, self.follows = self.rest, True
        self.reference = np.zeros(strains)
        self._of_scale = np.arange(strains) // 3  # column of `Work.scale`
        place, velocity, acceleration = np.zeros((3, nodes, COLUMNS))
        self.motion = Motion(place, velocity, acceleration, np.zeros((2, nodes, 3)))

    def place_base(self, base: FloatArray) -> None:
        """Move the base to a position in base_frame [m] and quaternion w, x, y, z, (7,)."""
        base = np.concatenate([base[:3] - self.origin, base[3:]])
        if not (base == self.base).all():
            self.base, self.others.base = base, base[3:]
            self.tables = self.tables._replace(base=base[3:])
            self._current = self._oriented = None

    def _following_loads(self, condition: Condition, z: FloatArray) -> FloatArray:
        """Return the loads that depend on the shape, and put the motion of nodes in `motion`."""
        work = self.work
        self.form.moving_loads(
            self.moving, self.rule, self.base[:3], work.slope, work.rotation, self.motion
        )
        return super()._following_loads(condition, z) + self.motion.load

    def _add_gradients(self, at_nodes: NodeCondition, z: FloatArray) -> float:
        """Add the gradients of the sections and of viscosity; return the relative residual."""
        super()._add_gradients(at_nodes, z)
        residual, scale = self.work.residual, self.work.scale[:, self._of_scale]
        if self.is_viscous:
            rate = self.rule.by_velocity * z - self.rule.twist_rate
            residual += self.moving.viscous * rate
        return float((np.abs(residual) / (scale + self.reference)).max())

    def fill_jacobian(self, state: State, damping: float = 0.0) -> None:
        """Compute the Jacobian with the derivatives of the motion's loads."""
        super().fill_jacobian(state, damping)
        self.add_motion(state.z, self.rule.by_velocity, self.rule.by_acceleration)

    def add_motion(self, z: FloatArray, c1: float, c0: float) -> None:
        """Add the derivatives of inertia and resistance to the Jacobian, by the motion of `rule`.

        Velocities change by ``c1``, and accelerations by ``c0``, times the change of the places.
        """
        work = self.work
        if self.is_viscous:
            diagonal = np.einsum('ii->i', work.jacobian)
            diagonal += c1 * self.moving.viscous.ravel()
        tangents = tangents_of_nodes(self._tangents(c1, c0), self.elements.points)
        if self.contact is not None:
            touching = self.contact.tangents(*self._touched(), c1)
            tangents += 0.0 if touching is None else touching
        add_tangents(self.elements, work, z.shape[1], tangents)

    def _add_contact(self, rigidity: float) -> None:
        """Add nothing, as `add_motion` adds contact together with the motion."""

    def _touched(self) -> tuple[FloatArray, NodeMotion | None]:
        """Return the places of the nodes, and their motion if obstacles have friction."""
        place, velocity = self.motion[:2]
        rubs = self.contact is not None and self.contact.has_friction
        return place[:, POSITION], node_motion(place, velocity) if rubs else None

    def velocities(self, place: FloatArray, twist_rate: FloatArray) -> FloatArray:
        """Return the rates of ``place`` (N, 12) for a ``twist_rate`` (N, m), on a base at rest."""
        turn, slope = kinematics(self.elements.from_base, self.work, twist_rate.shape[1])
        spin = (turn @ twist_rate.ravel())[:, np.newaxis]
        rates = np.empty((len(place), 4, 3))
        rates[:, 0] = self.moving.from_base @ (slope @ twist_rate.ravel())
        rates[:, 1:] = np.cross(spin, place[:, 3:].reshape(-1, 3, 3))
        return rates.reshape(place.shape)

    def _tangents(self, c1: float, c0: float) -> FloatArray:
        """Return the derivatives of (1) and (2) by displacement and turn, (N, 2, 2, 3, 3)."""
        place, velocity, acceleration, _ = self.motion
        section = self.moving.section
        mass, _, _, _, added, across, along = section.T[..., np.newaxis, np.newaxis]
        one, nodes = np.eye(3), len(place)
        tangents = np.zeros((nodes, 2, 2, 3, 3))
        # Each of rho J d x d'' gives rho J (d d''^T - d . d'' + c0 (1 - d d^T)).
        t, tt = place[:, TANGENT], outer(place[:, TANGENT], place[:, TANGENT])
        axes, spun = (x[:, 6:].reshape(-1, 2, 3) for x in (place, acceleration))
        rotary = section[:, ROTARY_N : ROTARY_B + 1, np.newaxis]
        weighed = (rotary * axes).swapaxes(1, 2)
        trace = (rotary * (axes * spun - c0 * axes * axes)).sum(axis=(1, 2))
        moment_by_turn = weighed @ (c0 * axes - spun) + trace[:, np.newaxis, np.newaxis] * one
        tangents[:, 0, 0], tangents[:, 1, 1] = -c0 * mass * one, moment_by_turn
        if not self.moving.in_water:
            return tangents
        (u, rate), dt = self.rule.water, velocity[:, TANGENT]
        w, a = velocity[:, POSITION] - u, acceleration[:, POSITION] - rate
        tw, size = dot(t, w)[..., np.newaxis], np.sqrt(dot(w, w))[..., np.newaxis]
        tangent_rate_product = outer(dt, t)
        by_acceleration = -added * (one - tt)
        by_velocity = added * (tangent_rate_product + tangent_rate_product.swapaxes(1, 2))
        by_velocity -= size * (across * one + along * tt)
        drag = across * w[..., np.newaxis] + along * tw * t[..., np.newaxis]
        by_velocity -= drag * (w / np.maximum(size[..., 0], 1e-300))[:, np.newaxis]
        by_tangent = added * (
            (dot(t, a) + dot(dt, w))[..., np.newaxis] * one + outer(t, a) + outer(dt, w)
        )
        by_tangent -= size * along * (tw * one + outer(t, w))
        by_tangent += c1 * added * (tw * one + outer(t, w))
        tangents[:, 0, 0] += c0 * by_acceleration + c1 * by_velocity
        turns = -skew(t)
        tangents[:, 0, 1] = by_tangent @ turns
        across_flow = cross(t, w)
        tangents[:, 1, 0] = -c1 * added * (outer(across_flow, t) + tw * skew(t))
        tangents[:, 1, 1] -= added * (outer(across_flow, w) - tw * skew(w)) @ turns
        return tangents


def node_motion(place: FloatArray, velocity: FloatArray) -> NodeMotion:
    """Return the motion of nodes at ``place`` (N, 12) with a ``velocity`` (N, 12)."""
    axes, rates = (x[:, 3:].reshape(-1, 3, 3) for x in (place, velocity))
    return NodeMotion(velocity[:, POSITION], rates.swapaxes(1, 2) @ axes)


def _viscosities(
    arm: Arm, s: FloatArray, strains: int, properties: MotionProperties
) -> FloatArray:
    """Return the viscous stiffness D of the sections at ``s`` (N,) [m], (N, m)."""
    body, eta = arm.body.geometry(s), properties.viscosity
    axial, torsion, bending_n, bending_b, shear = SectionStiffness.at(arm, s)
    parts = [torsion, bending_n, bending_b, axial, shear, shear]
    if not eta:
        return properties.damping_time * np.stack(parts[:strains], axis=1)
    area = body.area
    parts = [body.torsion, 3.0 * body.about_n, 3.0 * body.about_b, 3.0 * area, area, area]
    return eta * np.stack(parts[:strains], axis=1)
