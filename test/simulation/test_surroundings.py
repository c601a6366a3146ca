"""A base that moves and water that flows, as they are told to: smooth, and within bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from octo_arm_model import Pose
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, LoadError
from octo_arm_model.rod.motion import base_of
from octo_arm_model.simulation.dynamic_arm import (
    FARTHEST,
    LAG,
    Surroundings,
    check_values,
    current_of,
    pose_of,
)

START = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))


def turned(angle: float, x: float = 1.0) -> Pose:
    return Pose((x, 2.0, 3.0), (0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle)))


@pytest.mark.parametrize('parts', [1, 7])
def test_two_lags_follow_what_is_told_whatever_the_steps(parts: int) -> None:
    around = Surroundings(START, (0.0, 0.1, 0.0))
    around.move_base(turned(0.2, 1.08))
    around.flow((0.0, 0.1, 0.5))
    time = 0.12
    for _ in range(parts):
        around.values = around.after(time / parts)
    # The step response of two lags in a row.
    part = 1.0 - (1.0 + time / LAG) * math.exp(-time / LAG)
    assert pose_of(around.values).position == pytest.approx((1.0 + 0.08 * part, 2.0, 3.0))
    np.testing.assert_allclose(current_of(around.values), (0.0, 0.1, 0.5 * part), atol=1e-12)
    around.values = around.after(50.0 * LAG)
    np.testing.assert_allclose(pose_of(around.values).quaternion, turned(0.2).quaternion)


def test_a_quaternion_of_the_other_sign_turns_nothing() -> None:
    around = Surroundings(turned(0.1), (0.0, 0.0, 0.0))
    around.move_base(Pose((1.0, 2.0, 3.0), tuple(-c for c in turned(0.1).quaternion)))
    around.values = around.after(0.05)
    np.testing.assert_allclose(pose_of(around.values).quaternion, turned(0.1).quaternion)


def test_jumps_and_what_is_not_finite_are_refused_and_change_nothing() -> None:
    around = Surroundings(START, (0.0, 0.0, 0.0))
    for pose in (turned(0.0, 1.001 + FARTHEST), turned(0.31), turned(3.0)):
        with pytest.raises(LoadError, match='rad from where the base is, expected'):
            around.move_base(pose)
    with pytest.raises(LoadError, match='the current is 11 m/s, expected at most 10 m/s'):
        around.flow((0.0, 11.0, 0.0))
    with pytest.raises(ArmDefinitionError, match=r'current is .* three finite numbers'):
        around.flow((0.0, math.nan, 0.0))
    assert not around.is_told
    np.testing.assert_array_equal(around.after(1.0), around.values)


def test_values_of_a_file_are_those_of_the_base_of_the_arm() -> None:
    around = Surroundings(START, (0.0, 0.0, 0.0))
    around.move_base(turned(0.29, 1.09))
    for _ in range(10):
        around.values = around.after(0.02)
        check_values(around.values, base_of(pose_of(around.values)))
    for row, column, value in ((0, 0, 5.0), (2, 3, 0.0), (1, 2, 1e300)):
        wrong = around.values.copy()
        wrong[row, column] = value
        with pytest.raises(ConfigError, match='are not those of the base'):
            check_values(wrong, base_of(pose_of(around.values)))
