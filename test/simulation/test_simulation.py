"""Winches, load cells and the relaxing material: physics, limits and seeds."""

from __future__ import annotations

import copy
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model import ArmDefinitionError, Config, ConfigError
from octo_arm_model.simulation.hardware import Hardware, SimulatedHardware
from octo_arm_model.simulation.load_cells import LoadCells, SimulatedLoadCells
from octo_arm_model.simulation.parameters import PARAMETERS, SimulatorConfig
from octo_arm_model.simulation.relaxation import Relaxation, SimulatedRelaxation
from octo_arm_model.simulation.winches import SimulatedWinches, Winches

ARM = {
    'material.youngs_modulus': 1.1e5,
    'body.length': 0.3,
    'body.radius_base': 0.015,
    'body.radius_tip': 0.007,
    'sections.anchorage': [0.3],
    'sections.offset_base': [0.005],
    'sections.offset_anchorage': [0.003],
}
tensions = st.lists(st.floats(0.0, 50.0), min_size=3, max_size=3).map(np.array)
commands = st.lists(tensions, min_size=1, max_size=8)
steps = st.floats(0.0, 10.0)
times = st.floats(1e-3, 100.0)


@given(commands, steps)
def test_perfect_hardware_measures_what_was_commanded(given_commands, dt) -> None:
    hardware = SimulatedHardware(Hardware(), 3)
    for command in given_commands:
        measured, effective = hardware.step(command, dt)
        np.testing.assert_array_equal(measured, command)
        np.testing.assert_array_equal(effective, command)


# Winches ----------------------------------------------------------------------------------------


