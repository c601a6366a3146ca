"""The arm: its material, its body and its tendons.

Sections are numbered from the tip, as in Renda et al. 2012: section 1 ends at the anchorage
farthest from the base. Offsets are in the axes n and b of the cross section (Fig. 4).
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.body import Body, GivenStiffness, ProfiledBody, RectangularBody, RestShape
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import MAX_FRICTION, MAX_NAME, MAX_SECTIONS, MAX_TENDONS
from octo_arm_model.arm.material import Material
from octo_arm_model.arm.profile import as_profile
from octo_arm_model.arm.tendon import Discs, RoutedSection, Section, Tendon
from octo_arm_model.arm.validation import (
    LARGEST,
    SMALLEST,
    check_class,
    is_text,
    not_negative,
    set_fields,
)

_CHECKED = 257  # number of arc coordinates at which profiles are checked, besides their knots
# Allowed distance of a tendon from the body by rounding, relative to the radius of the base.
_ROUNDING = 1e-12
# Least distance of anchorages, relative to their arc coordinate: an element between nearer ones
# would be as short as rounding.
_LEAST_DISTANCE = 1e-9


@dataclass(frozen=True)
class Arm:
    """An immutable, valid arm.

    Attributes:
        material: the material.
        body: the outer shape.
        sections: anchorages **from the tip to the base**, at least one and at most
            `MAX_SECTIONS`, with `MAX_TENDONS` tendons in all.
        tendon_names: one per tendon, section by section; ``tendon_<i>_<j>`` unless given.
        axial_stiffness: E A of each tendon [N], 0 for an inextensible one. This and the next three
            are tuples of one number for all tendons or one per tendon; stored per tendon, or
            empty if all are zero.
        free_length: length of each tendon between the base and its winch [m].
        sheath_stiffness: stiffness per length of the sheath of each tendon [Pa], 0 for a tendon
            that cannot leave its path in the cross section.
        friction: Coulomb's coefficient mu of each tendon in its guides [-], at most
            `MAX_FRICTION`.
        stiffness: measured stiffness of the cross sections, in place of that by body and material.
        rest: shape of the arm when nothing acts on it.
        discs: discs that guide the tendons, one at every anchorage among them; none if the body
            guides the tendons all along.

    Raises:
        ArmDefinitionError: if a part is of a wrong class, there is no section, an anchorage lies
            beyond the tip or out of order, a tendon leaves the body and its discs, a profile
            leaves its range, the names are not one per tendon and distinct, a property of tendons
            is negative, too large or not one per tendon, or discs do not fit the arm or have
            sheaths.
    """

    material: Material
    body: Body | ProfiledBody | RectangularBody
    sections: tuple[Section | RoutedSection, ...]
    tendon_names: tuple[str, ...] = ()
    axial_stiffness: tuple[float, ...] = ()
    free_length: tuple[float, ...] = ()
    sheath_stiffness: tuple[float, ...] = ()
    friction: tuple[float, ...] = ()
    stiffness: GivenStiffness = dataclasses.field(default_factory=GivenStiffness)
    rest: RestShape = dataclasses.field(default_factory=RestShape)
    discs: Discs = dataclasses.field(default_factory=Discs)

    def __post_init__(self) -> None:
        given, kinds = self.sections, (Section, RoutedSection)
        check_class('material', self.material, Material)
        check_class('body', self.body, Body, ProfiledBody, RectangularBody)
        check_class('stiffness', self.stiffness, GivenStiffness)
        check_class('rest', self.rest, RestShape)
        check_class('discs', self.discs, Discs)
        check_class('tendon_names', self.tendon_names, Iterable)
        is_sequence = isinstance(given, Sequence)
        if not (is_sequence and given and all(isinstance(section, kinds) for section in given)):
            raise ArmDefinitionError('sections', given, 'a sequence of at least one section')
        set_fields(self, sections=tuple(given))
        check_size(len(self.sections), sum(len(section.tendons) for section in self.sections))
        self._check_profiles()
        before = math.inf
        for number, section in enumerate(self.sections, start=1):
            self._check_section(f'sections[{number}]', section, before)
            before = section.anchorage
        self._check_rest()
        set_fields(
            self,
            tendon_names=self._names(),
            axial_stiffness=self._per_tendon('axial_stiffness', 'stiffness', 'N'),
            free_length=self._per_tendon('free_length', 'length', 'm'),
            sheath_stiffness=self._per_tendon('sheath_stiffness', 'stiffness', 'Pa'),
            friction=self._per_tendon('friction', 'coefficient', '-', MAX_FRICTION),
            discs=self.discs.with_anchorages((end.anchorage for end in given), self.length),
        )
        if self.discs.s and self.sheath_stiffness:
            expected = 'none with discs, whose holes hold the tendons'
            raise ArmDefinitionError('tendons.sheath_stiffness', self.sheath_stiffness, expected)

    def _check_profiles(self) -> None:
        """Check that radii and elastic constants are in range all along the arm."""
        bore = self.body.inner_radius
        stiffness = self.stiffness.profiles.items()
        size = f'> 0 and at most the length, {self.length} [m]'
        for name, given, low, high, expected in (
            *((name, width, 0.0, self.length, size) for name, width in self.body.profiles.items()),
            ('body.inner_radius', bore, -SMALLEST, math.inf, '>= 0 [m]'),
            ('material.youngs_modulus', self.material.youngs_modulus, 0.0, math.inf, '> 0 [Pa]'),
            ('material.poisson_ratio', self.material.poisson_ratio, -1.0, 0.5, 'in (-1, 0.5] [-]'),
            *((f'stiffness.{name}', value, 0.0, math.inf, '> 0') for name, value in stiffness),
        ):
            profile = as_profile(given)
            profile.cover(name, self.length)
            s = _places(profile.knots, self.length)
            values = profile.value(s)
            bad = ~((values > low) & (values <= high) & np.isfinite(values))
            if bad.any():
                first = int(np.argmax(bad))
                raise ArmDefinitionError(
                    f'{name} at s = {s[first]:.6g} m',
                    float(values[first]),
                    f'a finite number {expected} all along the arm',
                )
        s = _places(self.knots, self.length)
        bad = as_profile(bore).value(s) >= (radius := self.body.radius(s))
        if bad.any():
            first = int(np.argmax(bad))
            raise ArmDefinitionError(
                f'body.inner_radius at s = {s[first]:.6g} m',
                float(as_profile(bore).value(s)[first]),
                f'less than the radius of the body there, {radius[first]:.6g} [m]',
            )

    def _check_rest(self) -> None:
        """Check that all fibres of the body and all tendons have lengths > 0 at rest."""
        if not self.rest.is_straight:
            s = _places(self.knots, self.length)
            ends = np.array([section.anchorage for section in self.sections])
            is_before_end = s <= ends[self.tendon_section - 1][:, np.newaxis]
            farthest = (np.hypot(*self.tendon_offsets(s)) * is_before_end).max(axis=0)
            self.rest.check(self.length, s, np.maximum(self.body.radius(s), farthest))

    def _check_section(self, where: str, section: Section | RoutedSection, before: float) -> None:
        """Check the tendons of a ``section``, and its anchorage against the one ``before`` [m]."""
        end = section.anchorage
        if end > self.length:
            expected = f'at most the length of the arm, {self.length} [m]'
            raise ArmDefinitionError(f'{where}.anchorage', end, expected)
        if end > before * (1.0 - _LEAST_DISTANCE):
            raise ArmDefinitionError(
                f'{where}.anchorage',
                end,
                f'less than that of the section before it, {before} [m]: '
                'sections are listed from the tip to the base',
            )
        if isinstance(section, Section):
            # The ends first, with the names of their parameters: they bound a straight tendon.
            self._check_inside(f'{where}.offset_base', section.tendons[0], np.zeros(1))
            self._check_inside(f'{where}.offset_anchorage', section.tendons[0], np.array([end]))
        for index, tendon in enumerate(section.tendons, start=1):
            s = _places(tendon.knots + self.body.knots, end)
            self._check_inside(f'{where}.tendons[{index}].offset', tendon, s)

    def _check_inside(self, name: str, tendon: Tendon, s: FloatArray) -> None:
        """Check that a ``tendon`` is within the body or its discs at ``s`` (n,) [m]."""
        offset, radius, discs = tendon.offset.value(s), self.body.radius(s), self.body.disc_radius
        limit = np.maximum(radius, discs)
        rounding = _ROUNDING * np.maximum(self.body.radius(0.0), limit)
        bad = ~((offset >= 0.0) & (offset <= limit + rounding))
        if not self.body.is_round:
            outside = np.abs(tendon.path(s)[:2]) > self.body.half_sizes(s) + rounding
            bad |= outside.any(axis=0) & (offset > discs + rounding)
        if bad.any():
            first = int(np.argmax(bad))
            where, most = f'at s = {s[first]} m', f'{limit[first]:.6g} [m]'
            if discs > radius[first]:
                expected = f'at most the radius of the discs {where}, {most}'
            elif self.body.is_round:
                expected = f'at most the radius of the body {where}, {most}, or body.disc_radius'
            else:
                width, height = 2.0 * self.body.half_sizes(s[first])
                expected = f'such that the tendon is within the body {where}, '
                expected += f'{width:.6g} by {height:.6g} [m]'
            raise ArmDefinitionError(name, float(offset[first]), expected)

    def _names(self) -> tuple[str, ...]:
        """Return the names of the tendons, checked, or the default names."""
        given, count = self.tendon_names, len(self.tendons)
        names = tuple(given) or tuple(
            f'tendon_{i}_{j}'
            for i, section in enumerate(self.sections, start=1)
            for j in range(1, len(section.tendons) + 1)
        )
        if len(names) != count:
            raise ArmDefinitionError('tendon_names', list(names), f'{count} names, one per tendon')
        texts = {name for name in names if is_text(name) and name}
        if isinstance(given, str) or len(texts) < count:
            expected = f'distinct, non-empty names of at most {MAX_NAME} characters, without NUL'
            raise ArmDefinitionError('tendon_names', list(names), expected)
        return names

    def _per_tendon(
        self, field: str, what: str, unit: str, most: float = LARGEST
    ) -> tuple[float, ...]:
        """Return the numbers >= 0 of a ``field``, one per tendon; empty if all are zero."""
        name, given, count = f'tendons.{field}', getattr(self, field), len(self.tendons)
        if isinstance(given, np.ndarray):
            given = given.tolist()
        expected = f'a list of one number for all tendons or of {count}, one for each'
        if isinstance(given, str) or not isinstance(given, Sequence):
            raise ArmDefinitionError(name, given, expected)
        numbers = tuple(not_negative(name, value, what, unit, most) for value in given)
        if len(numbers) not in (0, 1, count):
            raise ArmDefinitionError(name, list(numbers), expected)
        if len(numbers) == 1:
            numbers = count * numbers
        return numbers if any(numbers) else ()

    @property
    def length(self) -> float:
        """The reference length L [m]."""
        return self.body.length

    def with_density(self, density: float) -> Arm:
        """Return this arm with another ``density`` [kg/m^3]."""
        material = dataclasses.replace(self.material, density=density)
        return dataclasses.replace(self, material=material)

    @functools.cached_property
    def tendons(self) -> tuple[Tendon, ...]:
        """All tendons, section by section from the tip to the base."""
        return tuple(tendon for section in self.sections for tendon in section.tendons)

    @functools.cached_property
    def tendon_section(self) -> IntArray:
        """The number of the section in which each tendon ends, from 1 at the tip, (tendons,)."""
        counts = [len(section.tendons) for section in self.sections]
        return np.repeat(np.arange(1, len(counts) + 1), counts)

    def stretching_lengths(self, lengths: FloatArray) -> FloatArray:
        """Return the unloaded length of each tendon from anchorage to winch [m], (tendons,).

        ``lengths`` (tendons,) [m] are those within the unloaded arm.
        """
        return lengths + np.array(self.free_length or 0.0)

    def tendon_compliance(self, lengths: FloatArray) -> FloatArray:
        """Return the axial compliance of each tendon from anchorage to winch [m/N], (tendons,).

        ``lengths`` (tendons,) [m] are those within the unloaded arm.
        """
        return self.stretched(self.stretching_lengths(lengths))

    def stretched(self, tension_integrals: FloatArray) -> FloatArray:
        """Return elongations of tendons [m] by integrals of tension [N m], both (..., tendons)."""
        stiffness = np.array(self.axial_stiffness or 0.0)
        return tension_integrals / np.where(stiffness > 0.0, stiffness, math.inf)

    @functools.cached_property
    def tension_shape(self) -> tuple[int, ...]:
        """The shape of the array of one set of tensions.

        (sections from the tip, tendons of a section), or (tendons,) if these numbers differ.
        """
        counts = [len(section.tendons) for section in self.sections]
        if len(set(counts)) == 1:
            return len(counts), counts[0]
        return (sum(counts),)

    @functools.cached_property
    def knots(self) -> tuple[float, ...]:
        """The interior s at which material, body or a path is not smooth [m], ascending."""
        knots = {*self.material.knots, *self.body.knots, *self.rest.knots}
        knots.update(s for profile in self.stiffness.profiles.values() for s in profile.knots)
        knots.update(s for tendon in self.tendons for s in tendon.knots)
        return tuple(sorted(s for s in knots if 0.0 < s < self.length))

    def tendon_offsets(self, s: FloatArray) -> FloatArray:
        """Return offsets of all tendons from the midline at ``s`` (n,), past their anchorages too.

        Returns:
            Components along n and along b [m], (2, tendons, n).
        """
        return self.tendon_paths(s)[:2]

    def tendon_paths(self, s: FloatArray) -> FloatArray:
        """Return `tendon_offsets` [m] and their derivatives by s [-], (4, tendons, n)."""
        return self._at(s, Tendon.path)

    def tendon_outwards(self, s: FloatArray) -> FloatArray:
        """Return directions from the midline to all tendons at ``s`` (n,) [m].

        Returns:
            Components along n and b [-], and their derivatives by s [1/m], (4, tendons, n).
        """
        return self._at(s, Tendon.outward)

    def _at(self, s: FloatArray, field: Callable[[Tendon, FloatArray], FloatArray]) -> FloatArray:
        # Beyond its anchorage the path of a tendon need not have values.
        ends = [section.anchorage for section in self.sections for _ in section.tendons]
        values = [field(tendon, np.minimum(s, end)) for tendon, end in zip(self.tendons, ends)]
        return np.stack(values, axis=1)


def check_size(sections: int, tendons: int) -> None:
    """Check the numbers of ``sections`` and of all ``tendons`` of an arm against their bounds.

    Raises:
        ArmDefinitionError: if a number exceeds its bound.
    """
    if sections > MAX_SECTIONS:
        raise ArmDefinitionError('number of sections', sections, f'at most {MAX_SECTIONS}')
    if tendons > MAX_TENDONS:
        raise ArmDefinitionError('number of tendons', tendons, f'at most {MAX_TENDONS}')


def _places(knots: Sequence[float], stop: float) -> FloatArray:
    """Return arc coordinates up to ``stop`` at which to check a profile with ``knots`` [m]."""
    inside = [s for s in knots if s < stop]
    return np.union1d(np.linspace(0.0, stop, _CHECKED), inside)
