"""Obstacles that an arm may touch: planes, spheres and cylinders, fixed in base_frame."""

from __future__ import annotations

import abc
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import BoolArray, FloatArray, Vector
from octo_arm_model.arm.limits import MAX_FRICTION
from octo_arm_model.arm.validation import check_fields, not_negative, positive, vector

_Any = TypeVar('_Any', bound='Obstacle')
_LEAST = 1e-12  # least distance from a centre or an axis at which there is a direction from it [m]


class Nearest(NamedTuple):
    """The nearest points of the surface of an obstacle to n places."""

    distance: FloatArray  #: distance to the surface [m], negative inside, (n,)
    normal: FloatArray  #: outward normal of the surface, (n, 3)
    normal_by_place: FloatArray  #: derivative of the normal by the place [1/m], (n, 3, 3)


@dataclass(frozen=True, kw_only=True)
class Obstacle(abc.ABC):
    """A body at rest that pushes away an arm that enters it."""

    stiffness: float  #: pressure per depth [N/m^3], > 0
    #: Coulomb's coefficient mu between arm and obstacle [-], >= 0; for motion
    friction: float = 0.0
    #: sliding speed at which friction has 0.71 of its full size [m/s], > 0; at lower speeds
    #: friction is less
    creep_speed: float = 1e-3
    _place: ClassVar[str] = 'point'  # name of the field with the position

    def __post_init__(self) -> None:
        check_fields(self, f'{type(self).__name__}.', _CHECKS)

    @abc.abstractmethod
    def nearest(self, place: FloatArray) -> Nearest:
        """Return the nearest points of the surface to each ``place`` (n, 3) [m]."""

    @abc.abstractmethod
    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """Whether bodies that move straight from ``before`` to ``after`` pass through it, (n,).

        The bodies have a ``radius`` (n,) [m]; they do not count if they pass along the surface.
        """

    def moved(self: _Any, by: FloatArray) -> _Any:
        """Return this obstacle displaced ``by`` a vector (3,) [m]."""
        place = np.array(getattr(self, self._place)) + by
        moved: dict[str, Any] = {self._place: tuple(place.tolist())}
        return replace(self, **moved)


@dataclass(frozen=True)
class Plane(Obstacle):
    """A half space.

    Attributes:
        point: a point of the surface in base_frame [m].
        normal: outward normal, of any length.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    point: Vector
    normal: Vector

    def nearest(self, place: FloatArray) -> Nearest:
        """Return distance and normal of the plane at each ``place`` (n, 3) [m]."""
        normal = np.array(self.normal)
        distance = (place - self.point) @ normal
        return Nearest(distance, np.tile(normal, (len(place), 1)), np.zeros((len(place), 3, 3)))

    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """No body passes through a half space, which has no other side."""
        return np.zeros(len(before), np.bool_)


class _Round(Obstacle):
    """The base class of obstacles with a radius about a centre or an axis."""

    radius: float

    @property
    def _across(self) -> FloatArray:
        """The projection (3, 3) of a vector to its part away from the centre or axis."""
        raise NotImplementedError

    def _offset(self, place: FloatArray) -> FloatArray:
        return np.asarray((place - getattr(self, self._place)) @ self._across)

    def nearest(self, place: FloatArray) -> Nearest:
        """Return distance and normal of the surface at each ``place`` (n, 3) [m]."""
        offset = self._offset(place)
        distance = np.maximum(np.sqrt((offset * offset).sum(axis=1)), _LEAST)
        normal = offset / distance[:, np.newaxis]
        turn = self._across - normal[:, :, np.newaxis] * normal[:, np.newaxis]
        return Nearest(distance - self.radius, normal, turn / distance[:, np.newaxis, np.newaxis])

    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """Whether bodies pass the centre or axis within half the sum of both radii, (n,)."""
        start = self._offset(before)
        motion = self._offset(after) - start
        squared = np.maximum((motion * motion).sum(axis=1), _LEAST**2)
        fraction = np.clip(-(start * motion).sum(axis=1) / squared, 0.0, 1.0)
        nearest = start + fraction[:, np.newaxis] * motion
        return np.asarray((nearest * nearest).sum(axis=1) < (0.5 * (self.radius + radius)) ** 2)


@dataclass(frozen=True)
class Sphere(_Round):
    """A ball.

    Attributes:
        centre: centre in base_frame [m].
        radius: radius [m], > 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    centre: Vector
    radius: float
    _place = 'centre'

    @property
    def _across(self) -> FloatArray:
        return np.eye(3)


@dataclass(frozen=True)
class Cylinder(_Round):
    """A round post without ends.

    Attributes:
        point: a point of the axis in base_frame [m].
        axis: direction of the axis, of any length.
        radius: radius [m], > 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    point: Vector
    axis: Vector
    radius: float

    @property
    def _across(self) -> FloatArray:
        return np.asarray(np.eye(3) - np.outer(self.axis, self.axis))


def _direction(name: str, value: object) -> Vector:
    direction = np.array(vector(name, value, '-'))
    length = float(np.linalg.norm(direction))
    if not (length > 0.0 and np.isfinite(length)):
        raise ArmDefinitionError(name, value, 'a direction, not zero')
    x, y, z = (direction / length).tolist()
    return x, y, z


_CHECKS = {
    'stiffness': (positive, 'N/m^3'),
    'friction': (not_negative, 'coefficient', '-', MAX_FRICTION),
    'creep_speed': (positive, 'm/s'),
    'point': (vector, 'm'),
    'centre': (vector, 'm'),
    'radius': (positive, 'm'),
    'normal': (_direction,),
    'axis': (_direction,),
}
