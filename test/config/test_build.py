"""Objects from parameters: calibrated load cells, tabulated tendons and obstacles."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from octo_arm_model import ArmDefinitionError, Config, ConfigError, Cylinder, Plane, Sphere
from octo_arm_model.arm.errors import TensionError
from octo_arm_model.config.calibration import Calibration
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.config.parameters import PARAMETERS

TABLE4 = load_parameters('renda2012_table4')
CONFIG = Config.from_parameters(TABLE4)
OFFSETS = tuple(0.1 * n - 0.3 for n in range(12))
SCALES = tuple(0.8 + 0.05 * n for n in range(12))


def test_readings_are_scaled_shifted_and_zeroed_within_the_deadband():
    cells = Calibration(0.02, OFFSETS, SCALES)
    readings = np.random.default_rng(0).uniform(0.5, 2.0, (5, 3, 4))
    expected = np.reshape(SCALES, (3, 4)) * readings + np.reshape(OFFSETS, (3, 4))
    assert_allclose(cells.tensions(CONFIG.arm, readings), expected, rtol=1e-12)
    flat = cells.scale_and_offset(readings.reshape(5, 12))
    assert_array_equal(flat, cells.tensions(CONFIG.arm, readings).reshape(5, 12))
    zeroed = Calibration(0.02).tensions(CONFIG.arm, np.full((3, 4), -0.02) + 0.01 * np.eye(3, 4))
    assert (zeroed == 0.0).all()
    assert Calibration(0.02).scale_and_offset(np.array([0.021])).item() == 0.021
    with pytest.raises(TensionError, match=r'tension of tendon_1_1 is .*_deadband of 0.02 N'):
        Calibration(0.02).tensions(CONFIG.arm, np.full((3, 4), -0.021))


@pytest.mark.parametrize(
    ('name', 'value', 'kind', 'message'),
    [
        ('tension_offset', [0.1], ConfigError, 'tension_offset has 1 values, expected 12'),
        ('tension_offset', 12 * [np.nan], ArmDefinitionError, r'tension_offset\[0\] is nan'),
        ('displacement_scale', [0.0], ArmDefinitionError, 'is 0.0, expected a .* other than 0'),
        ('tension_scale', 11 * [1.0], ConfigError, 'tension_scale has 11 values, expected 12'),
        ('tendon_limits', [1.0, 2.0], ConfigError, 'tendon_limits has 2 values, expected 12'),
    ],
)
def test_invalid_calibrations_are_refused(name, value, kind, message):
    with pytest.raises(kind, match=message):
        Config.from_parameters({**TABLE4, name: value})


# Tendons on tabulated paths ----------------------------------------------------------------------


PRESET = load_parameters('renda2012_prototype')
LENGTH = Config.from_parameters(PRESET).arm.length
# Place of a kink, and offsets there and at the ends [m].
KINK, NEAR, FAR = 0.4 * LENGTH, 2e-3, 8e-3


def arm_of(s: np.ndarray, offset: np.ndarray, **more: object) -> Config:
    """Return the prototype with all four tendons at ``offset`` (n,) [m] at ``s`` (n,) [m]."""
    values = {name: value for name, value in PRESET.items() if 'offset' not in name}
    table = {'tendons.table_s': s.tolist(), 'tendons.table_offset': np.tile(offset, 4).tolist()}
    more = {name.replace('__', '.'): value for name, value in more.items()}
    whole = {'body.radius_tip': 9e-3, 'body.radius_base': 12e-3, 'model': 'exact', 'stations': 21}
    return Config.from_parameters({**values, **table, **whole, **more})


def tip_of(config: Config) -> np.ndarray:
    pull = np.array([2.0, 0.7, 0.0, 0.0]).reshape(config.arm.tension_shape)
    return config.solver().solve(pull).tip


def test_linear_path_is_the_limit_of_smooth_paths():
    s, offset = np.array([0.0, KINK, LENGTH]), np.array([FAR, NEAR, FAR])
    kinked = tip_of(arm_of(s, offset, tendons__table_between='linear'))
    errors = []
    for half in (0.02, 0.01, 0.005):
        # Points of the same lines, except within `half` of the kink.
        places = np.array(
            [*np.linspace(0.0, KINK - half, 30), *np.linspace(KINK + half, LENGTH, 30)]
        )
        smooth = tip_of(arm_of(places, np.interp(places, s, offset)))
        errors.append(np.linalg.norm(smooth - kinked))
    assert 5.0 * errors[2] < errors[0] < 0.02 * LENGTH and errors[2] < errors[1] < errors[0]
    assert np.linalg.norm(tip_of(arm_of(s, offset)) - kinked) > 0.01 * LENGTH


def test_invalid_interpolation_and_friction_at_kinks_are_refused():
    s, offset = np.array([0.0, KINK, LENGTH]), np.array([FAR, NEAR, FAR])
    with pytest.raises(ConfigError, match="table_between is 'cubic', expected pchip or linear"):
        arm_of(s, offset, tendons__table_between='cubic')
    with pytest.raises(ConfigError, match=r'is linear, and tendons\.friction is given'):
        arm_of(s, offset, tendons__table_between='linear', tendons__friction=[0.2])


# Obstacles ---------------------------------------------------------------------------------------


ARM = PRESET | {'model': 'exact'}
THREE = {
    'obstacles.type': ['plane', 'sphere', 'cylinder'],
    'obstacles.position': [0.0, 0.0, -0.1, 0.3, 0.1, 0.0, 0.2, 0.2, 0.2],
    'obstacles.direction': [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 4.0],
    'obstacles.radius': [0.0, 0.03, 0.02],
    'obstacles.stiffness': [1e6],
    'obstacles.friction': [0.0, 0.1, 0.2],
}


def test_obstacles_are_built_from_lists():
    loads = Config.from_parameters(ARM | THREE).loads
    assert loads.obstacles == (
        Plane((0.0, 0.0, -0.1), (0.0, 0.0, 1.0), stiffness=1e6),
        Sphere((0.3, 0.1, 0.0), 0.03, stiffness=1e6, friction=0.1),
        Cylinder((0.2, 0.2, 0.2), (0.0, 0.6, 0.8), 0.02, stiffness=1e6, friction=0.2),
    )
    floor = {'type': ['plane'], 'position': [0.0, 0.0, -0.1], 'stiffness': [1e6]}
    values = {f'obstacles.{name}': value for name, value in floor.items()}
    assert Config.from_parameters(ARM | values).loads.obstacles == loads.obstacles[:1]
    assert Config.from_parameters(ARM).loads.obstacles == ()


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'type': ['plane', 'cube', 'sphere']}, r"obstacles.type\[1\] is 'cube', expected plane"),
        ({'type': ['plane']}, 'obstacles.position has 9 values, expected 3, three for each of'),
        ({'radius': [0.1]}, 'obstacles.radius has 1 values, expected 3, one per obstacle'),
        ({'radius': [0.0, 0.0, 0.1]}, r'obstacles\.radius\[1\] is 0.0, expected a finite'),
        ({'stiffness': []}, 'obstacles.stiffness has 0 values, expected 3, one for all or one pe'),
        ({'direction': [0.0] * 9}, r'obstacles\.direction\[0:3\] is \(0.0, .*, expected a dir'),
        ({'type': ['plane'] * 33}, 'obstacles.type has 33 values, expected at most 32'),
        ({'position': [float('nan')] * 9}, r'obstacles\.position\[0\] is nan, expected a fin'),
    ],
)
def test_invalid_obstacles_are_refused(changes, message):
    values = {f'obstacles.{name}': value for name, value in changes.items()}
    with pytest.raises((ConfigError, ArmDefinitionError), match=message):
        Config.from_parameters(ARM | THREE | values)


def test_node_with_friction_of_obstacles_is_refused():
    config = Config.from_parameters(ARM | THREE)
    with pytest.raises(ConfigError, match=r'loads.obstacles have friction'):
        config.node_solver()


# Values beside others ----------------------------------------------------------------------------


def valid_value(parameter: Parameter) -> Any:
    """Return a valid value of a ``parameter``."""
    value = {float: 0.25, int: 2, str: 'linear'}[parameter.kind]
    value = 'cylinder' if parameter.name == 'motion.water' else value
    return [value] if parameter.is_array else value


BY_NAME = {one.name: one for one in PARAMETERS}
ALTERNATIVES = [(one, BY_NAME[other]) for one in PARAMETERS for other in one.unless]


@pytest.mark.parametrize(('one', 'other'), ALTERNATIVES, ids=lambda one: one.name)
def test_two_values_of_one_quantity_are_refused(one, other):
    rest = {name: v for name, v in ARM.items() if other.name not in BY_NAME[name].unless}
    both = {'loads.fluid_density': 1e3, one.name: valid_value(one), other.name: valid_value(other)}
    why = f'^{one.name} is .*, expected .* or no value where {other.name} is given$'
    with pytest.raises(ConfigError, match=why):
        Config.from_parameters(rest | both)


@pytest.mark.parametrize('one', [one for one in PARAMETERS if one.needs], ids=lambda one: one.name)
def test_values_without_effect_are_refused(one):
    why = f'^{one.name} is .*, expected .* or no value without {" or ".join(one.needs)}$'
    with pytest.raises(ConfigError, match=why):
        Config.from_parameters(ARM | {one.name: valid_value(one)})


def test_zeros_and_empty_lists_are_unset_as_in_ros():
    arm = ARM | {'body.width': 0.0, 'material.shear_modulus': 0.0, 'tendons.table_s': []}
    assert Config.from_parameters(arm | {'body.inner_radius': 0.0}) == Config.from_parameters(ARM)
