"""The arm: derived quantities, and invalid input."""

from __future__ import annotations

import math

import pytest

from octo_arm_model import Arm, ArmDefinitionError, Body, Material, OctoArmError, Section

MATERIAL = Material(1.1e5)
BODY = Body(0.4, 0.02, 0.01)


def arm_of(*sections: tuple[float, float, float], names: tuple[str, ...] = ()) -> Arm:
    return Arm(MATERIAL, BODY, tuple(Section(*section) for section in sections), names)


def test_tendons_are_named_by_section_and_number_unless_named():
    assert arm_of((0.4, 0.0, 0.0), (0.2, 0.0, 0.0)).tendon_names[3:5] == (
        'tendon_1_4',
        'tendon_2_1',
    )
    assert arm_of((0.4, 0.0, 0.0), names=tuple('ABCD')).tendon_names == ('A', 'B', 'C', 'D')


@pytest.mark.parametrize('given', [Section(0.4, 0.0, 0.0), None, 'sections', (0.4,)])
def test_sections_that_are_none_are_refused(given):
    with pytest.raises(ArmDefinitionError, match=r'^sections is .*, expected a sequence of'):
        Arm(MATERIAL, BODY, given)


@pytest.mark.parametrize('bad', [0.0, -1.0, math.nan, math.inf, -math.inf, '1', None, True, [1.0]])
@pytest.mark.parametrize(
    ('field', 'build'),
    [
        ('material.youngs_modulus', lambda bad: Material(bad)),
        ('body.length', lambda bad: Body(bad, 0.1, 0.1)),
        ('body.radius_base', lambda bad: Body(1.0, bad, 0.1)),
        ('body.radius_tip', lambda bad: Body(1.0, 0.1, bad)),
        ('section.anchorage', lambda bad: Section(bad, 0.1, 0.1)),
    ],
)
def test_what_must_be_positive_is_refused_otherwise(field, build, bad):
    with pytest.raises(ArmDefinitionError) as refusal:
        build(bad)
    assert str(refusal.value).startswith(f'{field} is {bad!r}, expected a finite number > 0 [')
    assert (refusal.value.field, refusal.value.value) == (field, bad) or bad is math.nan


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: Material(1e5, 0.51), 'material.poisson_ratio is 0.51, expected a number in'),
        (lambda: Material(1e5, -1.0), 'material.poisson_ratio is -1.0, expected a number in'),
        (lambda: Material(1e5, math.nan), 'material.poisson_ratio is nan, expected'),
        (lambda: Section(1.0, -1e-9, 0.0), 'section.offset_base is -1e-09, expected a finite'),
        (lambda: Section(1.0, 0.0, math.inf), 'section.offset_anchorage is inf, expected'),
        (lambda: arm_of(), 'sections is (), expected at least one section'),
        (
            lambda: arm_of((0.41, 0.0, 0.0)),
            'sections[1].anchorage is 0.41, expected at most the length of the arm, 0.4 [m]',
        ),
        (
            lambda: arm_of((0.2, 0.0, 0.0), (0.4, 0.0, 0.0)),
            'sections[2].anchorage is 0.4, expected less than that of the section before it, '
            '0.2 [m]: sections are listed from the tip to the base',
        ),
        (
            lambda: arm_of((0.2, 0.0, 0.0), (0.2, 0.0, 0.0)),
            'sections[2].anchorage is 0.2, expected less than',
        ),
        (
            lambda: arm_of((0.4, 0.0, 0.0), (0.2, 0.0201, 0.0)),
            'sections[2].offset_base is 0.0201, expected at most the radius of the body at '
            's = 0.0 m, 0.02 [m]',
        ),
        (
            lambda: arm_of((0.2, 0.0, 0.0151)),
            'sections[1].offset_anchorage is 0.0151, expected at most the radius of the body at '
            's = 0.2 m, 0.015 [m]',
        ),
        (
            lambda: arm_of((0.4, 0.0, 0.0), names=('A', 'B')),
            "tendon_names is ['A', 'B'], expected 4 names, one per tendon",
        ),
        (
            lambda: arm_of((0.4, 0.0, 0.0), names=('A', 'B', 'C', 'A')),
            "tendon_names is ['A', 'B', 'C', 'A'], expected distinct, non-empty names",
        ),
        (
            lambda: arm_of((0.4, 0.0, 0.0), names=('A', 'B', 'C', '')),
            "tendon_names is ['A', 'B', 'C', ''], expected distinct, non-empty names",
        ),
    ],
)
def test_refusals_name_field_value_and_expectation(build, message):
    with pytest.raises(ArmDefinitionError) as refusal:
        build()
    assert str(refusal.value).startswith(message)
    assert isinstance(refusal.value, (OctoArmError, ValueError))


# Rounding --------------------------------------------------------------------------------------


@pytest.mark.parametrize('length', [0.3, 0.45, 0.7, 1.1])
@pytest.mark.parametrize('base', [0.0033, 0.0075, 0.011])
def test_a_tendon_may_end_on_the_midline(length, base):
    section = Section(length, base, 0.0)
    assert Arm(MATERIAL, Body(length, 0.02, 1e-5), (section,)).length == length
    assert section.offset(length) == 0.0


# Texts and sizes -------------------------------------------------------------------------------


@pytest.mark.parametrize('name', ['a\0b', '\ud800', 'x' * 256, 5, b'a', True])
def test_names_are_texts_that_a_message_can_carry(name):
    with pytest.raises(ArmDefinitionError, match='expected distinct, non-empty names of at most'):
        arm_of((0.4, 0.0, 0.0), names=('a', 'b', 'c', name))  # type: ignore[arg-type]


def test_sections_and_tendons_have_a_bound():
    sections = [(0.4 - 1e-3 * i, 0.0, 0.0) for i in range(65)]
    assert len(arm_of(*sections[:64]).tendons) == 256
    with pytest.raises(ArmDefinitionError, match='number of sections is 65, expected at most 64'):
        arm_of(*sections)
    many = Section(0.4, 0.0, 0.0, angles=(0.0,) * 257)
    with pytest.raises(ArmDefinitionError, match='number of tendons is 257, expected at most 256'):
        Arm(MATERIAL, BODY, (many,))
