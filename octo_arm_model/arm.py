"""The arm: its material, its tapered body and its tendons.

Sections are numbered from the tip, as in Renda et al. 2012: section 1 ends at the anchorage
farthest from the base. The four tendons of a section run along +n, +b, -n and -b of the cross
section (Fig. 4), straight in the reference configuration (eq. 5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.errors import ArmDefinitionError
from octo_arm_model.hints import FloatArray

TENDONS_PER_SECTION = 4
# Direction of tendon j = 1..4 from the midline, as (n, b) components (eq. 6).
_DIRECTION_N = np.array([1.0, 0.0, -1.0, 0.0])
_DIRECTION_B = np.array([0.0, 1.0, 0.0, -1.0])


def _finite(name: str, value: object, expected: str = 'a finite number') -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise ArmDefinitionError(name, value, expected)
    try:
        number = float(value)
    except OverflowError:  # an integer beyond the range of floats
        number = math.inf
    if not math.isfinite(number):
        raise ArmDefinitionError(name, value, expected)
    return number


def _positive(name: str, value: object, unit: str) -> float:
    expected = f'a finite number > 0 [{unit}]'
    number = _finite(name, value, expected)
    if number <= 0.0:
        raise ArmDefinitionError(name, value, expected)
    return number


@dataclass(frozen=True)
class Material:
    """Linear elastic, isotropic material (eq. 3).

    Attributes:
        youngs_modulus: E [Pa], > 0.
        poisson_ratio: nu [-], in (-1, 0.5]; 0.5 is incompressible.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    youngs_modulus: float
    poisson_ratio: float = 0.5

    def __post_init__(self) -> None:
        """Validate."""
        modulus = _positive('material.youngs_modulus', self.youngs_modulus, 'Pa')
        expected = 'a number in (-1, 0.5] [-]'
        ratio = _finite('material.poisson_ratio', self.poisson_ratio, expected)
        if not -1.0 < ratio <= 0.5:
            raise ArmDefinitionError('material.poisson_ratio', self.poisson_ratio, expected)
        object.__setattr__(self, 'youngs_modulus', modulus)
        object.__setattr__(self, 'poisson_ratio', ratio)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))


@dataclass(frozen=True)
class Body:
    """Circular body whose radius varies linearly along s (eq. 7).

    Attributes:
        length: L [m], > 0.
        radius_base: R_max [m], > 0.
        radius_tip: R_min [m], > 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    length: float
    radius_base: float
    radius_tip: float

    def __post_init__(self) -> None:
        """Validate."""
        for name in ('length', 'radius_base', 'radius_tip'):
            number = _positive(f'body.{name}', getattr(self, name), 'm')
            object.__setattr__(self, name, number)

    def radius(self, s: ArrayLike) -> FloatArray:
        """Radius R(s) [m] at arc coordinate ``s`` [m] (eq. 7)."""
        taper = (self.radius_tip - self.radius_base) / self.length
        return self.radius_base + taper * np.asarray(s, dtype=np.float64)


@dataclass(frozen=True)
class Section:
    """One anchorage cross section and the four tendons fastened at it (eq. 5).

    Attributes:
        anchorage: arc coordinate l_i of the anchorage [m], > 0.
        offset_base: distance a_i of the tendons from the midline at the base [m], >= 0.
        offset_anchorage: distance b_i at the anchorage [m], >= 0.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    anchorage: float
    offset_base: float
    offset_anchorage: float

    def __post_init__(self) -> None:
        """Validate."""
        anchorage = _positive('section.anchorage', self.anchorage, 'm')
        object.__setattr__(self, 'anchorage', anchorage)
        for name in ('offset_base', 'offset_anchorage'):
            expected = 'a finite distance >= 0 [m]'
            offset = _finite(f'section.{name}', getattr(self, name), expected)
            if offset < 0.0:
                raise ArmDefinitionError(f'section.{name}', offset, expected)
            object.__setattr__(self, name, offset)

    @property
    def offset_slope(self) -> float:
        """Change of the tendons' distance per unit length, dy_i/ds [-]."""
        return (self.offset_anchorage - self.offset_base) / self.anchorage

    def offset(self, s: ArrayLike) -> FloatArray:
        """Distance y_i(s) of the tendons from the midline [m] (eq. 5)."""
        return self.offset_base + self.offset_slope * np.asarray(s, dtype=np.float64)


