"""Tendons and the anchorage cross sections at which they end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.profile import Constant, Linear, Profile
from octo_arm_model.arm.validation import finite, not_negative, positive, set_fields

QUARTERS = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
_MOST_QUARTERS = 2**20  # beyond 2**53 every number is a multiple of pi / 2, up to rounding
_OF_QUARTERS = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])  # cosines and sines


@dataclass(frozen=True)
class Tendon:
    """Path of a tendon in the cross sections it passes, in polar coordinates.

    Attributes:
        offset: distance from the midline along s [m], >= 0.
        angle: direction from the midline along s [rad], from n towards b.
    """

    offset: Profile
    angle: Profile

    def place(self, s: FloatArray) -> FloatArray:
        """Components of the offset along n and b at ``s`` (n,) [m], (2, n)."""
        return self.offset.value(s) * self.outward(s)

    def slope(self, s: FloatArray) -> FloatArray:
        """Derivative of `place` with respect to s [-]."""
        turned = self.offset.value(s) * self.outward_slope(s)
        return self.offset.slope(s) * self.outward(s) + turned

    def outward(self, s: FloatArray) -> FloatArray:
        """Components of the direction away from the midline along n and b, (2, n)."""
        angle = self.angle.value(s)
        # Exactly 0 and +-1 at multiples of pi / 2, the angles of the paper's tendons.
        quarter = np.round(angle / QUARTERS[1])
        is_quarter = (angle == quarter * QUARTERS[1]) & (np.abs(quarter) <= _MOST_QUARTERS)
        exact = _OF_QUARTERS[:, np.where(is_quarter, quarter, 0.0).astype(int) % 4]
        return np.where(is_quarter, exact, [np.cos(angle), np.sin(angle)])

    def outward_slope(self, s: FloatArray) -> FloatArray:
        """Derivative of `outward` with respect to s [1/m]."""
        cosine, sine = self.outward(s)
        return self.angle.slope(s) * np.array([-sine, cosine])

    @property
    def knots(self) -> tuple[float, ...]:
        """Arc coordinates at which the path is not smooth [m]."""
        return self.offset.knots + self.angle.knots


@dataclass(frozen=True)
class Section:
    """One anchorage cross section and the tendons fastened at it (eq. 5).

    The paper's four tendons are straight, along n, b, -n and -b. Others are given by their angles
    and may wind about the midline as helices.

    Attributes:
        anchorage: arc coordinate l_i of the anchorage [m], > 0.
        offset_base: distance a_i of the tendons from the midline at the base [m], >= 0.
        offset_anchorage: distance b_i at the anchorage [m], >= 0.
        angles: direction of each tendon at the base [rad], from n towards b.
        twist: angle by which each has wound about the midline at the anchorage [rad].

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    anchorage: float
    offset_base: float
    offset_anchorage: float
    angles: tuple[float, ...] = QUARTERS
    twist: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        set_fields(
            self,
            anchorage=positive('section.anchorage', self.anchorage, 'm'),
            offset_base=not_negative('section.offset_base', self.offset_base, 'distance', 'm'),
            offset_anchorage=not_negative(
                'section.offset_anchorage', self.offset_anchorage, 'distance', 'm'
            ),
        )
        expected = 'a finite angle [rad]'
        angles = tuple(finite('section.angles', angle, expected) for angle in self.angles)
        if not angles:
            raise ArmDefinitionError('section.angles', angles, 'at least one tendon')
        twist = tuple(finite('section.twist', angle, expected) for angle in self.twist)
        if twist and len(twist) != len(angles):
            raise ArmDefinitionError(
                'section.twist', twist, f'{len(angles)} angles, one for each tendon, or none'
            )
        set_fields(self, angles=angles, twist=twist if any(twist) else ())

    @property
    def offset_slope(self) -> float:
        """Change of the tendons' distance per unit length, dy_i/ds [-]."""
        return (self.offset_anchorage - self.offset_base) / self.anchorage

    def offset(self, s: ArrayLike) -> FloatArray:
        """Distance y_i(s) of the tendons from the midline [m] (eq. 5)."""
        return self._offset.value(s)

    @property
    def _offset(self) -> Linear:
        return Linear(self.offset_base, self.offset_anchorage, self.anchorage)

    @property
    def is_papers(self) -> bool:
        """Whether this is a section of the paper: four straight tendons along n, b, -n, -b."""
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
    """One anchorage cross section and tendons of any path fastened at it.

    Attributes:
        anchorage: arc coordinate of the anchorage [m], > 0.
        tendons: the tendons, at least one.

    Raises:
        ArmDefinitionError: if a value is outside its range or a path ends before the anchorage.
    """

    anchorage: float
    tendons: tuple[Tendon, ...]
    is_papers = False  # a section of the paper is a `Section`

    def __post_init__(self) -> None:
        anchorage = positive('section.anchorage', self.anchorage, 'm')
        set_fields(self, anchorage=anchorage, tendons=tuple(self.tendons))
        if not self.tendons:
            raise ArmDefinitionError('section.tendons', self.tendons, 'at least one tendon')
        for number, tendon in enumerate(self.tendons, start=1):
            tendon.offset.cover(f'section.tendons[{number}].offset', anchorage)
            tendon.angle.cover(f'section.tendons[{number}].angle', anchorage)
