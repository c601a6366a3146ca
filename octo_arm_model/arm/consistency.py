"""Consistency of the parts of an arm: material and body, sections and their tendons."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.body import Body, ProfiledBody
from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import Material
from octo_arm_model.arm.profile import as_profile
from octo_arm_model.arm.tendon import RoutedSection, Section, Tendon

# Number of arc coordinates at which profiles are checked, besides their knots.
_CHECKED = 257
# Rounding by which a tendon on the surface may lie outside the body, over the radius of the base.
_ROUNDING = 1e-12
_APART = 1e-9  # part of its place by which an anchorage is before the next at least


def check_profiles(material: Material, body: Body | ProfiledBody) -> None:
    """Check that radius and elastic constants are in range all along the ``body``.

    Raises:
        ArmDefinitionError: if a profile does not cover the arm or leaves its range.
    """
    for name, given, low, high, expected in (
        ('body.radius', body.profile, 0.0, math.inf, '> 0 [m]'),
        ('material.youngs_modulus', material.youngs_modulus, 0.0, math.inf, '> 0 [Pa]'),
        ('material.poisson_ratio', material.poisson_ratio, -1.0, 0.5, 'in (-1, 0.5] [-]'),
    ):
        profile = as_profile(given)
        profile.cover(name, body.length)
        s = _places(profile.knots, body.length)
        values = profile.value(s)
        bad = ~((values > low) & (values <= high) & np.isfinite(values))
        if bad.any():
            first = int(np.argmax(bad))
            raise ArmDefinitionError(
                f'{name} at s = {s[first]:.6g} m',
                float(values[first]),
                f'a finite number {expected} all along the arm',
            )


def check_sections(sections: Sequence[Section | RoutedSection], body: Body | ProfiledBody) -> None:
    """Check that ``sections`` follow each other from the tip, with all tendons in the ``body``.

    Raises:
        ArmDefinitionError: if an anchorage lies beyond the tip or out of order, or a tendon
            leaves the body and its discs.
    """
    previous = math.inf
    for number, section in enumerate(sections, start=1):
        _check_section(number, section, previous, body)
        previous = section.anchorage


def _check_section(
    number: int, section: Section | RoutedSection, previous: float, body: Body | ProfiledBody
) -> None:
    where = f'sections[{number}]'
    if section.anchorage > body.length:
        raise ArmDefinitionError(
            f'{where}.anchorage',
            section.anchorage,
            f'at most the length of the arm, {body.length} [m]',
        )
    # Nearer ones would have an element between them that is as long as rounding.
    if section.anchorage > previous * (1.0 - _APART):
        raise ArmDefinitionError(
            f'{where}.anchorage',
            section.anchorage,
            f'less than that of the section before it, {previous} [m]: '
            'sections are listed from the tip to the base',
        )
    if isinstance(section, Section):
        # Both ends first, with the names of their parameters: they bound a straight tendon.
        _check_inside(f'{where}.offset_base', section.tendons[0], np.zeros(1), body)
        end = np.array([section.anchorage])
        _check_inside(f'{where}.offset_anchorage', section.tendons[0], end, body)
    for index, tendon in enumerate(section.tendons, start=1):
        s = _places(tendon.knots + body.profile.knots, section.anchorage)
        _check_inside(f'{where}.tendons[{index}].offset', tendon, s, body)


def _check_inside(name: str, tendon: Tendon, s: FloatArray, body: Body | ProfiledBody) -> None:
    offset, radius = tendon.offset.value(s), body.radius(s)
    limit = np.maximum(radius, body.disc_radius)
    limit = limit + _ROUNDING * np.maximum(body.radius(0.0), limit)
    bad = ~((offset >= 0.0) & (offset <= limit))
    if bad.any():
        first = int(np.argmax(bad))
        what = 'the radius of the body'
        if body.disc_radius > radius[first]:
            what = 'the radius of the discs'
        most = max(float(radius[first]), body.disc_radius)
        raise ArmDefinitionError(
            name, float(offset[first]), f'at most {what} at s = {s[first]} m, {most:.6g} [m]'
        )


def _places(knots: Sequence[float], stop: float) -> FloatArray:
    inside = [s for s in knots if s < stop]
    return np.union1d(np.linspace(0.0, stop, _CHECKED), inside)
