"""Contact of an arm with obstacles: the pressure is proportional to the penetration.

The arm is a tube of the radius R about its midline, which an obstacle of the stiffness k [N/m^3]
touches over the width 2 R. At a penetration d the force per reference length is

    f = 2 R k d n - mu 2 R k d u / sqrt(|u|^2 + v_0^2),    u = (1 - n n^T) (v - w x R n)

for the outward normal n, the velocity v of the midline and the spin w of the section there, with
the moment -R n x f about the midline. At rest there is no friction. The force is that of an
energy, k R d^2 per length, summed over points that are closer than the nodes: the densities at
the nodes do the same work, so that the ends of a contact may lie anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, SolveError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.rod.elements import Elements, gauss_rule
from octo_arm_model.rod.loads import along
from octo_arm_model.rod.rotations import dot, outer, skew

_SPACING, _POINTS = 0.2, 3  # length of the parts of an element over R, and points of each
_PARTS = 4, 120  # least and largest number of parts of an element, if they are no longer than R
_MOST_PARTS = 1000  # largest number of parts of an element
_ROUNDED = 4e-7  # rounding error of places over the length, times the stiffest obstacle


class Contacts(NamedTuple):
    """The contact of an arm with O obstacles.

    Attributes:
        s: arc coordinates of the M points at which contact is computed [m], (M,).
        penetration: penetration of the surface of the arm into each obstacle there [m], 0 without
            contact, (O, M).
        force: force of each obstacle on the arm in base_frame, (O, 3) [N].
    """

    s: FloatArray
    penetration: FloatArray
    force: FloatArray


NONE = Contacts(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 3)))  # contact without obstacles


class NodeMotion(NamedTuple):
    """The motion of the nodes of an arm."""

    velocity: FloatArray  #: velocity of the nodes [m/s], (N, 3)
    spin: FloatArray  #: matrix from a vector in the section to its velocity [1/s], (N, 3, 3)


class _Touch(NamedTuple):
    """The contact with one obstacle, at n of the points."""

    number: int  # index of the obstacle in `Contact.obstacles`
    obstacle: Obstacle
    where: IntArray  # indices of the points, (n,)
    stiffness: FloatArray  # force per length and depth [N/m^2], (n,)
    depth: FloatArray  # penetration [m], (n,)
    normal: FloatArray  # outward normal, (n, 3)
    turn: FloatArray  # derivative of the normal by the place, (n, 3, 3)

    @property
    def push(self) -> FloatArray:
        """Size of the normal force per length [N/m], (n, 1)."""
        return np.asarray((self.stiffness * self.depth)[:, np.newaxis])


class Contact:
    """The obstacles of an arm, and their forces at its nodes.

    Attributes:
        obstacles: the obstacles.
        has_friction: whether one of the obstacles has friction.
        rounding: force by rounding of places, over the tolerance of a residual [N].
    """

    def __init__(self, arm: Arm, elements: Elements, obstacles: tuple[Obstacle, ...]) -> None:
        """Choose points of contact on an ``arm`` with nodes in ``elements``.

        Raises:
            ArmDefinitionError: if the cross sections are not round, or the arm is too thin.
        """
        self.obstacles = obstacles
        self.has_friction = any(obstacle.friction for obstacle in obstacles)
        if not arm.body.is_round:
            expected = 'none: a rectangular body has no contact'
            raise ArmDefinitionError('number of loads.obstacles', len(obstacles), expected)
        self._s, self._weights = _points(arm, elements)
        self._radius = surface_radius(arm, self._s)
        stiffness = max(obstacle.stiffness for obstacle in obstacles)
        stiffest = 2.0 * float(self._radius.max()) * stiffness
        self.rounding = _ROUNDED * stiffest * arm.length**2
        self._elements, self._element = elements, elements.element_at(self._s)
        self._between = elements.interpolation(self._s)
        self._back = self._between.T * self._weights / elements.weights[:, np.newaxis]

    def densities(
        self, place: FloatArray, motion: NodeMotion | None = None, to: Contact | None = None
    ) -> FloatArray:
        """Return force and moment per length at nodes at ``place`` (N, 3) [m], (2, N, 3).

        They are at the nodes of another contact ``to``, if given, in the same elements [N/m, N].
        """
        to_nodes = self._back if to is None else to._back
        total = np.zeros((2, len(to_nodes), 3))
        for touch in self._touches(place):
            to_touched, drag = to_nodes[:, touch.where], self._drag(touch, motion)
            total[0] += to_touched @ (touch.push * touch.normal + drag)
            total[1] -= to_touched @ np.cross(self._lever(touch), drag)
        return total

    def tangents(
        self, place: FloatArray, motion: NodeMotion | None = None, by_velocity: float = 0.0
    ) -> FloatArray | None:
        """Return derivatives of `densities` as of `add_tangents`; None if nothing is touched.

        Velocities change ``by_velocity`` times places.
        """
        if not (touches := self._touches(place)):
            return None
        elements, points = self._elements.lengths.size, self._elements.points
        total = np.zeros((elements, points, points, 2, 2, 3, 3))
        for touch in touches:
            parts, element = self._tangents(touch, motion, by_velocity), self._element[touch.where]
            for e in np.unique(element):
                inside, nodes = element == e, slice(e * points, (e + 1) * points)
                where = touch.where[inside]
                pairs = self._back[nodes, where][:, np.newaxis] * self._between[where, nodes].T
                total[e] += (pairs @ parts[inside].reshape(-1, 36)).reshape(total.shape[1:])
        blocks = total.transpose(3, 4, 0, 1, 5, 2, 6)
        return blocks.reshape(2, 2, elements, 3 * points, 3 * points)

    def _tangents(self, touch: _Touch, motion: NodeMotion | None, c: float) -> FloatArray:
        """Return derivatives of force and moment by displacement and turn, (n, 2, 2, 3, 3)."""
        parts = np.zeros((touch.where.size, 2, 2, 3, 3))
        n = touch.normal
        parts[:, 0, 0] = touch.push[..., np.newaxis] * touch.turn
        parts[:, 0, 0] -= touch.stiffness[:, np.newaxis, np.newaxis] * outer(n, n)
        if motion is not None and touch.obstacle.friction:
            self._add_drag(parts, touch, motion, c)
        return parts

    def _touches(self, place: FloatArray) -> list[_Touch]:
        points, touches = self._between @ place, []
        for number, obstacle in enumerate(self.obstacles):
            nearest = obstacle.nearest(points)
            depth = self._radius - nearest.distance
            (touched,) = (depth > 0.0).nonzero()
            if touched.size:
                stiffness = 2.0 * obstacle.stiffness * self._radius[touched]
                _, normal, turn = (values[touched] for values in nearest)
                identity = number, obstacle, touched
                touches.append(_Touch(*identity, stiffness, depth[touched], normal, turn))
        return touches

    def _lever(self, touch: _Touch) -> FloatArray:
        """Return the vectors from the surface to the midline [m], (n, 3)."""
        return np.asarray(self._radius[touch.where, np.newaxis] * touch.normal)

    def _drag(self, touch: _Touch, motion: NodeMotion | None) -> FloatArray:
        """Return the friction per length, (n, 3) [N/m]."""
        if motion is None or not touch.obstacle.friction:
            return np.zeros_like(touch.normal)
        return self._slip(touch, motion)[0]

    def _slip(
        self, touch: _Touch, motion: NodeMotion
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return friction per length, surface velocity, regularised speed, and spin."""
        between, n = self._between[touch.where], touch.normal
        spin = along(between, motion.spin)
        slip = between @ motion.velocity - (spin @ self._lever(touch)[..., np.newaxis])[..., 0]
        sliding = slip - dot(n, slip) * n
        speed = np.sqrt(dot(sliding, sliding) + touch.obstacle.creep_speed**2)
        return -touch.obstacle.friction * touch.push * sliding / speed, slip, speed, spin

    def _add_drag(self, parts: FloatArray, touch: _Touch, motion: NodeMotion, c: float) -> None:
        drag, slip, speed, spin = self._slip(touch, motion)
        n, turn, mu = touch.normal, touch.turn, touch.obstacle.friction
        size, identity = mu * touch.push, np.eye(3)
        radius = self._radius[touch.where, np.newaxis, np.newaxis]
        lever, factor = skew(self._lever(touch)), (size / speed)[..., np.newaxis]
        # Derivatives of the surface velocity by displacement and turn; then of its tangent part.
        by_place, by_turn = c * identity - radius * spin @ turn, c * lever - spin @ lever
        project = identity - outer(n, n)
        tilted = (dot(n, slip)[..., np.newaxis] * identity + outer(n, slip)) @ turn
        by_place, by_turn = project @ by_place - tilted, project @ by_turn
        unit = -drag / size
        by_sliding = factor * (identity - outer(unit, unit))
        force_by_place = outer(drag, n) / -touch.depth[:, np.newaxis, np.newaxis]
        force_by_place -= by_sliding @ by_place
        force_by_turn = -by_sliding @ by_turn
        parts[:, 0, 0] += force_by_place
        parts[:, 0, 1] = force_by_turn
        parts[:, 1, 0] = radius * skew(drag) @ turn - lever @ force_by_place
        parts[:, 1, 1] = -lever @ force_by_turn

    # Results -----------------------------------------------------------------------------------

    def report(self, place: FloatArray, motion: NodeMotion | None = None) -> Contacts:
        """Return penetrations and forces of an arm with nodes at ``place`` (N, 3) [m]."""
        depths = np.zeros((len(self.obstacles), self._s.size))
        forces = np.zeros((len(self.obstacles), 3))
        for touch in self._touches(place):
            force = touch.push * touch.normal + self._drag(touch, motion)
            depths[touch.number, touch.where] = touch.depth
            forces[touch.number] = self._weights[touch.where] @ force
        return Contacts(self._s, depths, forces)

    def error(self, place: FloatArray) -> float:
        """Return the error of depths by the distance of points [m], with nodes at ``place``."""
        worst = 0.0
        for touch in self._touches(place):
            starts = np.append(0, np.flatnonzero(np.diff(touch.where) > 1) + 1)
            counts = np.diff(np.append(starts, touch.where.size))
            depths = np.maximum.reduceat(touch.depth, starts)
            worst = max(worst, float((depths / (counts * counts)).max()))
        return worst

    def check_depths(self, place: FloatArray) -> None:
        """Refuse nodes at ``place`` (N, 3) [m] with the midline inside an obstacle.

        Raises:
            SolveError: if an obstacle is too soft for the force on it, or lies in the arm.
        """
        if where := self.inside(place):
            raise SolveError(f'the midline of the arm is {where}: it is too soft, or begins there')

    def inside(self, place: FloatArray) -> str:
        """Return in words where the midline is inside an obstacle; '' if nowhere."""
        for touch in self._touches(place):
            excess = touch.depth - self._radius[touch.where]
            worst = int(np.argmax(excess))
            if excess[worst] > 0.0:
                s = self._s[touch.where[worst]]
                number = touch.number
                return f'{excess[worst]:.3g} m inside loads.obstacles[{number}] at s = {s:.4g} m'
        return ''

    def has_passed(self, start: FloatArray, end: FloatArray) -> bool:
        """Return whether the arm passed an obstacle between two places of its nodes, (N, 3)."""
        ends = self._between @ start, self._between @ end
        return any(bool(o.has_between(*ends, self._radius).any()) for o in self.obstacles)


