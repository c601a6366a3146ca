"""Limits of commanded tensions."""

import re
from pathlib import Path

import numpy as np
import pytest
from checkout import PRESETS
from numpy.testing import assert_array_equal

import octo_arm_model
from octo_arm_model import ConfigError, TensionError, load_config
from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.simulation.movements import (
    check_command,
    check_profile,
    find_profile,
    highest_tensions,
    profile_names,
    tendon_limits,
)
from octo_arm_model.simulation.profiles import CommandProfile

TABLE4 = preset_path('renda2012_table4')
CONFIG = load_config(TABLE4)


def with_limits(limits):
    return Config.from_parameters({**load_parameters(TABLE4), 'tendon_limits': limits})


@pytest.mark.parametrize('name', PRESETS)
def test_every_movement_of_an_arm_is_within_its_limits(name):
    config = load_config(preset_path(name))
    for movement in profile_names(config.arm):
        check_profile(find_profile(movement, config.arm), config.arm, tendon_limits(config))


def test_limits_given_take_the_place_of_what_the_arm_bears():
    assert_array_equal(tendon_limits(CONFIG), highest_tensions(CONFIG.arm))
    given = [0.1 * (j + 1) for j in range(12)]
    assert_array_equal(tendon_limits(with_limits(given)), given)


def test_limits_are_one_of_each_tendon():
    with pytest.raises(ConfigError, match='tendon_limits has 2 values, expected 12'):
        with_limits([1.0, 2.0])


def test_what_is_at_its_limit_is_commanded_and_what_is_beyond_is_not():
    limits = tendon_limits(CONFIG)
    for shape in (12, (3, 4)):
        assert_array_equal(check_command(CONFIG.arm, limits.reshape(shape), limits), limits)
    for tendon in range(12):
        beyond = np.zeros(12)
        beyond[tendon] = limits[tendon] * 1.001
        name = CONFIG.arm.tendon_names[tendon]
        with pytest.raises(TensionError, match=f'tension of {name} is .* its limit'):
            check_command(CONFIG.arm, beyond, limits)


@pytest.mark.parametrize('value', [-1e-9, np.nan, np.inf, -np.inf])
def test_what_is_no_tension_is_not_commanded(value):
    tensions = np.zeros(12)
    tensions[7] = value
    with pytest.raises(TensionError, match='tendon_2_4'):
        check_command(CONFIG.arm, tensions, tendon_limits(CONFIG))


@pytest.mark.parametrize('shape', [(11,), (2, 12), (2, 3, 4), ()])
def test_one_set_of_tensions_is_commanded_at_a_time(shape):
    with pytest.raises(TensionError, match='shape'):
        check_command(CONFIG.arm, np.zeros(shape), tendon_limits(CONFIG))


def test_a_profile_beyond_a_limit_is_refused_with_its_row():
    limits = tendon_limits(CONFIG)
    rows = np.zeros((3, 12))
    rows[1, 4] = 2.0 * limits[4]
    with pytest.raises(ProfileError, match=r'row 2: tension of tendon_2_1 is 8\.0 N.* limit 4\.0'):
        check_profile(CommandProfile(np.arange(3.0), rows), CONFIG.arm, limits)


def test_commands_are_published_in_one_place():
    folder = Path(octo_arm_model.__file__).parent
    makes = re.compile(r'create_publisher\((\w+,)?\s*TendonTensions')
    found = {
        path.relative_to(folder).as_posix()
        for path in folder.rglob('*.py')
        if makes.search(path.read_text())
    }
    # The simulator publishes what it measures.
    assert found == {'ros/client/commands.py', 'ros/simulator/main.py'}
