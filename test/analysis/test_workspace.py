"""Workspaces: sampled tensions and tips, in one process, in several and on clusters."""

import dataclasses
import functools
import multiprocessing
import socket
import sys

import numpy as np
import pytest
from command_line import HIGHEST
from numpy.testing import assert_allclose, assert_array_equal

from octo_arm_model import ConfigError, SolveError
from octo_arm_model.analysis import worker_pool
from octo_arm_model.analysis.workspace import CHUNK, Workspace, sample_workspace

# In closed_form, a sum of 1.4 N in section 1 compresses the tip of this arm completely.
TOO_HIGH = np.array([[0.6] * 4, [1.0] * 4, [4.0] * 4])


def assert_same(one: Workspace, other: Workspace) -> None:
    for field in dataclasses.fields(Workspace):
        a, b = (np.asarray(getattr(workspace, field.name)) for workspace in (one, other))
        assert (a.shape, a.dtype) == (b.shape, b.dtype), field.name
        assert_allclose(a, b, rtol=0.0, atol=1e-12, err_msg=field.name)


def test_tensions_are_uniform_in_their_range(cloud):
    fraction = cloud.tensions / HIGHEST
    assert cloud.tensions.shape == (4 * CHUNK, 3, 4)
    assert fraction.min() >= 0.0
    assert fraction.max() <= 1.0
    # With a power of two of Sobol points, each eighth of the range has the same number of points.
    eighths = np.floor(fraction.reshape(len(fraction), -1) * 8.0).astype(int)
    for tendon in eighths.T:
        assert_array_equal(np.bincount(tendon), len(fraction) // 8)
    assert_array_equal(cloud.highest, HIGHEST)


def test_tips_and_directions_equal_those_of_the_solver(table4, cloud):
    backbone = table4.solver().solve(cloud.tensions)
    assert_allclose(cloud.tip, backbone.tip, rtol=0.0, atol=1e-9)
    assert cloud.refused == 0
    assert_allclose(np.linalg.norm(cloud.direction, axis=1), 1.0, atol=1e-12)
    backbone = table4.solver(stations=2001).solve(cloud.tensions[:8])
    step = backbone.position[:, -1] - backbone.position[:, -2]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    assert_allclose(cloud.direction[:8], step, atol=0.02)
    for array in (cloud.tensions, cloud.tip, cloud.direction, cloud.highest):
        assert not array.flags.writeable


def test_workspace_uses_model_and_loads_of_the_config(prototype):
    light = dataclasses.replace(prototype, model='exact', stations=21)
    heavy = dataclasses.replace(
        light,
        arm=light.arm.with_density(1080.0),
        loads=dataclasses.replace(light.loads, gravity=(0.0, 0.0, -9.81)),
    )
    tips = []
    for config in (light, heavy):
        workspace = sample_workspace(config, 1.0, 2, processes=1)
        expected = config.solver().solve(workspace.tensions).tip
        assert_allclose(workspace.tip, expected, rtol=0.0, atol=1e-9)
        tips.append(workspace.tip[:, 2])
    assert (tips[1] < tips[0] - 0.01).all()


def test_seed_determines_the_samples(table4):
    first, again, other = (
        sample_workspace(table4, HIGHEST, 16, seed, processes=1) for seed in (3, 3, 4)
    )
    assert_same(first, again)
    assert not np.isin(first.tensions, other.tensions).any()


@pytest.mark.parametrize('samples', [1, 3, CHUNK, CHUNK + 1, 200])
def test_fewer_samples_are_the_first_of_more(table4, cloud, samples):
    few = sample_workspace(table4, HIGHEST, samples, processes=1)
    assert_array_equal(few.tensions, cloud.tensions[:samples])
    assert_allclose(few.tip, cloud.tip[:samples], rtol=0.0, atol=1e-9)


def test_sets_without_solution_are_counted_and_left_out(table4):
    # Divided by a power of two these are the same sets without rounding, and all have solutions.
    config = dataclasses.replace(table4, model='closed_form')
    scaled = sample_workspace(config, TOO_HIGH / 1024.0, 2 * CHUNK, processes=1)
    assert scaled.refused == 0
    solver = config.solver()
    solutions = []
    for tensions in scaled.tensions * 1024.0:
        try:
            solutions.append((tensions, solver.solve(tensions).tip))
        except SolveError:
            continue
    workspace = sample_workspace(config, TOO_HIGH, 2 * CHUNK, processes=1)
    assert 0 < workspace.refused < 2 * CHUNK
    assert workspace.refused == 2 * CHUNK - len(solutions)
    tensions, tip = map(np.array, zip(*solutions))
    assert_array_equal(workspace.tensions, tensions)
    assert_allclose(workspace.tip, tip, rtol=0.0, atol=1e-9)
    assert len(workspace.direction) == len(tip)


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
def test_invalid_options_are_refused(table4, given, message):
    with pytest.raises(ConfigError, match=message):
        sample_workspace(table4, HIGHEST, **given)


def test_two_processes_give_the_same_workspace(table4):
    # Some sets have no solution, and the last chunk is not full.
    config, count = dataclasses.replace(table4, model='closed_form'), CHUNK + 5
    calls = []
    alone = sample_workspace(
        config, TOO_HIGH, count, processes=1, progress=lambda *given: calls.append(given)
    )
    assert alone.refused
    assert calls == [(done, count) for done in (0, CHUNK, count)]
    assert_same(sample_workspace(config, TOO_HIGH, count, processes=2), alone)


def test_interrupt_ends_all_workers(table4):
    def interrupt(done, total):
        if done:
            assert multiprocessing.active_children()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sample_workspace(table4, HIGHEST, 16 * CHUNK, processes=2, progress=interrupt)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(('model', 'chunks'), [('closed_form', 3), ('exact', 16)])
def test_dask_cluster_gives_the_same_workspace(table4, model, chunks, request):
    distributed = pytest.importorskip('distributed')
    # A solver that threads of a worker shared gave wrong shapes, the sooner they take turns.
    request.addfinalizer(functools.partial(sys.setswitchinterval, sys.getswitchinterval()))
    sys.setswitchinterval(1e-5)
    config, count = dataclasses.replace(table4, model=model), chunks * CHUNK + 5
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=4, processes=False, dashboard_address=None
    ) as cluster:
        calls = []
        workspace = sample_workspace(
            config,
            TOO_HIGH,
            count,
            scheduler=cluster.scheduler_address,
            progress=lambda *given: calls.append(given),
        )
    assert workspace.refused or model == 'exact'
    assert_same(workspace, sample_workspace(config, TOO_HIGH, count, processes=1))
    assert calls[-1] == (count, count)


def test_unreachable_scheduler_is_one_line_of_error(table4, monkeypatch):
    pytest.importorskip('distributed')
    monkeypatch.setattr(worker_pool, '_CONNECT', 0.2)
    with socket.socket() as occupied:  # bound, but not listening
        occupied.bind(('127.0.0.1', 0))
        silent = f'tcp://127.0.0.1:{occupied.getsockname()[1]}'
        for address in (silent, 'nowhere', 'carrier-pigeon://loft:1', ''):
            with pytest.raises(ConfigError) as caught:
                sample_workspace(table4, HIGHEST, 8, scheduler=address)
            message = str(caught.value)
            assert f'scheduler is {address!r}, expected the address of a running' in message
            assert '\n' not in message
