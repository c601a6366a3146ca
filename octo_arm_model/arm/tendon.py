"""The tendons, the anchorages at which they end, and discs between which they are straight."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import BoolArray, FloatArray
from octo_arm_model.arm.limits import MAX_DISCS
from octo_arm_model.arm.profile import Constant, Linear, Profile
from octo_arm_model.arm.validation import (
    check_class,
    check_fields,
    finite,
    not_negative,
    positive,
    set_fields,
    whole,
)

QUARTERS = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
_MOST_QUARTERS = 2**20  # beyond 2**53 every number is a multiple of pi / 2, up to rounding
_OF_QUARTERS = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])  # cosines and sines


@dataclass(frozen=True)
class Tendon:
    """The path of a tendon through the cross sections, in polar coordinates.

    Attributes:
        offset: distance from the midline [m], >= 0, along s.
        angle: direction from the midline [rad], from n towards b, along s.
    """

    offset: Profile
    angle: Profile

    def __post_init__(self) -> None:
        for name, given in vars(self).items():
            check_class(f'tendon.{name}', given, Profile)

    def path(self, s: FloatArray) -> FloatArray:
        """Return offsets along n and b at ``s`` (n,) [m], and derivatives by s [-], (4, n)."""
        outward, offset = self.outward(s), self.offset.value(s)
        path = offset * outward
        path[2:] += self.offset.slope(s) * outward[:2]
        return path

    def outward(self, s: FloatArray) -> FloatArray:
        """Return directions along n and b at ``s`` (n,), and derivatives by s [1/m], (4, n)."""
        angle = self.angle.value(s)
        # Exactly 0 and +-1 at multiples of pi / 2, which are the angles of the paper's tendons.
        quarter = np.round(angle / QUARTERS[1])
        is_quarter = (angle == quarter * QUARTERS[1]) & (np.abs(quarter) <= _MOST_QUARTERS)
        exact = _OF_QUARTERS[:, np.where(is_quarter, quarter, 0.0).astype(int) % 4]
        cosine, sine = np.where(is_quarter, exact, [np.cos(angle), np.sin(angle)])
        slope = self.angle.slope(s)
        return np.stack([cosine, sine, -slope * sine, slope * cosine])

    @property
    def knots(self) -> tuple[float, ...]:
        """The arc coordinates at which the path is not smooth [m]."""
        return self.offset.knots + self.angle.knots


def check_angle(name: str, angle: object) -> float:
    """Return the ``angle`` of a direction as a float.

    Raises:
        ArmDefinitionError: if it is no finite number, or beyond 2 pi, as degrees would be.
    """
    expected = 'a finite angle within 2 pi of zero, in radians, not in degrees'
    radians = finite(name, angle, expected)
    if abs(radians) > 2.0 * math.pi:
        raise ArmDefinitionError(name, angle, expected)
    return radians


@dataclass(frozen=True)
class Section:
    """An anchorage cross section and the tendons that end at it (eq. 5).

    The four tendons of the paper are straight, along n, b, -n and -b. Other tendons are given by
    their angles and may wind about the midline as helices.

    Attributes:
        anchorage: arc coordinate l_i of the anchorage [m], > 0.
        offset_base: distance a_i of the tendons from the midline at the base [m], >= 0.
        offset_anchorage: distance b_i at the anchorage [m], >= 0.
        angles: direction of each tendon at the base [rad], from n towards b, within 2 pi of zero.
        twist: angle by which each tendon winds about the midline up to the anchorage [rad].

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    anchorage: float
    offset_base: float
    offset_anchorage: float
    angles: tuple[float, ...] = QUARTERS
    twist: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        offset = not_negative, 'distance', 'm'
        checks = {'offset_base': offset, 'offset_anchorage': offset, 'anchorage': (positive, 'm')}
        check_fields(self, 'section.', checks)
        check_class('section.angles', self.angles, Iterable)
        check_class('section.twist', self.twist, Iterable)
        angles = tuple(check_angle('section.angles', angle) for angle in self.angles)
        if not angles:
            raise ArmDefinitionError('section.angles', angles, 'at least one tendon')
        twist = tuple(finite('section.twist', t, 'a finite angle [rad]') for t in self.twist)
        if twist and len(twist) != len(angles):
            raise ArmDefinitionError(
                'section.twist', twist, f'{len(angles)} angles, one for each tendon, or none'
            )
        set_fields(self, angles=angles, twist=twist if any(twist) else ())

    def offset(self, s: ArrayLike) -> FloatArray:
        """Return the distance y_i(s) of the tendons from the midline [m] at ``s`` [m] (eq. 5)."""
        return self._offset.value(s)

    @property
    def _offset(self) -> Linear:
        return Linear(self.offset_base, self.offset_anchorage, self.anchorage)

    @property
    def is_papers(self) -> bool:
        """Whether this is a section of the paper, with straight tendons along n, b, -n and -b."""
        return self.angles == QUARTERS and not self.twist

    @property
    def tendons(self) -> tuple[Tendon, ...]:
        """The tendons, in the order of ``angles``."""
        return tuple(
            Tendon(self._offset, Linear(a, a + t, self.anchorage) if t else Constant(a))
            for a, t in zip(self.angles, self.twist or len(self.angles) * (0.0,), strict=True)
        )