@given(tensions, times, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
def test_lag_is_the_exponential_whatever_the_steps(command, lag, parts) -> None:
    winches = SimulatedWinches(Winches(lag=lag), 3)
    elapsed = 0.0
    for part in parts:
        elapsed += part * lag
        tension = winches.step(command, part * lag)
        expected = command * -np.expm1(-elapsed / lag)
        np.testing.assert_allclose(tension, expected, rtol=1e-12, atol=1e-12)


@given(commands, st.floats(1e-9, 1e9), st.floats(1e-3, 1e6))
def test_lag_is_stable_and_never_overshoots_however_long_a_step(given_commands, lag, dt) -> None:
    winches = SimulatedWinches(Winches(lag=lag), 3)
    before = np.zeros(3)
    for command in given_commands:
        tension = winches.step(command, dt)
        assert (tension >= np.minimum(before, command) * (1.0 - 1e-12)).all()
        assert (tension <= np.maximum(before, command) * (1.0 + 1e-12)).all()
        before = tension


@given(commands, st.floats(0.1, 100.0), st.floats(1e-3, 1.0), st.floats(0.0, 1.0))
def test_tension_never_changes_faster_than_the_rate_limit(
    given_commands, rate_limit, dt, lag
) -> None:
    winches = SimulatedWinches(Winches(rate_limit=rate_limit, lag=lag), 3)
    before = np.zeros(3)
    for command in given_commands:
        tension = winches.step(command, dt)
        assert (np.abs(tension - before) <= rate_limit * dt * (1.0 + 1e-9) + 1e-12).all()
        before = tension


def test_rate_limit_is_reached_and_ends_at_the_command() -> None:
    winches = SimulatedWinches(Winches(rate_limit=2.0), 1)
    ramp = [winches.step(np.array([1.0]), 0.125)[0] for _ in range(6)]
    assert ramp == [0.25, 0.5, 0.75, 1.0, 1.0, 1.0]
    assert winches.step(np.zeros(1), 0.125) == 0.75


@given(commands, st.floats(0.0, 5.0), st.floats(5.0, 20.0))
def test_floor_and_limit_bound_the_tension(given_commands, floor, limit) -> None:
    winches = SimulatedWinches(Winches(slack_floor=floor, force_limit=limit), 3)
    for command in given_commands:
        np.testing.assert_array_equal(winches.step(command, 0.1), np.clip(command, floor, limit))


def test_the_force_limit_comes_before_the_rate_limit_and_that_before_the_lag() -> None:
    winches = SimulatedWinches(Winches(force_limit=3.0, rate_limit=20.0, lag=0.1), 1)
    # The set point is at its limit of 3 N after two steps, not on its way to 100 N.
    tension, set_point = 0.0, 0.0
    for _ in range(5):
        set_point = min(3.0, set_point + 2.0)
        tension = set_point + np.exp(-1.0) * (tension - set_point)
        assert winches.step(np.array([100.0]), 0.1) == pytest.approx(tension, rel=1e-14)
    assert winches.step(np.zeros(1), 0.1) < tension  # no winding down from beyond the limit


# Load cells -------------------------------------------------------------------------------------


def readings(load_cells: LoadCells, tension: float, count: int) -> np.ndarray:
    cells = SimulatedLoadCells(load_cells, 4)
    read = [cells.read(np.full(4, tension)) for _ in range(count)]
    return np.array([np.full(4, np.nan) if one is None else one for one in read])


def test_noise_has_its_standard_deviation_and_no_bias() -> None:
    noise = readings(LoadCells(noise_stddev=0.1), 5.0, 5000) - 5.0
    # Four standard errors of 20000 values.
    assert abs(noise.mean()) < 4.0 * 0.1 / np.sqrt(noise.size)
    assert abs(noise.std() - 0.1) < 4.0 * 0.1 / np.sqrt(2 * noise.size)


def test_no_reading_is_negative_but_slack_ones_read_what_noise_makes_of_them() -> None:
    slack = readings(LoadCells(noise_stddev=0.1), 0.0, 1000)
    assert (slack >= 0.0).all()
    assert 0.4 < (slack > 0.0).mean() < 0.6


def test_a_gain_stays_what_it_was_drawn_and_is_in_proportion() -> None:
    cells = LoadCells(gain_stddev=0.1)
    low, high = readings(cells, 1.0, 5), readings(cells, 10.0, 5)
    assert (low == low[0]).all()
    assert len(set(low[0])) == 4
    np.testing.assert_allclose(high, 10.0 * low, rtol=1e-14)


@given(st.floats(0.0, 50.0), st.floats(1e-3, 5.0))
def test_readings_are_the_nearest_multiples_of_the_resolution(tension, resolution) -> None:
    reading = readings(LoadCells(resolution=resolution), tension, 1)[0, 0]
    assert abs(reading - tension) <= 0.5 * resolution * (1.0 + 1e-9)
    assert reading / resolution == pytest.approx(round(reading / resolution), abs=1e-9)


def test_noise_is_quantised_not_quantisation_noisy() -> None:
    read = readings(LoadCells(noise_stddev=0.3, resolution=0.5), 5.0, 50)
    np.testing.assert_array_equal(read, 0.5 * np.round(read / 0.5))
    assert len(np.unique(read)) > 2


def test_as_many_readings_are_lost_as_the_probability_says() -> None:
    lost = np.isnan(readings(LoadCells(drop_probability=0.3), 1.0, 5000)[:, 0])
    assert abs(lost.mean() - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / lost.size)
    assert np.isnan(readings(LoadCells(drop_probability=1.0), 1.0, 20)).all()


def test_a_seed_draws_the_same_again_and_another_something_else() -> None:
    cells = LoadCells(gain_stddev=0.1, noise_stddev=0.1, drop_probability=0.3, seed=7)
    first = readings(cells, 1.0, 100)
    np.testing.assert_array_equal(first, readings(cells, 1.0, 100))
    again = SimulatedLoadCells(LoadCells(seed=3), 4)
    again.read(np.ones(4))
    again.change(cells)
    assert [again.read(np.ones(4)) is None for _ in range(100)] == np.isnan(first[:, 0]).tolist()
    other = readings(LoadCells(gain_stddev=0.1, noise_stddev=0.1, seed=8), 1.0, 100)
    assert not np.isin(other, first).any()


def test_switching_losses_on_leaves_the_noise_as_it_was() -> None:
    all_of_them = readings(LoadCells(noise_stddev=0.1), 1.0, 200)
    some = readings(LoadCells(noise_stddev=0.1, drop_probability=0.5), 1.0, 200)
    kept = ~np.isnan(some[:, 0])
    assert 50 < kept.sum() < 150
    np.testing.assert_array_equal(some[kept], all_of_them[kept])


# Relaxation -------------------------------------------------------------------------------------


@given(st.floats(0.0, 5.0), times, st.floats(0.0, 5.0))
def test_creep_under_a_steady_pull_is_that_of_the_standard_linear_solid(ratio, time, t) -> None:
    relaxing = SimulatedRelaxation(Relaxation(ratio, time), 1)
    effective = relaxing.step(np.ones(1), t * time)[0]
    retardation = (1.0 + ratio) * time
    expected = 1.0 - ratio / (1.0 + ratio) * np.exp(-t * time / retardation)
    assert effective == pytest.approx(expected, rel=1e-12)


def test_held_at_a_strain_the_pull_relaxes_like_the_modulus() -> None:
    # The tension that keeps the effective one at 1 N, step by step, is E(t) / E.
    ratio, time, dt = 0.5, 2.0, 1e-3
    relaxing = SimulatedRelaxation(Relaxation(ratio, time), 1)
    for step in range(2000):
        # Effective is affine in the tension of the step: two trials tell which one it takes.
        low, high = (copy.deepcopy(relaxing).step(np.full(1, t), dt)[0] for t in (0.0, 1.0))
        pull = (1.0 - low) / (high - low)
        assert relaxing.step(np.full(1, pull), dt)[0] == pytest.approx(1.0)
        expected = 1.0 + ratio * np.exp(-step * dt / time)
        assert pull == pytest.approx(expected, abs=2.0 * ratio * dt / time)


def test_the_shape_at_rest_is_that_of_the_elastic_arm_and_a_pull_shows_in_part_at_once() -> None:
    hardware = SimulatedHardware(Hardware(relaxation=Relaxation(0.25, 1.0)), 2)
    pull = np.array([1.0, 3.0])
    measured, effective = hardware.step(pull, 0.0)
    np.testing.assert_array_equal(measured, pull)
    np.testing.assert_allclose(effective, pull / 1.25, rtol=1e-14)
    for _ in range(100):
        measured, effective = hardware.step(pull, 1.0)
    np.testing.assert_allclose(effective, pull, rtol=1e-12)


def test_at_once_the_shape_is_that_of_the_stiffer_arm_at_any_strain(model: str) -> None:
    ratio, pull = 0.4, np.array([[3.0, 0.0, 0.0, 1.0]])
    effective = SimulatedRelaxation(Relaxation(ratio), 4).step(pull.ravel(), 0.0)
    shape = Config.from_parameters(ARM).solver(model).solve(effective.reshape(1, 4))
    stiff = Config.from_parameters(ARM | {'material.youngs_modulus': 1.1e5 * (1.0 + ratio)})
    np.testing.assert_allclose(shape.tip, stiff.solver(model).solve(pull).tip, atol=1e-9)
    assert np.linalg.norm(shape.tip - [0.3, 0.0, 0.0]) > 0.1


# Parameters -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [
        ('winches.slack_floor', -0.1, 'winches.slack_floor is -0.1, expected a finite tension'),
        ('winches.force_limit', np.nan, 'winches.force_limit is nan'),
        ('winches.rate_limit', -1.0, 'winches.rate_limit is -1.0, expected a finite rate >= 0'),
        ('winches.lag', np.inf, 'winches.lag is inf, expected a finite time >= 0 [s]'),
        ('load_cells.gain_stddev', -1.0, 'load_cells.gain_stddev is -1.0'),
        ('load_cells.noise_stddev', -1.0, 'load_cells.noise_stddev is -1.0'),
        ('load_cells.resolution', -1.0, 'load_cells.resolution is -1.0'),
        ('load_cells.drop_probability', 1.5, 'is 1.5, expected a number in [0, 1]'),
        ('load_cells.seed', -1, 'load_cells.seed is -1, expected an integer >= 0'),
        ('relaxation.ratio', -0.5, 'relaxation.ratio is -0.5'),
        ('relaxation.time', 0.0, 'relaxation.time is 0.0, expected a finite number > 0 [s]'),
        ('rate', 0.0, 'rate is 0.0, expected a finite number > 0 [Hz]'),
        ('rate', 1e6, 'rate is 1000000.0, expected at most 1000.0 [Hz]'),
        ('profile.speed', -1.0, 'profile.speed is -1.0'),
    ],
)
def test_impossible_values_are_refused_by_name(name, value, complaint) -> None:
    with pytest.raises(ArmDefinitionError) as caught:
        SimulatorConfig.from_parameters({**ARM, name: value})
    assert complaint in str(caught.value)


