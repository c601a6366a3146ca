"""Profiles along the arm: values, slopes, and invalid input."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from octo_arm_model import ArmDefinitionError, Constant, Function, Linear, Table

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
def test_the_slope_is_the_derivative_of_the_value(profile):
    h = 1e-6
    inside = S[1:-1] + 1e-4  # not on a knot of the table
    difference = (profile.value(inside + h) - profile.value(inside - h)) / (2.0 * h)
    assert_allclose(profile.slope(inside), difference, atol=1e-7)


def test_the_slope_of_a_function_is_as_good_at_the_ends_and_asks_for_nothing_beyond():
    asked = []

    def recorded(s):
        asked.append(s)
        return 0.01 + 0.002 * np.sin(20.0 * s)

    slope = Function(recorded, 0.4).slope(S)
    assert_allclose(slope, 0.04 * np.cos(20.0 * S), atol=1e-7)
    assert min(map(np.min, asked)) >= -1e-12
    assert max(map(np.max, asked)) <= 0.4 + 1e-12


def test_a_table_passes_through_its_points_and_never_beyond_them():
    table = Table((0.0, 0.1, 0.2, 0.4), (0.02, 0.02, 0.005, 0.004))
    assert_allclose(table.value(table.s), table.values)
    values = table.value(S)
    assert values.max() <= 0.02 + 1e-12
    assert values.min() >= 0.004 - 1e-12
    assert table.knots == (0.1, 0.2)


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: Table((0.0,), (1.0,)), 'table.s is (0.0,), expected at least two'),
        (lambda: Table((0.1, 0.2), (1.0, 1.0)), 'table.s is (0.1, 0.2), expected at least two'),
        (lambda: Table((0.0, 0.2, 0.2), (1.0,) * 3), 'table.s is (0.0, 0.2, 0.2), expected'),
        (lambda: Table((0.0, 0.2), (1.0,)), 'table.values is (1.0,), expected 2 values'),
        (lambda: Table((0.0, 0.2), (1.0, math.nan)), 'table.values is (1.0, nan), expected'),
        (lambda: Table((0.0, 'x'), (1.0, 2.0)), "table.s is (0.0, 'x'), expected finite numbers"),
        (lambda: Table((0.0, 0.2), (1.0, 2.0), 'E').cover('E', 0.3), 'last s of E is 0.2, exp'),
        (lambda: WAVY.cover('radius', 0.5), 'last s of radius is 0.4, expected at least 0.5 [m]'),
    ],
)
def test_what_is_no_profile_is_refused(build, message):
    with pytest.raises(ArmDefinitionError) as refusal:
        build()
    assert str(refusal.value).startswith(message)


def test_a_table_has_a_bound_and_holds_numbers():
    s = tuple(range(1001))
    with pytest.raises(ArmDefinitionError, match=r'it\.s is \(0, 1, .*at most 1000 values'):
        Table(s, s, 'it')
    for values in ((True, 1.0), ('1', '2'), (1.0, None)):
        with pytest.raises(ArmDefinitionError, match='expected finite numbers'):
            Table((0.0, 1.0), values)  # type: ignore[arg-type]