@dataclass(frozen=True)
class RoutedSection:
    """An anchorage cross section and the tendons, of any path, that end at it.

    Attributes:
        anchorage: arc coordinate of the anchorage [m], > 0.
        tendons: the tendons, at least one.

    Raises:
        ArmDefinitionError: if a value is outside its range or a path ends before the anchorage.
    """

    anchorage: float
    tendons: tuple[Tendon, ...]
    is_papers = False  # only a `Section` can be a section of the paper

    def __post_init__(self) -> None:
        anchorage = positive('section.anchorage', self.anchorage, 'm')
        check_class('section.tendons', self.tendons, Iterable)
        set_fields(self, anchorage=anchorage, tendons=tuple(self.tendons))
        if not self.tendons:
            raise ArmDefinitionError('section.tendons', self.tendons, 'at least one tendon')
        for number, tendon in enumerate(self.tendons, start=1):
            check_class(f'section.tendons[{number}]', tendon, Tendon)
            tendon.offset.cover(f'section.tendons[{number}].offset', anchorage)
            tendon.angle.cover(f'section.tendons[{number}].angle', anchorage)


# Least distance of discs over the length of the arm; one nearer to an anchorage is the one there.
_LEAST_DISTANCE = 1e-9


@dataclass(frozen=True)
class Discs:
    """The discs of an arm, which are rigid unless they are thin.

    Attributes:
        s: arc coordinate of the face of each disc towards the tip [m], increasing; at most
            `MAX_DISCS`. An `Arm` adds one at every anchorage.
        thickness: thickness of each disc [m]; 0 for thin discs.
        mass: mass of each disc less that of the displaced fluid [kg]; 0 for thin discs.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    s: tuple[float, ...] = ()
    thickness: float = 0.0
    mass: float = 0.0

    def __post_init__(self) -> None:
        check_class('tendons.discs', self.s, Iterable)
        s = tuple(positive('tendons.discs', face, 'm') for face in self.s)
        thickness = not_negative('tendons.disc_thickness', self.thickness, 'thickness', 'm')
        mass = not_negative('tendons.disc_mass', self.mass, 'mass', 'kg')
        set_fields(self, s=s, thickness=thickness, mass=mass)
        if list(s) != sorted(set(s)):
            raise ArmDefinitionError('tendons.discs', list(s), 'increasing arc coordinates [m]')
        if len(s) > MAX_DISCS:
            raise ArmDefinitionError('number of discs', len(s), f'at most {MAX_DISCS}')
        if thickness and not s:
            raise ArmDefinitionError('tendons.disc_thickness', thickness, '0 without discs')
        if mass and not thickness:
            raise ArmDefinitionError('tendons.disc_mass', mass, '0 of discs without a thickness')

    @classmethod
    def evenly(cls, count: int, length: float, thickness: float = 0.0, mass: float = 0.0) -> Discs:
        """Return ``count`` evenly spaced discs on an arm of a ``length`` [m], to the tip."""
        if whole('number of discs', count) > MAX_DISCS:
            raise ArmDefinitionError('number of discs', count, f'at most {MAX_DISCS}')
        s = tuple(length * (number / count) for number in range(1, count + 1))
        return cls(s, thickness, mass)

    def with_anchorages(self, anchorages: Iterable[float], length: float) -> Discs:
        """Return these discs and one at each of the ``anchorages``, on an arm of a ``length`` [m].

        Raises:
            ArmDefinitionError: if a disc is beyond the tip, or two discs touch.
        """
        if not self.s:
            return self
        ends, least = list(anchorages), _LEAST_DISTANCE * length
        between = {face for face in self.s if min(abs(face - end) for end in ends) > least}
        s = tuple(sorted(between.union(ends)))
        if s[-1] > length:
            expected = f'at most the length of the arm, {length} [m]'
            raise ArmDefinitionError('tendons.discs', s[-1], expected)
        for before, face in zip((0.0, *s), s):
            if not face - self.thickness > before + least:
                expected = f'more than {before + self.thickness:.6g} [m], as discs do not touch'
                raise ArmDefinitionError('tendons.discs', face, expected)
        return dataclasses.replace(self, s=s)

    @property
    def faces(self) -> tuple[float, ...]:
        """The arc coordinates of the faces of all discs, ascending [m]; a thin disc has one."""
        return tuple(sorted({*self.s, *(face - self.thickness for face in self.s)}))

    def cover(self, s: FloatArray) -> BoolArray:
        """Whether the cross sections at ``s`` (n,) [m] are within rigid discs, (n,)."""
        if not self.thickness:
            return np.zeros(s.shape, np.bool_)
        return np.asarray(np.searchsorted(self.faces, s) % 2 == 1)
