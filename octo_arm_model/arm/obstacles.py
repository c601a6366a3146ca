"""What an arm may touch: planes, spheres and cylinders, fixed in base_frame."""

from __future__ import annotations

import abc
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import BoolArray, FloatArray, Vector
from octo_arm_model.arm.limits import MAX_FRICTION
from octo_arm_model.arm.validation import not_negative, positive, set_fields, vector

_Any = TypeVar('_Any', bound='Obstacle')
_LEAST = 1e-12  # distance from a centre or an axis [m] within which there is no direction from it


class Nearest(NamedTuple):
    """Where the surface of an obstacle is, seen from n places.

    Attributes:
        distance: to the surface [m], negative inside, (n,).
        normal: of the surface, outwards, (n, 3).
        normal_by_place: its derivative by the place [1/m], (n, 3, 3).
    """

    distance: FloatArray
    normal: FloatArray
    normal_by_place: FloatArray


@dataclass(frozen=True, kw_only=True)
class Obstacle(abc.ABC):
    """A body at rest whose surface pushes away what enters it.

    Attributes:
        stiffness: pressure per depth [N/m^3], > 0.
        friction: Coulomb's coefficient mu of the arm on it [-], >= 0; for motion.
        creep_speed: at which friction has 0.71 of its full size [m/s], > 0: slower sliding meets
            less of it.
    """

    stiffness: float
    friction: float = 0.0
    creep_speed: float = 1e-3

    def _check(self, kind: str) -> None:
        name = f'{kind}.friction'
        set_fields(
            self,
            stiffness=positive(f'{kind}.stiffness', self.stiffness, 'N/m^3'),
            friction=not_negative(name, self.friction, 'coefficient', '-', MAX_FRICTION),
            creep_speed=positive(f'{kind}.creep_speed', self.creep_speed, 'm/s'),
        )

    @abc.abstractmethod
    def nearest(self, place: FloatArray) -> Nearest:
        """The surface from each ``place`` (n, 3) [m]."""

    @abc.abstractmethod
    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """Whether it lies across straight ways from places ``before`` to ``after``, (n,).

        For bodies of a ``radius`` (n,) [m]: where they would go through it, not along it.
        """

    @abc.abstractmethod
    def moved(self: _Any, by: FloatArray) -> _Any:
        """The same, moved ``by`` (3,) [m]."""


@dataclass(frozen=True)
class Plane(Obstacle):
    """A half space.

    Attributes:
        point: on its surface, in base_frame [m].
        normal: out of it, of any length.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    point: Vector
    normal: Vector

    def __post_init__(self) -> None:
        self._check('Plane')
        set_fields(
            self,
            point=vector('Plane.point', self.point, 'm'),
            normal=_direction('Plane.normal', self.normal),
        )

    def nearest(self, place: FloatArray) -> Nearest:
        """See `Obstacle`."""
        normal = np.array(self.normal)
        distance = (place - self.point) @ normal
        return Nearest(distance, np.tile(normal, (len(place), 1)), np.zeros((len(place), 3, 3)))

    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """See `Obstacle`: it has no other side."""
        return np.zeros(len(before), np.bool_)

    def moved(self, by: FloatArray) -> Plane:
        """See `Obstacle`."""
        return replace(self, point=_sum(self.point, by))


@dataclass(frozen=True)
class Sphere(Obstacle):
    """A ball.

    Attributes:
        centre: in base_frame [m].
        radius: [m], > 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    centre: Vector
    radius: float

    def __post_init__(self) -> None:
        self._check('Sphere')
        set_fields(
            self,
            centre=vector('Sphere.centre', self.centre, 'm'),
            radius=positive('Sphere.radius', self.radius, 'm'),
        )

    def nearest(self, place: FloatArray) -> Nearest:
        """See `Obstacle`."""
        return _from_axis(place - self.centre, np.eye(3), self.radius)

    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """See `Obstacle`."""
        return _pass(before - self.centre, after - self.centre, self.radius + radius)

    def moved(self, by: FloatArray) -> Sphere:
        """See `Obstacle`."""
        return replace(self, centre=_sum(self.centre, by))


@dataclass(frozen=True)
class Cylinder(Obstacle):
    """A round post without ends.

    Attributes:
        point: on its axis, in base_frame [m].
        axis: its direction, of any length.
        radius: [m], > 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    point: Vector
    axis: Vector
    radius: float

    def __post_init__(self) -> None:
        self._check('Cylinder')
        set_fields(
            self,
            point=vector('Cylinder.point', self.point, 'm'),
            axis=_direction('Cylinder.axis', self.axis),
            radius=positive('Cylinder.radius', self.radius, 'm'),
        )

    @property
    def _across(self) -> FloatArray:
        return np.asarray(np.eye(3) - np.outer(self.axis, self.axis))

    def nearest(self, place: FloatArray) -> Nearest:
        """See `Obstacle`."""
        return _from_axis((place - self.point) @ self._across, self._across, self.radius)

    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """See `Obstacle`."""
        start, end = ((place - self.point) @ self._across for place in (before, after))
        return _pass(start, end, self.radius + radius)

    def moved(self, by: FloatArray) -> Cylinder:
        """See `Obstacle`."""
        return replace(self, point=_sum(self.point, by))


def _from_axis(offset: FloatArray, across: FloatArray, radius: float) -> Nearest:
    """The surface at a ``radius`` about a centre or axis, from ``offset`` (n, 3) of this.

    ``across`` (3, 3) takes the part of a vector that leads away from it.
    """
    size = np.maximum(np.sqrt((offset * offset).sum(axis=1)), _LEAST)
    normal = offset / size[:, np.newaxis]
    turn = across - normal[:, :, np.newaxis] * normal[:, np.newaxis]
    return Nearest(size - radius, normal, turn / size[:, np.newaxis, np.newaxis])


def _pass(before: FloatArray, after: FloatArray, reach: FloatArray) -> BoolArray:
    """Whether motions (n, 3) pass the origin within half of ``reach`` (n,)."""
    motion = after - before
    squared = np.maximum((motion * motion).sum(axis=1), _LEAST**2)
    part = np.clip(-(before * motion).sum(axis=1) / squared, 0.0, 1.0)
    least = before + part[:, np.newaxis] * motion
    return np.asarray((least * least).sum(axis=1) < (0.5 * reach) ** 2)


def _direction(name: str, value: object) -> Vector:
    given = np.array(vector(name, value, '-'))
    size = float(np.linalg.norm(given))
    if not (size > 0.0 and np.isfinite(size)):
        raise ArmDefinitionError(name, value, 'a direction, not zero')
    x, y, z = (given / size).tolist()
    return x, y, z


def _sum(point: Vector, by: FloatArray) -> Vector:
    x, y, z = (np.array(point) + by).tolist()
    return x, y, z
