"""Worker processes and clusters: the same tips, and how they end."""

from __future__ import annotations

import dataclasses
import multiprocessing
import socket
import sys
from typing import NoReturn

import pytest
from workspaces import HIGHEST, TOO_HIGH, assert_same

from octo_arm_model import Arm, Body, Config, ConfigError, Function, Material
from octo_arm_model.analysis import worker_pool
from octo_arm_model.analysis.workspace import CHUNK, Workspace, sample_workspace


def test_two_processes_give_the_same(table4: Config) -> None:
    # Some sets are refused, and the last chunk is not full.
    config, count = dataclasses.replace(table4, model='closed_form'), 3 * CHUNK + 5
    alone = sample_workspace(config, TOO_HIGH, count, processes=1)
    assert alone.refused
    assert_same(sample_workspace(config, TOO_HIGH, count, processes=2), alone)


def test_by_default_processes_are_started_where_they_pay(
    table4: Config, cloud: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Started(Exception):
        pass

    def start(*given: object) -> NoReturn:
        raise Started

    monkeypatch.setattr(worker_pool, '_in_pool', start)
    monkeypatch.setattr(worker_pool.os, 'sched_getaffinity', lambda pid: {0, 1}, raising=False)
    assert_same(sample_workspace(table4, HIGHEST, 4 * CHUNK), cloud)
    monkeypatch.setattr(worker_pool, '_POOL_START', 0.0)
    with pytest.raises(Started):
        sample_workspace(table4, HIGHEST, 4 * CHUNK)


def test_an_interrupt_ends_all_workers(table4: Config) -> None:
    def interrupt(done: int, total: int) -> None:
        if done:
            assert multiprocessing.active_children()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sample_workspace(table4, HIGHEST, 16 * CHUNK, processes=2, progress=interrupt)
    assert not multiprocessing.active_children()


def test_progress_goes_from_none_to_all(table4: Config) -> None:
    calls: list[tuple[int, int]] = []
    count = 2 * CHUNK + 1
    sample_workspace(
        table4, HIGHEST, count, processes=1, progress=lambda *given: calls.append(given)
    )
    assert calls == [(0, count), (CHUNK, count), (2 * CHUNK, count), (count, count)]


def test_a_dask_cluster_gives_the_same(table4: Config) -> None:
    distributed = pytest.importorskip('distributed')
    config, count = dataclasses.replace(table4, model='closed_form'), 3 * CHUNK + 5
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        calls: list[tuple[int, int]] = []
        workspace = sample_workspace(
            config,
            TOO_HIGH,
            count,
            scheduler=cluster.scheduler_address,
            progress=lambda *given: calls.append(given),
        )
    assert workspace.refused
    assert_same(workspace, sample_workspace(config, TOO_HIGH, count, processes=1))
    assert calls[-1] == (count, count)


def test_a_missing_dask_says_how_to_install_it(
    table4: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'dask', None)
    with pytest.raises(ConfigError, match=r"pip install 'octo_arm_model\[cluster\]'"):
        sample_workspace(table4, HIGHEST, 8, scheduler='tcp://127.0.0.1:8786')


def test_a_scheduler_that_does_not_answer_is_one_line(
    table4: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('distributed')
    monkeypatch.setattr(worker_pool, '_CONNECT', 0.2)
    with socket.socket() as taken:  # bound, but not listening
        taken.bind(('127.0.0.1', 0))
        deaf = f'tcp://127.0.0.1:{taken.getsockname()[1]}'
        for address in (deaf, 'nowhere', 'carrier-pigeon://loft:1', ''):
            with pytest.raises(ConfigError) as caught:
                sample_workspace(table4, HIGHEST, 8, scheduler=address)
            message = str(caught.value)
            assert f'scheduler is {address!r}, expected the address of a running' in message
            assert '\n' not in message


def test_a_function_without_a_name_stays_in_this_process(table4: Config) -> None:
    arm = table4.arm
    softer = Material(Function(lambda s: 1.1e5 - 1e4 * s, table4.arm.length))
    assert isinstance(arm.body, Body)
    config = dataclasses.replace(
        table4, arm=Arm(softer, arm.body, arm.sections), model='closed_form'
    )
    assert len(sample_workspace(config, HIGHEST, 8, processes=1).tip) == 8
    with pytest.raises(ConfigError, match=r'cannot be sent to other processes .* or processes=1'):
        sample_workspace(config, HIGHEST, 2 * CHUNK, processes=2)
