"""Discs that hold tendons, which are straight between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import BoolArray, FloatArray
from octo_arm_model.arm.limits import MAX_DISCS
from octo_arm_model.arm.validation import not_negative, positive, set_fields, whole

# Part of the length of an arm by which a disc and an anchorage are apart, or are one.
_APART = 1e-9


@dataclass(frozen=True)
class Discs:
    """The discs of an arm, rigid if they are not thin.

    Attributes:
        s: arc coordinate of the face of each that is towards the tip [m], increasing; at most
            `MAX_DISCS`. An `Arm` has one at every anchorage besides.
        thickness: of each [m]; 0 for thin ones.
        mass: of each, without that of the fluid that it displaces [kg]; 0 for thin ones.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    s: tuple[float, ...] = ()
    thickness: float = 0.0
    mass: float = 0.0

    def __post_init__(self) -> None:
        s = tuple(positive('tendons.discs', one, 'm') for one in self.s)
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
        """So many, at most `MAX_DISCS`, of an arm of a ``length`` [m], the last at its tip."""
        if whole('number of discs', count) > MAX_DISCS:
            raise ArmDefinitionError('number of discs', count, f'at most {MAX_DISCS}')
        s = tuple(length * (number / count) for number in range(1, count + 1))
        return cls(s, thickness, mass)

    def with_anchorages(self, anchorages: Iterable[float], length: float) -> Discs:
        """These and one at each of the ``anchorages``, on an arm of a ``length`` [m].

        Raises:
            ArmDefinitionError: if one is beyond the tip, or they are not apart.
        """
        if not self.s:
            return self
        ends, least = list(anchorages), _APART * length
        own = {one for one in self.s if min(abs(one - end) for end in ends) > least}
        s = tuple(sorted(own.union(ends)))
        if s[-1] > length:
            expected = f'at most the length of the arm, {length} [m]'
            raise ArmDefinitionError('tendons.discs', s[-1], expected)
        for before, one in zip((0.0, *s), s):
            if not one - self.thickness > before + least:
                expected = f'more than {before + self.thickness:.6g} [m], as discs do not touch'
                raise ArmDefinitionError('tendons.discs', one, expected)
        return dataclasses.replace(self, s=s)

    @property
    def faces(self) -> tuple[float, ...]:
        """Arc coordinates of both faces of every disc, ascending [m]; one of a thin one."""
        return tuple(sorted({*self.s, *(one - self.thickness for one in self.s)}))

    def cover(self, s: FloatArray) -> BoolArray:
        """Whether cross sections at ``s`` (n,) [m] are within discs that are not thin."""
        if not self.thickness:
            return np.zeros(s.shape, np.bool_)
        return np.asarray(np.searchsorted(self.faces, s) % 2 == 1)