def test_a_force_limit_below_the_floor_is_refused() -> None:
    with pytest.raises(ArmDefinitionError, match=r'at least winches\.slack_floor, 2\.0'):
        Winches(slack_floor=2.0, force_limit=1.0)


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'winches.lga': 0.1}, 'did you mean winches.lag?'),
        ({'material.poison_ratio': 0.5}, 'did you mean material.poisson_ratio?'),
        ({'elbow': 1.0}, 'elbow is no parameter of the simulator or the arm; known are rate'),
        ({'winches.lag': 'long'}, "winches.lag is 'long', expected double"),
        ({'profile.loop': 1}, 'profile.loop is 1, expected bool'),
    ],
)
def test_unknown_names_and_wrong_types_are_refused(values, complaint) -> None:
    with pytest.raises(ConfigError) as caught:
        SimulatorConfig.from_parameters({**ARM, **values})
    assert complaint in str(caught.value)


def test_everything_is_off_by_default_and_every_parameter_arrives() -> None:
    config = SimulatorConfig.from_parameters(ARM)
    assert config.hardware == Hardware()
    assert config.profile is None
    own = {p.name: p.default for p in PARAMETERS}
    own |= {'winches.lag': 0.1, 'load_cells.seed': 3, 'relaxation.ratio': 0.2, 'rate': 20.0}
    config = SimulatorConfig.from_parameters({**ARM, **own, 'profile.name': 'ramps'})
    expected = Hardware(Winches(lag=0.1), LoadCells(seed=3), Relaxation(ratio=0.2))
    assert (config.hardware, config.rate) == (expected, 20.0)
    assert config.profile is not None and config.profile.duration > 0.0


def test_the_simulation_needs_neither_ros_nor_matplotlib() -> None:
    code = 'import octo_arm_model.simulation.parameters, octo_arm_model.cli.play, sys; '
    done = subprocess.run(
        [sys.executable, '-c', code + 'print(*sys.modules)'], capture_output=True, text=True
    )
    loaded = {name.split('.')[0] for name in done.stdout.split()}
    assert 'octo_arm_model' in loaded
    assert not loaded & {'rclpy', 'octo_arm_msgs', 'matplotlib', 'viser'}
