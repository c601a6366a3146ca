"""Winches, relaxation and load cells in series, and the parameters of the simulator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import commands, tensions, times

from octo_arm_model import ArmDefinitionError, Config, ConfigError
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.config.parameters import PARAMETERS as ARM_PARAMETERS
from octo_arm_model.simulation.hardware import (
    Hardware,
    LoadCells,
    Relaxation,
    SimulatedHardware,
    Winches,
)
from octo_arm_model.simulation.simulator import (
    PARAMETERS,
    SimulatorConfig,
    for_arm_node,
    for_true_arm,
)

ARM = load_parameters('renda2012_prototype')


def step(hardware, command, dt):
    """What is measured after a command and a time, and effective tensions."""
    effective = hardware.pull(command, dt, np.zeros(command.size, np.bool_))
    return hardware.read(), effective


def winches(tendons=3, **parameters):
    """Steps winches by a command and a time; returns the tensions."""
    hardware = SimulatedHardware(Hardware(Winches(**parameters)), tendons)
    return lambda command, dt: step(hardware, command, dt)[0]


def readings(tension: float, count: int, **parameters: float) -> np.ndarray:
    """What four load cells read of a ``tension``, (count, 4) [N]; NaN where it is lost."""
    cells = SimulatedHardware(Hardware(load_cells=LoadCells(**parameters)), 4)
    read = [step(cells, np.full(4, tension), 0.01)[0] for _ in range(count)]
    return np.array([np.full(4, np.nan) if one is None else one for one in read])


@given(tensions, times, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
def test_lag_is_the_exponential_whatever_the_steps(command, lag, parts):
    go, elapsed = winches(lag=lag), 0.0
    for part in parts:
        elapsed += part * lag
        expected = command * -np.expm1(-elapsed / lag)
        np.testing.assert_allclose(go(command, part * lag), expected, rtol=1e-12, atol=1e-12)


@given(
    commands,
    st.floats(0.1, 100.0),
    st.floats(1e-3, 1.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 5.0),
    st.floats(5.0, 20.0),
)
def test_limits_of_rate_and_force_are_kept(given_commands, rate, dt, lag, floor, limit):
    go, before = winches(rate_limit=rate, lag=lag), np.zeros(3)
    bounded = winches(slack_floor=floor, force_limit=limit)
    for command in given_commands:
        tension = go(command, dt)
        assert (np.abs(tension - before) <= rate * dt * (1.0 + 1e-9) + 1e-12).all()
        before = tension
        np.testing.assert_array_equal(bounded(command, dt), np.clip(command, floor, limit))


def test_the_force_limit_comes_before_the_rate_limit_and_that_before_the_lag():
    go = winches(1, force_limit=3.0, rate_limit=20.0, lag=0.1)
    # The set point is at its limit of 3 N after two steps, not on its way to 100 N.
    tension, set_point = 0.0, 0.0
    for _ in range(5):
        set_point = min(3.0, set_point + 2.0)
        tension = set_point + np.exp(-1.0) * (tension - set_point)
        assert go(np.array([100.0]), 0.1) == pytest.approx(tension, rel=1e-12)
    assert go(np.zeros(1), 0.1) < tension  # no winding down from beyond the limit
    with pytest.raises(ArmDefinitionError, match=r'at least winches\.slack_floor, 2\.0'):
        Winches(slack_floor=2.0, force_limit=1.0)


@given(st.floats(0.0, 5.0), times, st.floats(0.0, 5.0))
def test_creep_under_a_steady_pull_is_that_of_the_standard_linear_solid(ratio, time, t):
    relaxing = SimulatedHardware(Hardware(relaxation=Relaxation(ratio, time)), 1)
    measured, effective = step(relaxing, np.ones(1), t * time)
    expected = 1.0 - ratio / (1.0 + ratio) * np.exp(-t / (1.0 + ratio))
    assert effective[0] == pytest.approx(expected, rel=1e-12) and measured[0] == 1.0


def test_held_at_a_strain_the_pull_relaxes_like_the_modulus():
    # The tension that keeps the effective one at 1 N, step by step, is E(t) / E.
    ratio, time, dt = 0.5, 2.0, 1e-3
    relaxing = SimulatedHardware(Hardware(relaxation=Relaxation(ratio, time)), 2)
    held = np.array([True, False])
    for period in range(1000):
        effective = relaxing.pull(np.ones(2), dt, held)
        relaxing.hold(np.ones(2), np.full(2, 0.01), dt, held)
        expected = 1.0 + ratio * np.exp(-period * dt / time)
        assert relaxing.state[0, 0] == pytest.approx(expected, abs=2.0 * ratio * dt / time)
    # It is what is effective, and leaves the other tendon alone.
    assert relaxing.pull(np.ones(2), 0.0, held)[0] == pytest.approx(1.0)
    alone = SimulatedHardware(Hardware(relaxation=Relaxation(ratio, time)), 1)
    for _ in range(1000):
        last = step(alone, np.ones(1), dt)[1]
    assert (last[0], relaxing.state[0, 1]) == (effective[1], 1.0)


def test_noise_has_its_standard_deviation_and_no_bias_and_slack_tendons_read_below_zero():
    for tension in (5.0, 0.0):
        noise = readings(tension, 5000, noise_stddev=0.1) - tension
        # Four standard errors of 20000 values.
        assert abs(noise.mean()) < 4.0 * 0.1 / np.sqrt(noise.size)
        assert abs(noise.std() - 0.1) < 4.0 * 0.1 / np.sqrt(2 * noise.size)


def test_readings_are_multiples_of_the_resolution():
    read = readings(5.0, 100, noise_stddev=0.2, resolution=0.25)
    assert len(np.unique(read)) > 3
    np.testing.assert_array_equal(read, 0.25 * np.round(read / 0.25))


def test_a_gain_stays_what_it_was_drawn_and_is_in_proportion():
    low, high = (readings(tension, 5, gain_stddev=0.1) for tension in (1.0, 10.0))
    assert (low == low[0]).all()
    assert len(set(low[0])) == 4
    np.testing.assert_allclose(high, 10.0 * low, rtol=1e-12)


def test_as_many_readings_are_lost_as_the_probability_says_and_the_noise_stays():
    read = readings(1.0, 5000, drop_probability=0.3, noise_stddev=0.1)
    lost = np.isnan(read[:, 0])
    assert abs(lost.mean() - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / lost.size)
    np.testing.assert_array_equal(read[~lost], readings(1.0, 5000, noise_stddev=0.1)[~lost])


def test_a_seed_draws_the_same_again_and_another_something_else():
    own = {'gain_stddev': 0.1, 'noise_stddev': 0.1, 'drop_probability': 0.3, 'seed': 7}
    first = readings(1.0, 100, **own)
    np.testing.assert_array_equal(first, readings(1.0, 100, **own))
    again = SimulatedHardware(Hardware(load_cells=LoadCells(seed=3)), 4)
    step(again, np.ones(4), 0.01)
    again.change(Hardware(load_cells=LoadCells(**own)))
    is_lost = [step(again, np.ones(4), 0.01)[0] is None for _ in range(100)]
    assert is_lost == np.isnan(first[:, 0]).tolist()
    assert not np.isin(readings(1.0, 100, **(own | {'seed': 8})), first).any()


# Parameters --------------------------------------------------------------------------------------


WRONG = {
    '>= 0': (-1.0, np.nan, np.inf),
    '> 0': (0.0, -1.0, np.nan, np.inf),
    'in [0, 1]': (1.5, np.nan),
}


@pytest.mark.parametrize(
    'parameter',
    [one for one in (*ARM_PARAMETERS, *PARAMETERS) if one.range in WRONG and one.kind is float],
    ids=lambda one: one.name,
)
def test_a_number_outside_its_range_is_refused_by_name(parameter):
    of_obstacles = {
        'obstacles.type': ['sphere'],
        'obstacles.position': [0.0, 0.0, 1.0],
        'obstacles.radius': [0.1],
        'obstacles.stiffness': [1e5],
    }
    for wrong in WRONG[parameter.range]:
        given = {parameter.name: [wrong] if parameter.is_array else wrong}
        with pytest.raises(ArmDefinitionError) as caught:
            SimulatorConfig.from_parameters({**ARM, **of_obstacles, 'model': 'exact', **given})
        name = f'{parameter.name}[0]' if parameter.is_array else parameter.name
        expected = f'{name} is {wrong}, expected a finite'
        if parameter in PARAMETERS:
            what = parameter.what if parameter.range == '>= 0' else 'number'
            expected += f' {what} {parameter.range.replace("in", "within")}'
        assert str(caught.value).startswith(expected)


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'load_cells.resolution': 1e-320}, 'is 1e-320, expected a finite number > 0 [N]'),
        ({'load_cells.seed': -1}, 'load_cells.seed is -1, expected an integer >= 0'),
        ({'rate': 0.0}, 'rate is 0.0, expected a finite number within [1e-06, 1000] [Hz]'),
        ({'rate': 1e6}, 'rate is 1000000.0, expected a finite number within [1e-06, 1000] [Hz]'),
        ({'real_time_factor': 1e-300}, 'is 1e-300, expected a finite number within [0.001, 1000]'),
        ({'real_time_factor': 2.0}, 'is 2.0, expected 1.0 or no value without publish_clock'),
        ({'winches.speed_limit': 0.1}, 'is 0.1, expected 0.0 or no value without dynamics'),
        ({'winches.lga': 0.1}, 'did you mean winches.lag?'),
        ({'material.poison_ratio': 0.5}, 'did you mean material.poisson_ratio?'),
        ({'elbow': 1.0}, 'elbow is no parameter of the simulator or the arm; known are rate'),
        ({'winches.lag': 'long'}, "winches.lag is 'long', expected double"),
        ({'profile.loop': 1}, 'profile.loop is 1, expected bool'),
        (
            {'dynamics': True, 'material.density': 1080.0, 'rate': 0.5},
            'rate is 0.5, expected a finite number within [1, 1000] [Hz]',
        ),
    ],
)
def test_parameters_that_cannot_be_are_refused_by_name(values, complaint):
    with pytest.raises((ArmDefinitionError, ConfigError)) as caught:
        SimulatorConfig.from_parameters({**ARM, **values})
    assert complaint in str(caught.value)


def test_everything_is_off_by_default_and_every_parameter_arrives():
    config = SimulatorConfig.from_parameters(ARM)
    assert config.hardware == Hardware()
    assert config.profile is None
    own = {p.name: p.default for p in PARAMETERS}
    own |= {'winches.lag': 0.1, 'load_cells.seed': 3, 'relaxation.ratio': 0.2, 'rate': 20.0}
    config = SimulatorConfig.from_parameters({**ARM, **own, 'profile.name': 'ramps'})
    expected = Hardware(Winches(lag=0.1), LoadCells(seed=3), Relaxation(ratio=0.2))
    assert (config.hardware, config.course.rate) == (expected, 20.0)
    assert config.profile is not None and config.profile.duration > 0.0


def test_the_node_of_the_arm_is_told_of_load_cells_alone():
    values = {
        'winches.lag': 0.1,
        'tension_deadband': 1,
        'tension_offset': [0.1, 0, -0.2, 0],
        'tension_scale': [],
    }
    assert for_arm_node(values) == {
        'tension_deadband': 1.0,
        'tension_offset': (0.1, 0.0, -0.2, 0.0),
    }
    assert for_arm_node({'rate': 10.0}) == {}


def test_the_node_of_the_true_arm_takes_tensions_as_they_are():
    """Whatever the arm's file says of load cells."""
    cells = {
        'tension_names': ['-', 'A', 'B', 'C'],
        'tension_deadband': 0.5,
        'tension_offset': [0.1, 0.2, 0.3, 0.4],
        'tension_scale': [2.0, 1.0, 1.0, 1.0],
    }
    arm = Config.from_parameters(ARM).arm
    true = Config.from_parameters({**ARM, **cells, **for_true_arm(arm)}).load_cells
    tensions = np.array([[0.3, 1.0, 0.0, 0.2]])
    np.testing.assert_array_equal(true.tensions(arm, tensions), tensions)
    assert true.names == arm.tendon_names
