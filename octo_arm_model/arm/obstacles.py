"""What an arm may touch: planes, spheres and cylinders, fixed in base_frame."""

from __future__ import annotations

import abc
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

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
    _place: ClassVar[str] = 'point'  # the field that says where it is

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

    def moved(self: _Any, by: FloatArray) -> _Any:
        """The same, moved ``by`` (3,) [m]."""
        place = np.array(getattr(self, self._place)) + by
        moved: dict[str, Any] = {self._place: tuple(place.tolist())}
        return replace(self, **moved)


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


class _Round(Obstacle):
    """What has one radius about a centre or an axis."""

    radius: float

    @property
    def _across(self) -> FloatArray:
        """The part of a vector that leads away from centre or axis, (3, 3)."""
        raise NotImplementedError

    def _offset(self, place: FloatArray) -> FloatArray:
        return np.asarray((place - getattr(self, self._place)) @ self._across)

    def nearest(self, place: FloatArray) -> Nearest:
        """See `Obstacle`."""
        offset = self._offset(place)
        size = np.maximum(np.sqrt((offset * offset).sum(axis=1)), _LEAST)
        normal = offset / size[:, np.newaxis]
        turn = self._across - normal[:, :, np.newaxis] * normal[:, np.newaxis]
        return Nearest(size - self.radius, normal, turn / size[:, np.newaxis, np.newaxis])

    def has_between(self, before: FloatArray, after: FloatArray, radius: FloatArray) -> BoolArray:
        """See `Obstacle`: whether they pass centre or axis within half of both radii."""
        start = self._offset(before)
        motion = self._offset(after) - start
        squared = np.maximum((motion * motion).sum(axis=1), _LEAST**2)
        part = np.clip(-(start * motion).sum(axis=1) / squared, 0.0, 1.0)
        least = start + part[:, np.newaxis] * motion
        return np.asarray((least * least).sum(axis=1) < (0.5 * (self.radius + radius)) ** 2)


@dataclass(frozen=True)
class Sphere(_Round):
    """A ball.

    Attributes:
        centre: in base_frame [m].
        radius: [m], > 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    centre: Vector
    radius: float
    _place = 'centre'

    def __post_init__(self) -> None:
        self._check('Sphere')
        set_fields(
            self,
            centre=vector('Sphere.centre', self.centre, 'm'),
            radius=positive('Sphere.radius', self.radius, 'm'),
        )

    @property
    def _across(self) -> FloatArray:
        return np.eye(3)


@dataclass(frozen=True)
class Cylinder(_Round):
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


def _direction(name: str, value: object) -> Vector:
    given = np.array(vector(name, value, '-'))
    size = float(np.linalg.norm(given))
    if not (size > 0.0 and np.isfinite(size)):
        raise ArmDefinitionError(name, value, 'a direction, not zero')
    x, y, z = (given / size).tolist()
    return x, y, z
