"""Movements that are built in, and limits of commanded tensions."""

import re
from pathlib import Path

import numpy as np
import pytest
from checkout import PRESETS
from numpy.testing import assert_allclose, assert_array_equal

import octo_arm_model
from octo_arm_model import ConfigError, TensionError, load_config
from octo_arm_model.arm.errors import ProfileError
from octo_arm_model.config.config import Config
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
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

ANY_ARM = ('ramps', 'steps', 'sweeps')


def test_every_movement_of_every_arm_can_be_answered_by_its_model(preset):
    solver = preset.solver()
    assert set(ANY_ARM) < set(profile_names(preset.arm))
    for name in profile_names(preset.arm):
        profile = find_profile(name, preset.arm)
        times = np.linspace(0.0, profile.duration, 60)
        shape = solver.solve(profile.at(times).reshape(-1, *preset.arm.tension_shape))
        moved = np.linalg.norm(shape.tip - shape.tip[0], axis=-1).max()
        assert moved > 0.1 * preset.arm.length, name
        for end in (0.0, profile.duration):
            assert not profile.at(end).any(), f'{name} does not begin and end slack'


def test_movements_of_any_arm_are_for_rods_of_three_tendons_too(rod):
    assert tuple(profile_names(rod.arm)) == ANY_ARM
    with pytest.raises(ProfileError, match='four tendons in section 1, this arm has 3'):
        find_profile('rotating', rod.arm)


def test_the_papers_tensions_are_held(table2, table4):
    for arm, name, postures in (
        (table4.arm, 'fetching_in_plane', [FETCHING_IN_PLANE]),
        (table4.arm, 'fetching_in_space', [FETCHING_IN_SPACE]),
        (table4.arm, 'fetching', [FETCHING_IN_PLANE, FETCHING_IN_SPACE]),
        (table2.arm, 'bending_b', [BENDING['B']]),
        (table2.arm, 'bending', list(BENDING.values())),
    ):
        profile = find_profile(name, arm)
        tensions = profile.at(np.arange(0.0, profile.duration, 0.01)).reshape(-1, 3, 4)
        moments = [(tensions == np.array(posture)).all(axis=(1, 2)) for posture in postures]
        assert all(is_there.sum() > 90 for is_there in moments), name
        assert (np.diff([np.argmax(is_there) for is_there in moments]) > 0).all(), name


def test_the_papers_tensions_are_refused_where_they_are_of_no_use(table4, prototype):
    assert 'bending' not in profile_names(table4.arm)
    with pytest.raises(ProfileError, match=r'are for renda2012_table2, and would compress'):
        find_profile('bending', table4.arm)
    with pytest.raises(ProfileError, match=r'are for 3 sections of 4 tendons, such as renda'):
        find_profile('fetching_in_space', prototype.arm)
    with pytest.raises(ProfileError, match='highest does not go with tensions of the paper'):
        find_profile('fetching', table4.arm, 1.0)


def test_the_bending_plane_goes_round_steadily(table2):
    profile = find_profile('rotating', table2.arm)
    times = np.linspace(0.3, 0.7, 200) * profile.duration
    t1, t2, t3, t4 = profile.at(times)[:, :4].T
    turned = np.diff(np.unwrap(np.arctan2(t3 - t1, t2 - t4)))
    assert_allclose(turned, turned.mean(), rtol=0.01)
    assert abs(turned.sum()) > 2.0 * np.pi
    assert not profile.tensions[:, 4:].any()


@pytest.mark.parametrize('name', ANY_ARM)
def test_tendons_are_pulled_one_by_one_up_to_their_highest(table4, name):
    highest = np.arange(1.0, 13.0).reshape(3, 4)
    profile = find_profile(name, table4.arm, highest)
    assert ((profile.tensions > 0.0).sum(axis=1) <= 1).all()
    assert_allclose(profile.tensions.max(axis=0), highest.ravel(), rtol=0.01)
    first = np.argmax(profile.tensions > 0.0, axis=0)
    assert (np.diff(first) > 0).all()


def test_sweeps_sweep_up_in_frequency(prototype):
    profile = find_profile('sweeps', prototype.arm)
    tensions = profile.tensions[:, 0]
    inside = tensions[1:-1]
    peaks = 1 + np.flatnonzero((inside > tensions[:-2]) & (inside >= tensions[2:]) & (inside > 0))
    periods = np.diff(profile.times[peaks])
    assert (np.diff(periods) < 0.0).all()
    assert periods[-1] < 0.5 * periods[0]


@pytest.mark.parametrize(
    'highest', [-1.0, np.nan, np.inf, 'much', [1.0, 2.0], [[1.0], [2.0, 3.0]]]
)
def test_highest_tensions_that_are_none_are_refused(table4, highest):
    with pytest.raises(TensionError, match='highest'):
        find_profile('ramps', table4.arm, highest)


def test_an_unknown_name_is_answered_with_those_there_are(prototype):
    with pytest.raises(ProfileError) as caught:
        find_profile('dance', prototype.arm)
    assert str(caught.value) == (
        "no profile 'dance', expected a .csv or .yaml file or one of rotating, ramps, steps, "
        'sweeps'
    )


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
