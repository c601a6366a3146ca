"""The arm: its material, its body and its tendons.

Sections are numbered from the tip, as in Renda et al. 2012: section 1 ends at the anchorage
farthest from the base. Offsets are in the axes n and b of the cross section (Fig. 4).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from octo_arm_model.arm.body import Body, ProfiledBody
from octo_arm_model.arm.consistency import check_profiles, check_sections
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import MAX_FRICTION, MAX_NAME, MAX_SECTIONS, MAX_TENDONS
from octo_arm_model.arm.material import Material
from octo_arm_model.arm.tendon import RoutedSection, Section, Tendon
from octo_arm_model.arm.validation import LARGEST, is_text, per_tendon


def check_size(sections: int, tendons: int) -> None:
    """Check the numbers of ``sections`` and of all ``tendons`` of an arm against their bounds.

    Raises:
        ArmDefinitionError: if one exceeds its bound.
    """
    for name, count, most in (
        ('number of sections', sections, MAX_SECTIONS),
        ('number of tendons', tendons, MAX_TENDONS),
    ):
        if count > most:
            raise ArmDefinitionError(name, count, f'at most {most}')


_SECTIONS = (Section, RoutedSection)


@dataclass(frozen=True)
class Arm:
    """An immutable, valid arm.

    Attributes:
        material: what it is made of.
        body: its outer shape.
        sections: anchorages **from the tip to the base**, at least one and at most
            `MAX_SECTIONS`, with `MAX_TENDONS` tendons in all.
        tendon_names: one per tendon, section by section; ``tendon_<i>_<j>`` unless given.
        axial_stiffness: E A of each tendon [N], 0 for an inextensible one. This and the next three
            are tuples of one number for all tendons or one per tendon; stored per tendon, or empty
            where all are zero.
        free_length: length of each tendon between the base and its winch [m].
        sheath_stiffness: of each tendon's sheath, per length [Pa], 0 for a tendon that cannot
            leave its path in the cross section.
        friction: Coulomb's coefficient mu of each tendon in its guides [-], at most
            `MAX_FRICTION`.

    Raises:
        ArmDefinitionError: if there is no section, an anchorage lies beyond the tip or out of
            order, a tendon leaves the body and its discs, a profile leaves its range, the names
            are not one per tendon and distinct, or a property of tendons is negative, too large
            or not one per tendon.
    """

    material: Material
    body: Body | ProfiledBody
    sections: tuple[Section | RoutedSection, ...]
    tendon_names: tuple[str, ...] = field(default=())
    axial_stiffness: tuple[float, ...] = ()
    free_length: tuple[float, ...] = ()
    sheath_stiffness: tuple[float, ...] = ()
    friction: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Validate the combination of the parts."""
        given = self.sections
        if not isinstance(given, Sequence) or not all(isinstance(s, _SECTIONS) for s in given):
            raise ArmDefinitionError('sections', given, 'a sequence of sections')
        object.__setattr__(self, 'sections', tuple(given))
        if not given:
            raise ArmDefinitionError('sections', given, 'at least one section')
        check_size(len(self.sections), sum(len(section.tendons) for section in self.sections))
        check_profiles(self.material, self.body)
        check_sections(self.sections, self.body)
        self._set_names(self.tendon_names)
        for name, what, unit, most in (
            ('axial_stiffness', 'stiffness', 'N', LARGEST),
            ('free_length', 'length', 'm', LARGEST),
            ('sheath_stiffness', 'stiffness', 'Pa', LARGEST),
            ('friction', 'coefficient', '-', MAX_FRICTION),
        ):
            values, count = getattr(self, name), len(self.tendons)
            checked = per_tendon(f'tendons.{name}', values, count, what, unit, most)
            object.__setattr__(self, name, checked)

    def _set_names(self, given: Sequence[str]) -> None:
        count = len(self.tendons)
        names = tuple(given) or tuple(
            f'tendon_{i}_{j}'
            for i, section in enumerate(self.sections, start=1)
            for j in range(1, len(section.tendons) + 1)
        )
        if len(names) != count:
            raise ArmDefinitionError('tendon_names', list(names), f'{count} names, one per tendon')
        if (
            isinstance(given, str)
            or not all(is_text(name) and name for name in names)
            or len(set(names)) < count
        ):
            expected = f'distinct, non-empty names of at most {MAX_NAME} characters, without NUL'
            raise ArmDefinitionError('tendon_names', list(names), expected)
        object.__setattr__(self, 'tendon_names', names)

    @property
    def length(self) -> float:
        """Reference length L [m]."""
        return self.body.length

    def with_density(self, density: float) -> Arm:
        """The same arm of another ``density`` [kg/m^3]."""
        return dataclasses.replace(
            self, material=dataclasses.replace(self.material, density=density)
        )

    @functools.cached_property
    def tendons(self) -> tuple[Tendon, ...]:
        """All tendons, section by section from the tip."""
        return tuple(tendon for section in self.sections for tendon in section.tendons)

    @functools.cached_property
    def tendon_section(self) -> IntArray:
        """Number of the section each tendon ends in, from the tip, (tendons,)."""
        counts = [len(section.tendons) for section in self.sections]
        return np.repeat(np.arange(1, len(counts) + 1), counts)

    def stretching_lengths(self, lengths: FloatArray) -> FloatArray:
        """Unloaded length of each tendon from its anchorage to its winch [m], (tendons,).

        ``lengths`` (tendons,) [m] are those within the unloaded arm.
        """
        return lengths + np.array(self.free_length or np.zeros(lengths.size))

    def tendon_compliance(self, lengths: FloatArray) -> FloatArray:
        """Axial compliance of each tendon up to its winch [m/N], (tendons,).

        ``lengths`` as for `stretching_lengths`.
        """
        return self.stretched(self.stretching_lengths(lengths))

    def stretched(self, tension_integrals: FloatArray) -> FloatArray:
        """Elongation of tendons [m] by the integrals of their tension [N m], (..., tendons)."""
        found = np.zeros_like(tension_integrals)
        if not self.axial_stiffness:
            return found
        stiffness = np.array(self.axial_stiffness)
        return np.divide(tension_integrals, stiffness, out=found, where=stiffness > 0.0)

    @functools.cached_property
    def tension_shape(self) -> tuple[int, ...]:
        """Shape of one set of tensions.

        (sections from the tip, tendons of a section); (tendons,) where sections differ in number.
        """
        counts = [len(section.tendons) for section in self.sections]
        if len(set(counts)) == 1:
            return len(counts), counts[0]
        return (sum(counts),)

    @functools.cached_property
    def knots(self) -> tuple[float, ...]:
        """Interior s at which material, body or a tendon's path is not smooth [m], ascending."""
        found = {*self.material.knots, *self.body.profile.knots}
        for tendon in self.tendons:
            found.update(tendon.knots)
        return tuple(sorted(s for s in found if 0.0 < s < self.length))

    def tendon_offsets(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets of all tendons from the midline at ``s`` (n,), whether they act there or not.

        Returns:
            Components along n and along b [m], each (tendons, n).
        """
        return self._at(s, Tendon.place)

    def tendon_slopes(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative of `tendon_offsets` with respect to s [-]."""
        return self._at(s, Tendon.slope)

    def tendon_outwards(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Directions of all tendons away from the midline, as `tendon_offsets` [-]."""
        return self._at(s, Tendon.outward)

    def tendon_outward_slopes(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative of `tendon_outwards` with respect to s [1/m]."""
        return self._at(s, Tendon.outward_slope)

    def _at(
        self, s: FloatArray, what: Callable[[Tendon, FloatArray], tuple[FloatArray, FloatArray]]
    ) -> tuple[FloatArray, FloatArray]:
        along_n, along_b = np.empty((2, len(self.tendons), s.size))
        ends = [section.anchorage for section in self.sections]
        for row, (tendon, section) in enumerate(
            zip(self.tendons, self.tendon_section, strict=True)
        ):
            # Beyond its anchorage the path of a tendon need not have values.
            inside = np.minimum(s, ends[section - 1])
            along_n[row], along_b[row] = what(tendon, inside)
        return along_n, along_b
