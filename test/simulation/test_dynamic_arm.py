"""The simulated arm that moves: its sensors, its base and the water, and how it goes on."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from octo_arm_model import Loads, MotionProperties, Pose, SolveError, load_config
from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, LoadError
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.rod.motion import base_of
from octo_arm_model.simulation.dynamic_arm import (
    FARTHEST,
    LAG,
    DynamicArm,
    Surroundings,
    check_values,
    current_of,
    pose_of,
)
from octo_arm_model.simulation.pushed_arm import Push, PushedArm, Sensors
from octo_arm_model.simulation.simulator import SimulatorConfig, in_water

PLAIN = load_config('renda2012_table4')
CONFIG = dataclasses.replace(
    PLAIN, model='exact', arm=PLAIN.arm.with_density(1080.0), stations=101,
    loads=Loads((0.0, 0.0, -9.81), 1022.0), motion=MotionProperties(damping_time=0.3),
)  # fmt: skip
SENSORS = Sensors(marker_s=(0.1, 0.3), markers_rate=1.0)
TENSIONS, NONE = np.repeat([0.02, 0.1, 0.3], 4) * np.tile([1.0, 0.0, 0.0, 0.5], 3), np.zeros(3)


@pytest.mark.parametrize('s', [0.0, 0.2])
def test_sensors_end_with_what_they_read_of_the_arm_at_rest(s: float) -> None:
    force, push = np.array([0.0, 0.003, 0.002]), Push((0.0, 0.003, 0.002), s)
    arm, still = DynamicArm(CONFIG, push, SENSORS), PushedArm(CONFIG, push, SENSORS)
    arm.advance(np.zeros(12), NONE, 0.1)
    began = arm.tip_pose()
    for _ in range(110):
        arm.advance(TENSIONS, force, 0.1)
    still.advance(TENSIONS, force, 0.1)
    tip, expected = np.array(arm.tip_pose().position), np.array(still.tip_pose().position)
    assert np.linalg.norm(tip - began.position) > 0.05
    np.testing.assert_allclose(tip, expected, atol=2e-5)
    np.testing.assert_allclose(arm.markers(), still.markers(), atol=2e-5)
    np.testing.assert_allclose(arm.base_wrench(), still.base_wrench(), atol=2e-5)
    # Displacements are those of the static arm, which has tensions alone.
    assert arm.reeled_in()[8] > 0.0


def test_an_arm_goes_on_where_it_was_and_begins_anew_when_told() -> None:
    push = Push()
    arm = DynamicArm(CONFIG, push, SENSORS)
    with pytest.raises(SolveError, match='has not moved yet'):
        arm.tip_pose()
    arm.advance(np.zeros(12), NONE, 0.0)
    rest = arm.backbone.tip
    arm.advance(TENSIONS, NONE, 0.1)
    next_arm = DynamicArm(CONFIG, push, Sensors())
    assert not next_arm.go_on_from(arm)
    np.testing.assert_array_equal(next_arm.backbone.tip, arm.backbone.tip)
    other = DynamicArm(dataclasses.replace(CONFIG, loads=Loads()), push, SENSORS)
    assert not other.go_on_from(arm)
    with pytest.raises(SolveError):
        other.tip_pose()
    arm.reset()
    arm.advance(np.zeros(12), NONE, 0.1)
    np.testing.assert_array_equal(arm.backbone.tip, rest)
    arm.advance(TENSIONS, NONE, 0.25)
    assert arm.state.time == pytest.approx(0.25)


def test_an_arm_that_cannot_move_is_refused() -> None:
    with pytest.raises(ArmDefinitionError, match='density'):
        DynamicArm(PLAIN, Push(), Sensors())


@pytest.mark.endurance
def test_no_step_fails_under_random_commands_that_jump() -> None:
    path = preset_path('renda2012_table4')
    values = load_parameters(path) | in_water(load_config(path))
    simulator = SimulatorConfig.from_parameters(values)
    arm, random = simulator.pushed_arm, np.random.default_rng(3)
    tensions, still = np.zeros(12), np.zeros(3)
    for period in range(1300):
        if period % 20 == 0:
            highest = np.minimum(simulator.limits, 8.0)
            pulled = random.random(12) < random.random()
            tensions = np.where(pulled, random.random(12) ** 3 * highest, tensions)
        arm.advance(tensions, still, 0.01)


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
