"""Workspaces: the sampled tensions, their tips, and invalid input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from workspaces import HIGHEST, TOO_HIGH, assert_same

from octo_arm_model import Config, ConfigError, SolveError, TensionError
from octo_arm_model.analysis.workspace import CHUNK, Workspace, sample_workspace


def loaded(config: Config) -> Config:
    """The same arm with a density, in gravity."""
    return dataclasses.replace(
        config,
        arm=config.arm.with_density(1080.0),
        model='exact',
        loads=dataclasses.replace(config.loads, gravity=(0.0, 0.0, -9.81)),
    )


def test_tensions_lie_in_the_box_and_fill_it(cloud: Workspace) -> None:
    part = cloud.tensions / HIGHEST
    assert cloud.tensions.shape == (4 * CHUNK, 3, 4)
    assert part.min() >= 0.0
    assert part.max() <= 1.0
    # Of a power of two of Sobol points each eighth of the range holds the same number.
    eighths = np.floor(part.reshape(len(part), -1) * 8.0).astype(int)
    for tendon in eighths.T:
        np.testing.assert_array_equal(np.bincount(tendon), len(part) // 8)
    np.testing.assert_array_equal(cloud.highest, HIGHEST)


def test_every_tip_is_what_the_solver_gives(table4: Config, cloud: Workspace) -> None:
    backbone = table4.solver().solve(cloud.tensions)
    np.testing.assert_allclose(cloud.tip, backbone.tip, rtol=0.0, atol=1e-9)
    assert cloud.refused == 0


def test_the_direction_is_the_tangent_at_the_tip(table4: Config, cloud: Workspace) -> None:
    np.testing.assert_allclose(np.linalg.norm(cloud.direction, axis=1), 1.0, atol=1e-12)
    backbone = table4.solver(stations=2001).solve(cloud.tensions[:8])
    step = backbone.position[:, -1] - backbone.position[:, -2]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    np.testing.assert_allclose(cloud.direction[:8], step, atol=0.02)


def test_model_and_stations_are_those_of_the_config(table4: Config) -> None:
    config = dataclasses.replace(table4, model='exact', stations=11)
    workspace = sample_workspace(config, HIGHEST, 8, processes=1)
    expected = table4.solver('exact', 11).solve(workspace.tensions).tip
    np.testing.assert_allclose(workspace.tip, expected, rtol=0.0, atol=1e-9)


def test_a_loaded_arm_is_solved_with_its_loads(prototype: Config) -> None:
    config = dataclasses.replace(loaded(prototype), stations=21)
    workspace = sample_workspace(config, 1.0, 2, processes=1)
    expected = config.solver().solve(workspace.tensions).tip
    np.testing.assert_allclose(workspace.tip, expected, rtol=0.0, atol=1e-9)
    exact = dataclasses.replace(prototype, model='exact', stations=21)
    light = sample_workspace(exact, 1.0, 2, processes=1)
    assert (workspace.tip[:, 2] < light.tip[:, 2] - 0.01).all()


def test_one_number_is_for_all_tendons_and_zero_leaves_one_slack(table4: Config) -> None:
    one = sample_workspace(table4, 0.1, 16, processes=1)
    assert_same(one, sample_workspace(table4, np.full((3, 4), 0.1), 16, processes=1))
    slack = sample_workspace(table4, [[0.0] * 4, [1.0] * 4, [4.0] * 4], 16, processes=1)
    assert not slack.tensions[:, 0].any()
    assert slack.tensions[:, 1:].all()


def test_a_seed_gives_the_same_again_and_another_gives_others(table4: Config) -> None:
    first, again, other = (
        sample_workspace(table4, HIGHEST, 16, seed, processes=1) for seed in (3, 3, 4)
    )
    assert_same(first, again)
    assert not np.isin(first.tensions, other.tensions).any()


@pytest.mark.parametrize('samples', [1, 3, CHUNK, CHUNK + 1, 200])
def test_any_number_of_samples_is_the_first_of_more(
    table4: Config, cloud: Workspace, samples: int
) -> None:
    few = sample_workspace(table4, HIGHEST, samples, processes=1)
    np.testing.assert_array_equal(few.tensions, cloud.tensions[:samples])
    np.testing.assert_allclose(few.tip, cloud.tip[:samples], rtol=0.0, atol=1e-9)


def test_results_cannot_be_changed(cloud: Workspace) -> None:
    for array in (cloud.tensions, cloud.tip, cloud.direction, cloud.highest):
        assert not array.flags.writeable


def test_refused_sets_are_counted_and_not_in_the_cloud(table4: Config) -> None:
    # Divided by a power of two the same sets are drawn without rounding, and all have a solution.
    config = dataclasses.replace(table4, model='closed_form')
    drawn = sample_workspace(config, TOO_HIGH / 1024.0, 2 * CHUNK, processes=1)
    assert drawn.refused == 0
    solver = config.solver()
    answered = []
    for tensions in drawn.tensions * 1024.0:
        try:
            answered.append((tensions, solver.solve(tensions).tip))
        except SolveError:
            continue
    workspace = sample_workspace(config, TOO_HIGH, 2 * CHUNK, processes=1)
    assert 0 < workspace.refused < 2 * CHUNK
    assert workspace.refused == 2 * CHUNK - len(answered)
    tensions, tip = map(np.array, zip(*answered))
    np.testing.assert_array_equal(workspace.tensions, tensions)
    np.testing.assert_allclose(workspace.tip, tip, rtol=0.0, atol=1e-9)
    assert len(workspace.direction) == len(tip)


def test_all_may_be_refused(table4: Config) -> None:
    workspace = sample_workspace(table4, 1e9, 8, processes=1)
    assert workspace.refused == 8
    assert workspace.tip.shape == workspace.direction.shape == (0, 3)
    assert workspace.tensions.shape == (0, 3, 4)


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'samples': 0}, r'samples is 0, expected a whole number >= 1 and <= 1048576'),
        ({'samples': -4}, 'samples is -4, expected'),
        ({'samples': 2.5}, r'samples is 2\.5, expected'),
        ({'samples': '8'}, "samples is '8', expected"),
        ({'samples': True}, 'samples is True, expected'),
        ({'samples': 2**31}, 'samples is 2147483648, expected'),
        ({'seed': -1}, 'seed is -1, expected a whole number >= 0'),
        ({'seed': None}, 'seed is None, expected'),
        ({'processes': 0}, 'processes is 0, expected a whole number >= 1'),
        ({'processes': 1.0}, r'processes is 1\.0, expected'),
        ({'processes': 2, 'scheduler': 'tcp://x:1'}, 'processes is 2 and scheduler is .*one of'),
    ],
)
def test_bad_options_are_refused_by_name(
    table4: Config, given: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        sample_workspace(table4, HIGHEST, **given)


@pytest.mark.parametrize(
    ('highest', 'message'),
    [
        (-1.0, r'highest: tension of tendon_1_1 is -1\.0 N, expected a finite number >= 0'),
        (float('nan'), 'highest: tension of tendon_1_1 is nan N, expected'),
        (np.where(np.eye(3, 4) > 0, np.inf, 1.0), 'highest: tension of tendon_1_1 is inf N'),
        ([1.0, 2.0, 3.0, 4.0], r'highest: tensions have shape \(4,\), expected'),
        ([[1.0], [1.0, 2.0]], 'highest: tensions must be numbers in rows of equal length'),
        (np.ones((2, 3, 4)), r'highest has shape \(2, 3, 4\), expected one number or \(3, 4\)'),
        ('much', 'highest: tensions must be numbers'),
        (True, 'highest: tensions must be numbers'),
        (None, 'highest: tensions must be numbers'),
    ],
)
def test_a_bad_box_is_refused(table4: Config, highest: object, message: str) -> None:
    with pytest.raises(TensionError, match=message):
        sample_workspace(table4, highest, 8)
