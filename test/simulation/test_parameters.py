"""Parameters of the simulator: limits, names and types."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model import ArmDefinitionError, ConfigError
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.config.parameters import PARAMETERS as ARM_PARAMETERS
from octo_arm_model.simulation.hardware import Hardware, LoadCells, Relaxation, Winches
from octo_arm_model.simulation.simulator import (
    PARAMETERS,
    SimulatorConfig,
    for_arm_node,
    for_true_arm,
)

ARM = load_parameters(preset_path('renda2012_prototype'))


WRONG = {
    '>= 0': (-1.0, np.nan, np.inf), '> 0': (0.0, -1.0, np.nan, np.inf), 'in [0, 1]': (1.5, np.nan),
}  # fmt: skip


@pytest.mark.parametrize(
    'parameter',
    [one for one in (*ARM_PARAMETERS, *PARAMETERS) if one.range in WRONG and one.kind is float],
    ids=lambda one: one.name,
)
def test_a_number_outside_its_range_is_refused_by_name(parameter) -> None:
    of_obstacles = {'obstacles.type': ['sphere'], 'obstacles.position': [0.0, 0.0, 1.0],
                    'obstacles.radius': [0.1], 'obstacles.stiffness': [1e5]}  # fmt: skip
    for wrong in WRONG[parameter.range]:
        given = {parameter.name: [wrong] if parameter.is_array else wrong}
        with pytest.raises(ArmDefinitionError) as caught:
            SimulatorConfig.from_parameters({**ARM, **of_obstacles, 'model': 'exact', **given})
        name = f'{parameter.name}[0]' if 'obstacles' in parameter.name else parameter.name
        expected = f'{name} is {wrong}, expected a finite'
        if parameter in PARAMETERS:
            what = parameter.what if parameter.range == '>= 0' else 'number'
            expected += f' {what} {parameter.range.replace("in", "within")}'
        assert str(caught.value).startswith(expected)


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [
        ('winches.force_limit', np.nan, 'winches.force_limit is nan'),
        ('load_cells.resolution', 1e-320, 'is 1e-320, expected a finite number > 0 [N]'),
        ('load_cells.seed', -1, 'load_cells.seed is -1, expected an integer >= 0'),
        ('rate', 0.0, 'rate is 0.0, expected a finite number within [1e-06, 1000] [Hz]'),
        ('rate', 1e-11, 'rate is 1e-11, expected a finite number within [1e-06, 1000] [Hz]'),
        ('rate', 1e6, 'rate is 1000000.0, expected a finite number within [1e-06, 1000] [Hz]'),
        ('real_time_factor', 1e-300, 'is 1e-300, expected a finite number within [0.001, 1000]'),
    ],
)
def test_impossible_values_are_refused_by_name(name, value, complaint) -> None:
    with pytest.raises(ArmDefinitionError) as caught:
        SimulatorConfig.from_parameters({**ARM, name: value})
    assert complaint in str(caught.value)


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


def test_a_period_of_a_moving_arm_is_bounded() -> None:
    moving = {'dynamics': True, 'material.density': 1080.0, 'rate': 0.5}
    with pytest.raises(ArmDefinitionError, match=r'rate is 0.5, .* within \[1, 1000\] \[Hz\]'):
        SimulatorConfig.from_parameters({**ARM, **moving})


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


def test_the_node_of_the_arm_is_told_of_load_cells_alone() -> None:
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


def test_the_node_of_the_true_arm_takes_tensions_as_they_are() -> None:
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
