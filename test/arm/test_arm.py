"""The arm, its profiles and loads: derived quantities and invalid input."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    Config,
    Constant,
    DistributedLoad,
    Function,
    Linear,
    Loads,
    Material,
    OctoArmError,
    ProfiledBody,
    RoutedSection,
    Section,
    Table,
    Tendon,
    TensionError,
    load_config,
)
from octo_arm_model.arm.errors import in_short, listed, shown
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.rod.displacements import check_displacements
from octo_arm_model.rod.sensitivity import Uncertainty
from octo_arm_model.wire.tensions import values_by_name

MATERIAL = Material(1.1e5)
BODY = Body(0.4, 0.02, 0.01)
Z = (0.0, 0.0, 1.0)
DEGREES = {**load_parameters('renda2012_prototype'), 'tendons.angle': [0, 90, 180, 270]}


def arm_of(*sections: tuple[float, float, float], names: tuple[str, ...] = ()) -> Arm:
    return Arm(MATERIAL, BODY, tuple(Section(*section) for section in sections), names)


def named_arm(names):
    return arm_of((0.4, 0.0, 0.0), names=tuple(names))


def test_default_names_of_tendons_have_section_and_number():
    assert arm_of((0.4, 0.0, 0.0), (0.2, 0.0, 0.0)).tendon_names[3:5] == (
        'tendon_1_4',
        'tendon_2_1',
    )
    assert named_arm('ABCD').tendon_names == ('A', 'B', 'C', 'D')


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
def test_values_that_are_not_positive_are_refused(field, build, bad):
    with pytest.raises(ArmDefinitionError) as refusal:
        build(bad)
    assert str(refusal.value).startswith(f'{field} is {bad!r}, expected a finite number > 0 [')
    assert (refusal.value.field, refusal.value.value) == (field, bad) or bad is math.nan


def test_numbers_that_are_one_for_the_whole_arm_are_no_profiles():
    makes = (lambda one: Body(one, 1.0, 1.0), lambda one: Material(1e5, density=one))
    for make in (*makes, lambda one: Body(1.0, one, 1.0), lambda one: Body(1.0, 1.0, 1.0, one)):
        with pytest.raises(ArmDefinitionError, match=r'is Constant.*, expected a finite '):
            make(Constant(0.1))


@pytest.mark.parametrize('length', [0.3, 0.45, 0.7, 1.1])
@pytest.mark.parametrize('base', [0.0033, 0.0075, 0.011])
def test_tendon_can_end_on_the_midline(length, base):
    section = Section(length, base, 0.0)
    assert Arm(MATERIAL, Body(length, 0.02, 1e-5), (section,)).length == length
    assert section.offset(length) == 0.0


# Texts and sizes -------------------------------------------------------------------------------


@pytest.mark.parametrize('name', ['a\0b', '\ud800', 'x' * 256, '', 'a', 5, b'a', True])
def test_invalid_names_are_refused(name):
    with pytest.raises(ArmDefinitionError, match='expected distinct, non-empty names of at most'):
        named_arm(('a', 'b', 'c', name))  # type: ignore[arg-type]


def test_numbers_of_sections_and_tendons_are_bounded():
    sections = [(0.4 - 1e-3 * i, 0.0, 0.0) for i in range(65)]
    assert len(arm_of(*sections[:64]).tendons) == 256
    with pytest.raises(ArmDefinitionError, match='number of sections is 65, expected at most 64'):
        arm_of(*sections)
    many = Section(0.4, 0.0, 0.0, angles=(0.0,) * 257)
    with pytest.raises(ArmDefinitionError, match='number of tendons is 257, expected at most 256'):
        Arm(MATERIAL, BODY, (many,))


@pytest.mark.parametrize('part', [0.1, 0.02])
def test_bending_force_of_a_uniform_arm_equals_that_of_a_cantilever(part):
    # The tip of a cantilever moves by F L^3 / (3 E J).
    arm = Arm(Material(2e5), Body(0.3, 0.01, 0.01), (Section(0.3, 0.005, 0.005),))
    stiffness = 2e5 * 0.25 * np.pi * 0.01**4
    expected = 3.0 * stiffness * part / 0.3**2
    assert bending_force(arm, part) == pytest.approx(expected, rel=1e-3)


# Error messages: one line, bounded, and without control characters -------------------------------


# Clears the screen, starts a new line, and reverses the direction of writing.
HOSTILE = 'tendon\x1b[2J\n\u2028\u202e\x07'


def test_error_messages_have_no_control_characters():
    error = TensionError(HOSTILE * 100)
    for text in (shown(HOSTILE), listed([HOSTILE, 'tendon']), in_short(error)):
        assert text.isprintable()
        assert 'tendon' in text
    assert len(in_short(error)) <= 300


def test_errors_show_names_without_control_characters():
    arm = load_config('renda2012_prototype').arm
    with pytest.raises(TensionError, match='more than once: tendon') as caught:
        values_by_name([HOSTILE, HOSTILE], [1.0, 2.0], 'tension')
    assert str(caught.value).isprintable()
    with pytest.raises(TensionError, match="more than once: ''"):
        values_by_name(['', ''], [1.0, 2.0], 'tension')
    with pytest.raises(TensionError, match='unknown tendon tendon') as caught:
        check_displacements(arm, {HOSTILE: 0.1}, {})
    assert str(caught.value).isprintable()


@pytest.mark.parametrize('value', [math.nan, -0.1, 'much', True])
@pytest.mark.parametrize('name', ['tension', 'model_rotation', 'displacement'])
def test_invalid_uncertainty_is_refused(name, value):
    with pytest.raises(
        ArmDefinitionError, match=f'uncertainty.{name} is .*, expected a finite st'
    ):
        Uncertainty(**{name: value})


# Profiles along the arm --------------------------------------------------------------------------


S = np.linspace(0.0, 0.4, 41)
WAVY = Function(lambda s: 0.01 + 0.002 * np.sin(20.0 * s), 0.4)
PROFILES = [
    Constant(0.02),
    Linear(0.02, 0.005, 0.4),
    Table((0.0, 0.1, 0.25, 0.4), (0.02, 0.012, 0.011, 0.004)),
    WAVY,
    Function(lambda s: s**2, 0.4, lambda s: 2.0 * s),
]


@pytest.mark.parametrize('profile', PROFILES, ids=lambda profile: type(profile).__name__)
def test_slope_equals_finite_differences(profile):
    h = 1e-6
    inside = S[1:-1] + 1e-4  # between the knots of the table
    difference = (profile.value(inside + h) - profile.value(inside - h)) / (2.0 * h)
    assert_allclose(profile.slope(inside), difference, atol=1e-7)


def test_slope_of_a_function_is_accurate_at_the_ends_and_evaluates_nothing_beyond():
    evaluated = []

    def function(s):
        evaluated.append(s)
        return 0.01 + 0.002 * np.sin(20.0 * s)

    slope = Function(function, 0.4).slope(S)
    assert_allclose(slope, 0.04 * np.cos(20.0 * S), atol=1e-7)
    assert min(map(np.min, evaluated)) >= -1e-12
    assert max(map(np.max, evaluated)) <= 0.4 + 1e-12


def test_table_interpolates_without_overshoot():
    table = Table((0.0, 0.1, 0.2, 0.4), (0.02, 0.02, 0.005, 0.004))
    assert_allclose(table.value(table.s), table.values)
    values = table.value(S)
    assert values.max() <= 0.02 + 1e-12
    assert values.min() >= 0.004 - 1e-12
    assert table.knots == (0.1, 0.2)


def test_tables_are_bounded_and_numeric():
    s = tuple(range(1001))
    with pytest.raises(ArmDefinitionError, match=r'it\.s is \(0, 1, .*at most 1000 values'):
        Table(s, s, 'it')
    for values in ((True, 1.0), ('1', '2'), (1.0, None)):
        with pytest.raises(ArmDefinitionError, match='expected finite numbers'):
            Table((0.0, 1.0), values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: Material(1e5, 0.51), 'material.poisson_ratio is 0.51, expected a number in'),
        (lambda: Material(1e5, -1.0), 'material.poisson_ratio is -1.0, expected a number in'),
        (lambda: Material(1e5, math.nan), 'material.poisson_ratio is nan, expected'),
        (lambda: Section(1.0, -1e-9, 0.0), 'section.offset_base is -1e-09, expected a finite'),
        (lambda: Section(1.0, 0.0, math.inf), 'section.offset_anchorage is inf, expected'),
        (lambda: arm_of(), 'sections is (), expected a sequence of at least one section'),
        (lambda: Section(0.4, 0.0, 0.0, angles=(0.0, 90.0)), 'section.angles is 90.0, expected'),
        (
            lambda: Config.from_parameters(DEGREES),
            'tendons.angle[1] is 90.0, expected a finite angle within 2 pi of zero, in radians',
        ),
        (lambda: arm_of((0.41, 0.0, 0.0)), 'sections[1].anchorage is 0.41, expected at most the'),
        (
            lambda: arm_of((0.2, 0.0, 0.0), (0.4, 0.0, 0.0)),
            'sections[2].anchorage is 0.4, expected less than that of the section before it, '
            '0.2 [m]: sections are listed from the tip to the base',
        ),
        (lambda: arm_of((0.2, 0, 0), (0.2, 0, 0)), 'sections[2].anchorage is 0.2, expected les'),
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
        (lambda: named_arm('AB'), "tendon_names is ['A', 'B'], expected 4 names, one per tendon"),
        (lambda: Table((0.0,), (1.0,)), 'table.s is (0.0,), expected at least two'),
        (lambda: Table((0.1, 0.2), (1.0, 1.0)), 'table.s is (0.1, 0.2), expected at least two'),
        (lambda: Table((0.0, 0.2, 0.2), (1.0,) * 3), 'table.s is (0.0, 0.2, 0.2), expected'),
        (lambda: Table((0.0, 0.2), (1.0,)), 'table.values is (1.0,), expected 2 values'),
        (lambda: Table((0.0, 0.2), (1.0, math.nan)), 'table.values is (1.0, nan), expected'),
        (lambda: Table((0.0, 'x'), (1.0, 2.0)), "table.s is (0.0, 'x'), expected finite numbers"),
        (lambda: Table((0.0, 0.2), (1.0, 2.0), 'E').cover('E', 0.3), 'last s of E is 0.2, exp'),
        (lambda: Arm(MATERIAL, BODY, (0.4,)), 'sections is (0.4,), expected a sequence of'),
        (
            lambda: Arm(MATERIAL, Body(0.4, 15.0, 8.0), (Section(0.4, 0.0, 0.0),)),
            'body.radius at s = 0 m is 15.0, expected a finite number > 0 and at most the length',
        ),
        (lambda: Loads(points=Z), 'loads.points is (0.0, 0.0, 1.0), expected a list of PointLoad'),
        (lambda: Loads(distributed=[Z]), 'loads.distributed is [(0.0, 0.0, 1.0)], expected a l'),
        (lambda: Loads(others=[Z]), 'loads.others is [(0.0, 0.0, 1.0)], expected a list of Load'),
        (lambda: Loads(scaled=[Loads()]), 'loads.scaled is [Loads('),
        (lambda: DistributedLoad(0.1, Z), 'loads.distributed is 0.1, expected lists of s and of'),
        (lambda: DistributedLoad((0.0, 0.1), 1.0), 'loads.distributed is 1.0, expected lists of'),
        (lambda: Arm(None, BODY, ()), 'material is None, expected an instance of Material'),
        (lambda: Arm(MATERIAL, 0.4, ()), 'body is 0.4, expected an instance of Body'),
        (lambda: ProfiledBody(0.4, 0.01), 'body.profile is 0.01, expected an instance of Profile'),
        (lambda: Tendon(0.01, 0.0), 'tendon.offset is 0.01, expected an instance of Profile'),
        (lambda: RoutedSection(0.3, (0.01,)), 'section.tendons[1] is 0.01, expected an instance'),
        (lambda: Section(0.3, 0.0, 0.0, 1.0), 'section.angles is 1.0, expected an instance of It'),
        (lambda: Constant('1'), "constant is '1', expected a finite number"),
        (lambda: Linear(0.0, None, 1.0), 'linear.stop is None, expected a finite number'),
        (lambda: WAVY.cover('radius', 0.5), 'last s of radius is 0.4, expected at least 0.5 [m]'),
    ],
)
def test_errors_name_field_value_and_expectation(build, message):
    with pytest.raises(ArmDefinitionError) as refusal:
        build()
    assert str(refusal.value).startswith(message)
    assert isinstance(refusal.value, (OctoArmError, ValueError))
