"""The loads on the arm besides its tendons.

Weight, the wrench on the tip, point loads and distributed loads are dead loads: fixed in
base_frame. A `Load` of another kind returns its resultants and their derivatives by the shape.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from types import NoneType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray, Vector
from octo_arm_model.arm.limits import MAX_OBSTACLES, MAX_POINT_LOADS, MAX_TABLE_POINTS
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.arm.validation import check_fields, not_negative, set_fields, vector

ZERO: Vector = (0.0, 0.0, 0.0)
BASE, TIP = TIP_FRAMES = 'base', 'tip'  # frames in which a wrench on the tip may be given


class Resultants(NamedTuple):
    """The resultants of a load on the part of a rod from each point to the tip, in base_frame."""

    force: FloatArray  #: resultant force, (3, points) [N]
    #: sum of the free moments, without the moments of the forces, (3, points) [N m]
    moment: FloatArray


class Tangent(NamedTuple):
    """The derivative of `Resultants` by the rotation vector of one cross section, in base_frame.

    Attributes:
        s: arc coordinate of the cross section [m].
        force: derivative of the force, (3, 3, points) [N].
        moment: derivative of the free moments, (3, 3, points) [N m].
    """

    s: float
    force: FloatArray
    moment: FloatArray


class DeformedRod(Protocol):
    """The deformed rod from which a `Load` computes its resultants."""

    @property
    def s(self) -> FloatArray:
        """The arc coordinates of the points [m], (points,); no break of a load is among them."""

    def rotation_at(self, s: float) -> FloatArray:
        """Return the orientation (3, 3) of the cross section at ``s`` [m], columns t, n and b."""

    def integrate_from_tip(self, values: FloatArray) -> FloatArray:
        """Return the integral along s of ``values`` (..., points) from each point to the tip."""


@runtime_checkable
class Load(Protocol):
    """A load of another kind, given as ``Loads(others=...)``."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """The arc coordinates at which the resultants jump, or the load begins or ends [m]."""

    @property
    def knots(self) -> tuple[float, ...]:
        """The other arc coordinates at which the load is not smooth [m]."""

    def resultants(self, rod: DeformedRod) -> Resultants:
        """Return the resultants on every cross section of ``rod``.

        The moments of forces follow from m' = n x u'. `LoadLimits` bounds them on a straight rod.
        """

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...] | None:
        """Return the derivatives of the resultants by the shape; () if they are fixed.

        Return None if they are not known: shapes under small loads are then found by fixed-point
        iteration, without derivatives and without a check of stability.
        """


# Checks of a wrench on a cross section.
_WRENCH = {
    's': (not_negative, 'arc coordinate', 'm'),
    'force': (vector, 'N'),
    'moment': (vector, 'N m'),
}


@dataclass(frozen=True)
class PointLoad:
    """A force and a moment on one cross section.

    Attributes:
        s: arc coordinate of the cross section [m].
        force: force in base_frame [N].
        moment: moment in base_frame [N m].

    Raises:
        ArmDefinitionError: if a value is not finite or ``s`` is negative.
    """

    s: float
    force: Vector
    moment: Vector = ZERO

    def __post_init__(self) -> None:
        check_fields(self, 'loads.point.', _WRENCH)


@dataclass
class FollowingWrench:
    """A `Load` of a force and a moment on one cross section that rotate with it.

    Force and moment may be changed between two solves.

    Attributes:
        s: arc coordinate of the cross section [m].
        force: force along the axes t, n and b of the cross section [N].
        moment: moment about these axes [N m].

    Raises:
        ArmDefinitionError: if a value is not finite or ``s`` is negative.
    """

    s: float
    force: Vector
    moment: Vector = ZERO

    def __post_init__(self) -> None:
        check_fields(self, 'loads.following.', _WRENCH)

    @property
    def breaks(self) -> tuple[float, ...]:
        """The arc coordinate of the cross section [m]."""
        return (self.s,)

    @property
    def knots(self) -> tuple[float, ...]:
        """No arc coordinates."""
        return ()

    def resultants(self, rod: DeformedRod) -> Resultants:
        """Return force and moment on the sections of ``rod`` up to ``s``; none act beyond it."""
        rotation = rod.rotation_at(self.s)
        force, moment = (
            np.where(rod.s < self.s, (rotation @ part)[:, np.newaxis], 0.0)
            for part in (self.force, self.moment)
        )
        return Resultants(force, moment)

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """Return the derivatives: a rotation by phi adds phi x force and phi x moment."""
        rotation = rod.rotation_at(self.s)
        force, moment = (
            np.where(rod.s < self.s, np.cross(np.eye(3), rotation @ part).T[..., np.newaxis], 0.0)
            for part in (self.force, self.moment)
        )
        return (Tangent(self.s, force, moment),)


@dataclass(frozen=True)
class DistributedLoad:
    """A force per reference length, linear between points and zero outside them.

    Attributes:
        s: arc coordinates of the points [m], at least two, increasing.
        force: force per reference length at each point, in base_frame [N/m].

    Raises:
        ArmDefinitionError: if a value is outside its range, or the numbers of values differ.
    """

    s: tuple[float, ...]
    force: tuple[Vector, ...]

    def __post_init__(self) -> None:
        name = 'loads.distributed'
        for values in (self.s, self.force):
            if isinstance(values, str) or not isinstance(values, (Sequence, np.ndarray)):
                expected = 'lists of s and of force, one force for each s'
                raise ArmDefinitionError(name, values, expected)
        if len(self.s) > MAX_TABLE_POINTS:
            expected = f'at most {MAX_TABLE_POINTS}'
            raise ArmDefinitionError(f'{name}: number of points', len(self.s), expected)
        s = tuple(not_negative(f'{name}.s', value, 'arc coordinate', 'm') for value in self.s)
        if len(s) < 2 or min(np.diff(s)) <= 0.0:
            raise ArmDefinitionError(f'{name}.s', s, 'at least two, increasing [m]')
        force = tuple(vector(f'{name}.force', value, 'N/m') for value in self.force)
        if len(force) != len(s):
            expected = f'{len(s)} forces, one for each s'
            raise ArmDefinitionError(f'{name}.force', force, expected)
        set_fields(self, s=s, force=force)

    def at(self, s: FloatArray) -> FloatArray:
        """Return the force per reference length (3, n) at ``s`` (n,) within the points."""
        return np.stack([np.interp(s, self.s, column) for column in zip(*self.force)])


@dataclass(frozen=True)
class Loads:
    """All loads on the arm besides its tendons.

    Attributes:
        gravity: acceleration of gravity in base_frame [m/s^2].
        fluid_density: density of the surrounding fluid [kg/m^3], >= 0; its buoyancy is the weight
            of the displaced fluid.
        tip_force: force on the tip, in base_frame [N].
        tip_moment: moment on the tip, in base_frame [N m].
        points: loads on cross sections.
        distributed: loads along the arm.
        others: loads of other kinds, each a `Load`.
        scaled: more dead loads, with magnitudes that change between solves.
        obstacles: obstacles that push the arm where it touches them.

    Raises:
        ArmDefinitionError: if a value is not finite or outside its range.
    """

    gravity: Vector = ZERO
    fluid_density: float = 0.0
    tip_force: Vector = ZERO
    tip_moment: Vector = ZERO
    points: tuple[PointLoad, ...] = ()
    distributed: tuple[DistributedLoad, ...] = ()
    others: tuple[Load, ...] = ()
    scaled: ScaledLoads | None = None
    obstacles: tuple[Obstacle, ...] = ()

    def __post_init__(self) -> None:
        checks = {
            'gravity': (vector, 'm/s^2'),
            'fluid_density': (not_negative, 'density', 'kg/m^3'),
            'tip_force': (vector, 'N'),
            'tip_moment': (vector, 'N m'),
            'points': (_list_of, PointLoad),
            'distributed': (_list_of, DistributedLoad),
            'others': (_list_of, Load),
            'obstacles': (_list_of, Obstacle, MAX_OBSTACLES),
        }
        check_fields(self, 'loads.', checks)
        if not isinstance(self.scaled, (ScaledLoads, NoneType)):
            raise ArmDefinitionError('loads.scaled', self.scaled, 'ScaledLoads or None')

    @property
    def any(self) -> bool:
        """Whether any load may be other than zero."""
        vectors = (self.gravity, self.tip_force, self.tip_moment)
        more = self.points, self.distributed, self.others, self.scaled, self.obstacles
        return bool(np.any(vectors) or any(more))

    @property
    def tip_wrench(self) -> FloatArray:
        """The force and the moment on the tip in base_frame [N, N m], (6,)."""
        return np.array([*self.tip_force, *self.tip_moment])

    def following(self, length: float) -> Loads:
        """Return these loads with a wrench on the tip, at ``length`` [m], that rotates with it.

        Its components are then along and about the axes t, n and b of the tip.
        """
        tip = FollowingWrench(length, self.tip_force, self.tip_moment)
        others = (*self.others, tip) if self.tip_wrench.any() else self.others
        return replace(self, tip_force=ZERO, tip_moment=ZERO, others=others)

    @property
    def has_friction(self) -> bool:
        """Whether an obstacle has friction."""
        return any(obstacle.friction for obstacle in self.obstacles)

    def without_friction(self) -> Loads:
        """Return these loads with obstacles without friction."""
        smooth = tuple(replace(obstacle, friction=0.0) for obstacle in self.obstacles)
        return replace(self, obstacles=smooth)

    def moved(self, by: FloatArray) -> Loads:
        """Return these loads with obstacles displaced ``by`` a vector (3,) [m]."""
        return replace(self, obstacles=tuple(obstacle.moved(by) for obstacle in self.obstacles))

    def check_inside(self, length: float) -> None:
        """Check that all loads lie on an arm of ``length`` [m].

        Raises:
            ArmDefinitionError: if a load is beyond the tip.
        """
        if (last := max(self.breaks, default=0.0)) > length:
            expected = f'at most the length of the arm, {length} [m]'
            raise ArmDefinitionError('loads: s', last, expected)

    def check_base(self, position: Vector) -> None:
        """Check that a base at a ``position`` in base_frame [m] is within no obstacle.

        Raises:
            ArmDefinitionError: if it is within an obstacle.
        """
        for number, obstacle in enumerate(self.obstacles):
            distance = float(obstacle.nearest(np.array([position]))[0][0])
            if distance < 0.0:
                expected = f'one outside of loads.obstacles[{number}], not {-distance:.3g} m deep'
                raise ArmDefinitionError('base.position', position, expected)

    @property
    def breaks(self) -> tuple[float, ...]:
        """The arc coordinates at which a load begins or ends, or is concentrated [m]."""
        points = (load.s for load in self.points)
        ends = (s for load in self.distributed for s in (load.s[0], load.s[-1]))
        return (*points, *ends, *(s for load in self._more for s in load.breaks))

    @property
    def knots(self) -> tuple[float, ...]:
        """The other arc coordinates at which a load is not smooth [m]."""
        inner = (s for load in self.distributed for s in load.s[1:-1])
        return (*inner, *(s for load in self._more for s in load.knots))

    @property
    def _more(self) -> tuple[Load | Loads, ...]:
        """The loads that have breaks and knots of their own."""
        return (*self.others, *(self.scaled.loads if self.scaled is not None else ()))


def _list_of(
    name: str, given: object, kind: type[Any], most: int = MAX_POINT_LOADS
) -> tuple[Any, ...]:
    loads = tuple(given) if isinstance(given, Iterable) else (None,)
    if not all(isinstance(load, kind) for load in loads):
        raise ArmDefinitionError(name, given, f'a list of {kind.__name__}')
    if len(loads) > most:
        raise ArmDefinitionError(f'number of {name}', len(loads), f'at most {most}')
    return loads


class ScaledLoads:
    """Dead loads, each multiplied by a magnitude that is set before every solve.

    Attributes:
        loads: the k loads at unit magnitude, dead loads without a wrench on the tip.
        magnitudes: factors of the ``loads`` [-], (k,), zero at first.
    """

    def __init__(self, loads: Sequence[Loads]) -> None:
        """Take the ``loads``, with magnitudes of zero.

        Raises:
            ArmDefinitionError: if a load is not dead, or has a wrench on the tip.
        """
        self.loads = tuple(loads)
        for load in self.loads:
            others = isinstance(load, Loads) and (load.others or load.scaled or load.obstacles)
            if not isinstance(load, Loads) or others or load.tip_wrench.any():
                raise ArmDefinitionError('scaled loads', load, 'dead Loads without a tip wrench')
        self.magnitudes = np.zeros(len(self.loads))
