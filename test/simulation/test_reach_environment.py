"""The environment of Gymnasium, by its own checker."""

import warnings
from typing import Any

import numpy as np
import pytest

from octo_arm_model import Dynamics, MotionProperties, OctoArmError, Solver, load_config


@pytest.fixture(scope='module')
def dynamics() -> Dynamics:
    arm = load_config('renda2012_prototype').arm.with_density(1080.0)
    return Dynamics(Solver(arm, 'exact', stations=5), MotionProperties(viscosity=300.0))


@pytest.fixture(scope='module')
def environment() -> Any:
    """The class of it."""
    pytest.importorskip('gymnasium', reason='needs gymnasium')
    from octo_arm_model.simulation.reach_environment import ReachEnvironment

    return ReachEnvironment


def test_it_is_what_gymnasium_expects(environment, dynamics):
    checker = pytest.importorskip('gymnasium.utils.env_checker', reason='needs gymnasium')
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        # Places have no bounds.
        warnings.filterwarnings('ignore', message='.*Box observation space (min|max)imum value')
        warnings.filterwarnings('ignore', message='.*(not having|without) a spec|.*render')
        checker.check_env(environment(dynamics, divisions=2))


def test_what_is_restored_goes_on_to_the_same_bits(environment, dynamics):
    one = environment(dynamics, steps=4)
    one.reset(seed=1)
    actions = [one.action_space.sample() for _ in range(4)]
    one.step(actions[0])
    kept = one.snapshot
    first = [one.step(action) for action in actions[1:]]
    one.snapshot = kept
    again = [one.step(action) for action in actions[1:]]
    for before, after in zip(first, again):
        np.testing.assert_array_equal(before[0], after[0])
    assert [step[3] for step in again] == [False, False, True]
    # The way to the target is the distance that counts.
    observation, reward, ended, _, info = again[-1]
    assert info['distance'] == pytest.approx(np.linalg.norm(observation[6:9]))
    assert reward == pytest.approx(-info['distance'] / dynamics.solver.arm.length)
    assert not ended


def test_arms_of_one_process_do_not_disturb_each_other(environment, dynamics):
    makers = 3 * [lambda: environment(dynamics, divisions=1)]
    arms = pytest.importorskip('gymnasium').vector.SyncVectorEnv(makers)
    arms.reset(seed=[0, 1, 2])
    alone = environment(dynamics, divisions=1)
    alone.reset(seed=1)
    for pull in (0.0, 0.5, -0.5):
        actions = np.full((3, 4), -1.0)
        actions[:, 1] = [-1.0, pull, 1.0]
        together, *_ = arms.step(actions)
        np.testing.assert_array_equal(together[1], alone.step(actions[1])[0])
    assert np.ptp(together[:, :3], axis=0).max() > 1e-4


def test_a_motion_that_ends_ends_the_episode(environment, dynamics):
    crushed = environment(dynamics, np.full(dynamics.solver.arm.tension_shape, 1e4))
    crushed.reset(options={'target': (0.2, 0.0, 0.0)})
    *_, ended, truncated, info = crushed.step(np.ones(4))
    assert (ended, truncated) == (True, False) and info['error']


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'highest': np.zeros((1, 4))}, 'highest tension of tendon_1_1 is 0.0 N'),
        ({'highest': np.ones(3)}, 'highest is'),
        ({'divisions': 0}, 'divisions is 0'),
        ({'steps': -1}, 'steps is -1'),
        ({'period': float('nan')}, 'period is nan'),
    ],
)
def test_an_environment_that_could_not_go_on_is_refused(environment, dynamics, given, message):
    with pytest.raises(OctoArmError, match=message):
        environment(dynamics, **given)
    with pytest.raises(OctoArmError, match='target is'):
        environment(dynamics).reset(options={'target': (0.1, np.nan, 0.0)})