@dataclass(frozen=True)
class Arm:
    """An immutable, valid arm.

    Attributes:
        material: what it is made of.
        body: its outer shape.
        sections: anchorages **from the tip to the base**, at least one.
        tendon_names: one per tendon, section by section; ``tendon_<i>_<j>`` unless given.

    Raises:
        ArmDefinitionError: if an anchorage lies beyond the tip or out of order, a tendon leaves
            the body, or the names are not one per tendon and distinct.
    """

    material: Material
    body: Body
    sections: tuple[Section, ...]
    tendon_names: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        """Validate what concerns several parts at once."""
        object.__setattr__(self, 'sections', tuple(self.sections))
        if not self.sections:
            raise ArmDefinitionError('sections', self.sections, 'at least one section')
        previous = math.inf
        for number, section in enumerate(self.sections, start=1):
            self._check_section(number, section, previous)
            previous = section.anchorage
        self._set_names(self.tendon_names)

    def _check_section(self, number: int, section: Section, previous: float) -> None:
        where = f'sections[{number}]'
        if section.anchorage > self.body.length:
            raise ArmDefinitionError(
                f'{where}.anchorage',
                section.anchorage,
                f'at most the length of the arm, {self.body.length} [m]',
            )
        if section.anchorage >= previous:
            raise ArmDefinitionError(
                f'{where}.anchorage',
                section.anchorage,
                f'less than that of the section before it, {previous} [m]: '
                'sections are listed from the tip to the base',
            )
        # Offset and radius are both linear in s, so the two ends bound the whole tendon.
        for end, s, offset in (
            ('offset_base', 0.0, section.offset_base),
            ('offset_anchorage', section.anchorage, section.offset_anchorage),
        ):
            radius = float(self.body.radius(s))
            if offset > radius:
                raise ArmDefinitionError(
                    f'{where}.{end}',
                    offset,
                    f'at most the radius of the body at s = {s} m, {radius:.6g} [m]',
                )

    def _set_names(self, given: Sequence[str]) -> None:
        count = TENDONS_PER_SECTION * len(self.sections)
        names = tuple(given) or tuple(
            f'tendon_{i}_{j}'
            for i in range(1, len(self.sections) + 1)
            for j in range(1, TENDONS_PER_SECTION + 1)
        )
        if len(names) != count:
            raise ArmDefinitionError('tendon_names', list(names), f'{count} names, one per tendon')
        if (
            isinstance(given, str)
            or not all(isinstance(name, str) and name for name in names)
            or len(set(names)) < count
        ):
            raise ArmDefinitionError('tendon_names', list(names), 'distinct, non-empty names')
        object.__setattr__(self, 'tendon_names', names)

    @property
    def length(self) -> float:
        """Reference length L [m]."""
        return self.body.length

    @property
    def tension_shape(self) -> tuple[int, int]:
        """Shape of one set of tensions: (sections from the tip, tendons of a section)."""
        return len(self.sections), TENDONS_PER_SECTION

    def tendon_offsets(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets of all tendons from the midline at ``s`` (n,), whether they act there or not.

        Returns:
            Components along n and along b [m], each (tendons, n).
        """
        distance = np.stack([section.offset(s) for section in self.sections])[:, np.newaxis]
        return tuple(
            (distance * direction[:, np.newaxis]).reshape(-1, s.size)
            for direction in (_DIRECTION_N, _DIRECTION_B)
        )
