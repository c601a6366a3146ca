"""Validation of tensions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from octo_arm_model import Config, TensionError
from octo_arm_model.rod.inputs import check_tensions


def with_one(value: object) -> list:
    """Valid tensions except that of tendon 3 of section 2."""
    return [[0, 0, 0, 0], [0, 0, value, 0], [0, 0, 0, 0]]


@pytest.mark.parametrize('value', [-1.0, -1e-300, math.nan, math.inf, -math.inf])
def test_an_impossible_tension_names_its_tendon(table4: Config, value: float) -> None:
    message = f'tension of tendon_2_3 is {value!r} N, expected a finite number >= 0'
    with pytest.raises(TensionError) as refusal:
        check_tensions(table4.arm, with_one(value))
    assert str(refusal.value) == message


@pytest.mark.parametrize('shape', [(), (4,), (12,), (4, 3), (2, 4), (3, 3), (3, 4, 1)])
def test_a_wrong_shape_is_named_with_the_right_one(table4: Config, shape: tuple[int, ...]) -> None:
    with pytest.raises(TensionError) as refusal:
        check_tensions(table4.arm, np.zeros(shape))
    assert str(refusal.value) == (
        f'tensions have shape {shape}, expected (..., 3, 4): '
        '3 section(s) from the tip, 4 tendons each'
    )


@pytest.mark.parametrize(
    'bad',
    [
        [[1, 2, 3, 4], [1, 2]],
        'four',
        [[1, 2, 3, 'x']] * 3,
        {'a': 1},
        [[True, 2, 3, 4]] * 3,
        [[1, 2, 3, np.True_]] * 3,
        np.ones((3, 4), bool),
        [[None] * 4] * 3,
        [[True] * 4] * 3,
    ],
)
def test_what_is_not_rows_of_numbers_is_refused(table4: Config, bad: object) -> None:
    with pytest.raises(TensionError, match=r'numbers in rows of equal length.*\(\.\.\., 3, 4\)'):
        check_tensions(table4.arm, bad)  # type: ignore[arg-type]