def surface_radius(arm: Arm, s: FloatArray) -> FloatArray:
    """Return the radius of body or discs, which touches obstacles, at ``s`` (n,) [m]."""
    return np.maximum(arm.body.radius(s), arm.body.disc_radius)


def _points(arm: Arm, elements: Elements) -> tuple[FloatArray, FloatArray]:
    """Return the points of contact, (M,) [m], and weights of the integral over them."""
    rule = gauss_rule(_POINTS)
    ends = surface_radius(arm, elements.edges)
    over_radius = elements.lengths / np.minimum(ends[:-1], ends[1:])
    # A thin post between points farther apart than R would not be noticed.
    most = np.maximum(_PARTS[1], np.ceil(over_radius))
    if most.max() > _MOST_PARTS:
        thin = int(np.argmax(most))
        least = elements.lengths[thin] / _MOST_PARTS
        expected = f'at least {least:.3g} m there to touch obstacles'
        name = f'radius of the arm at s = {elements.edges[thin]:.4g} m or beyond'
        raise ArmDefinitionError(name, float(ends[thin : thin + 2].min()), expected)
    counts = np.clip(np.ceil(over_radius / _SPACING), _PARTS[0], most).astype(np.int64)
    lengths = np.repeat(elements.lengths / counts, counts)
    starts = np.append(0.0, np.cumsum(lengths)[:-1])
    s = starts[:, np.newaxis] + lengths[:, np.newaxis] * rule.points
    return s.ravel(), (lengths[:, np.newaxis] * rule.weights).ravel()
