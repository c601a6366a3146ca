"""The simulated arm that moves: its sensors, its base, the water and its winches."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from octo_arm_model import Loads, MotionProperties, Pose, load_config, solve_displacements
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.simulation.dynamic_arm import (
    LAG,
    DynamicArm,
    Surroundings,
    current_of,
    pose_of,
)
from octo_arm_model.simulation.pushed_arm import Push, PushedArm, Sensors
from octo_arm_model.simulation.simulator import SimulatorConfig, TendonDrive, in_water

PLAIN = load_config('renda2012_table4')
CONFIG = dataclasses.replace(
    PLAIN,
    model='exact',
    arm=PLAIN.arm.with_density(1080.0),
    stations=101,
    loads=Loads((0.0, 0.0, -9.81), 1022.0),
    motion=MotionProperties(damping_time=0.3),
)
SENSORS = Sensors(marker_s=(0.1, 0.3), markers_rate=1.0)
TENSIONS, NONE = np.repeat([0.02, 0.1, 0.3], 4) * np.tile([1.0, 0.0, 0.0, 0.5], 3), np.zeros(3)


@pytest.mark.parametrize('s', [0.0, 0.2])
def test_sensors_end_with_what_they_read_of_the_arm_at_rest(s):
    force, push = np.array([0.0, 0.003, 0.002]), Push((0.0, 0.003, 0.002), s)
    arm, still = DynamicArm(CONFIG, push, SENSORS), PushedArm(CONFIG, push, SENSORS)
    arm.advance(np.zeros(12), NONE, 0.1)
    began = arm.tip_pose()
    for _ in range(110):
        arm.advance(TENSIONS, force, 0.1)
    still.advance(TENSIONS, force)
    tip, expected = np.array(arm.tip_pose().position), np.array(still.tip_pose().position)
    assert np.linalg.norm(tip - began.position) > 0.05
    np.testing.assert_allclose(tip, expected, atol=2e-5)
    np.testing.assert_allclose(arm.markers(), still.markers(), atol=2e-5)
    np.testing.assert_allclose(arm.base_wrench(), still.base_wrench(), atol=2e-5)
    # Displacements are those of the static arm, which has tensions alone.
    assert arm.reeled_in()[8] > 0.0


def test_the_current_that_is_set_last_flows():
    arms = [
        DynamicArm(
            dataclasses.replace(CONFIG, motion=dataclasses.replace(CONFIG.motion, current=flow)),
            Push(),
            SENSORS,
        )
        for flow in ((0.2, 0.0, 0.0), (0.0, 0.1, 0.0))
    ]
    arms[0].advance(np.zeros(12), NONE, 0.0)
    arms[0].surroundings.flow((0.0, 0.0, 0.3))
    arms[1].go_on_from(arms[0])
    # A parameter, and later a message.
    for flow in ((0.0, 0.1, 0.0), (0.0, 0.0, 0.2)):
        arms[1].advance(np.zeros(12), NONE, 20 * LAG)
        assert current_of(arms[1].surroundings.values) == pytest.approx(flow, abs=1e-6)
        arms[1].surroundings.flow((0.0, 0.0, 0.2))


START = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))


def turned(angle: float, x: float = 1.0) -> Pose:
    return Pose((x, 2.0, 3.0), (0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle)))


@pytest.mark.parametrize('parts', [1, 7])
def test_two_lags_follow_what_is_told_whatever_the_steps(parts):
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


def test_a_quaternion_of_the_other_sign_turns_nothing():
    around = Surroundings(turned(0.1), (0.0, 0.0, 0.0))
    around.move_base(Pose((1.0, 2.0, 3.0), tuple(-c for c in turned(0.1).quaternion)))
    around.values = around.after(0.05)
    np.testing.assert_allclose(pose_of(around.values).quaternion, turned(0.1).quaternion)


# Winches -----------------------------------------------------------------------------------------


NAMES = load_config('renda2012_prototype').arm.tendon_names
SLACK = np.zeros(4)
PUSH = np.array([0.0, 0.01, 0.01])
TAUT = dict(zip(NAMES, (0.0095, 0.009, 0.0085, 0.009), strict=True))
TO_SIDES = np.array([1.0, 1.0, -1.0, -1.0])


def drive(**more: Any) -> tuple[TendonDrive, SimulatorConfig]:
    """Winches of an arm that moves, strongly damped, with elastic tendons."""
    values = load_parameters('renda2012_prototype') | {
        'dynamics': True,
        'model': 'exact',
        'material.density': 1080.0,
        'stations': 21,
        'motion.damping_time': 0.3,
        'tendons.axial_stiffness': 4 * [500.0],
    }
    values |= {name.replace('__', '.'): value for name, value in more.items()}
    config = SimulatorConfig.from_parameters(values)
    return TendonDrive(config), config


def go(own: TendonDrive, tensions: FloatArray, force: FloatArray, periods: int = 1) -> FloatArray:
    """Tensions of all tendons after so many periods of 50 ms."""
    for _ in range(periods):
        found = own.move(own.advance(tensions, 0.05), force, 0.05)
    return found


def test_winches_that_hold_lengths_bear_a_push_and_the_arm_springs_back():
    """By as much as statics say, against all tendons on that side."""
    own, config = drive()
    arm: Any = config.pushed_arm
    go(own, SLACK, NONE)
    own.hold(TAUT, SLACK)
    found = []
    for force in (NONE, PUSH, NONE):
        tensions = go(own, SLACK, force, 40)
        expected = solve_displacements(config.solver, TAUT, None, None, np.append(force, NONE))
        np.testing.assert_allclose(tensions, expected.backbone.tensions.ravel(), atol=2e-4)
        np.testing.assert_allclose(arm.backbone.tip, expected.backbone.tip, atol=2e-5)
        np.testing.assert_array_equal(own.hardware.read(), tensions)
        np.testing.assert_allclose(arm.reeled_in(), list(TAUT.values()), atol=1e-9)
        found.append((tensions, arm.backbone.tip))
    more, far = (np.array(found[1][part]) - found[0][part] for part in (0, 1))
    # Tendons on the side that it is pushed from are stretched, those opposite let go.
    assert (more * TO_SIDES > 0.1).all()
    # With the tensions held instead of the lengths the arm gives way by more.
    held = found[0][0].reshape(1, 4)
    tips = [config.solver.solve(held, np.append(force, NONE)).tip for force in (NONE, PUSH)]
    assert np.linalg.norm(tips[1] - tips[0]) > 3.0 * np.linalg.norm(far)


def test_winches_follow_a_length_with_their_lag_and_speed():
    own, config = drive(winches__lag=0.1)
    arm: Any = config.pushed_arm
    go(own, SLACK, NONE)
    own.hold({NAMES[0]: 0.01}, SLACK)
    for period in range(1, 5):
        go(own, SLACK, NONE)
        expected = 0.01 * -np.expm1(-0.5 * period)
        assert arm.reeled_in()[0] == pytest.approx(expected, abs=1e-9)
    own, config = drive(winches__speed_limit=0.02)
    arm = config.pushed_arm
    go(own, SLACK, NONE)
    own.hold({NAMES[0]: 0.0025}, SLACK)
    reeled = [go(own, SLACK, NONE) is None or arm.reeled_in()[0] for _ in range(4)]
    np.testing.assert_allclose(reeled, [0.001, 0.002, 0.0025, 0.0025], atol=1e-9)


@pytest.mark.parametrize('ratio', [0.0, 1.0])
def test_a_winch_gives_way_where_its_tendon_would_bear_more_than_it_may(ratio):
    """And takes the length back where that is over; a relaxing material bears more at first."""
    winches = {'winches__force_limit': 0.5, 'winches__slack_floor': 0.02}
    own, config = drive(**winches, relaxation__ratio=ratio, relaxation__time=0.1)
    arm: Any = config.pushed_arm
    go(own, np.full(4, 0.02), NONE)
    own.hold({NAMES[0]: 0.05, NAMES[2]: -0.05}, SLACK)  # at once
    for _ in range(40):
        go(own, np.full(4, 0.02), NONE)
        np.testing.assert_allclose(own.hardware.read()[[0, 2]], [0.5, 0.02], atol=1e-9)
    rest = config.solver.solve([[0.5, 0.02, 0.02, 0.02]])
    np.testing.assert_allclose(arm.backbone.tip, rest.tip, atol=1e-4)
    assert arm.reeled_in()[0] < 0.05 and arm.reeled_in()[2] > -0.05
    own.hold({NAMES[0]: 0.002}, SLACK)
    go(own, np.full(4, 0.02), NONE, 30 if ratio else 10)
    assert arm.reeled_in()[0] == pytest.approx(0.002, abs=1e-9)


def test_winches_do_what_they_can_where_no_tension_reels_in_a_length():
    table4 = preset_path('renda2012_table4')
    values = load_parameters(table4) | in_water(load_config(table4))
    config, none = SimulatorConfig.from_parameters(values), np.zeros(12)
    own = TendonDrive(config)
    go(own, none, NONE)
    own.hold({'tendon_1_1': 0.3}, none)
    np.testing.assert_allclose(go(own, none, NONE, 2), [config.limits[0], *none[1:]], atol=1e-9)
