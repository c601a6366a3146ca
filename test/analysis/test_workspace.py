"""Where the tip can go: the cloud of tips, who solves it, its picture and its command."""

from __future__ import annotations

import argparse
import dataclasses
import io
import json
import multiprocessing
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

from octo_arm_model import (
    Arm,
    Body,
    Config,
    ConfigError,
    Function,
    Material,
    SolveError,
    TensionError,
)
from octo_arm_model.analysis import worker_pool as module
from octo_arm_model.analysis.workspace import CHUNK, Workspace, sample_workspace
from octo_arm_model.cli import progress
from octo_arm_model.cli import workspace as workspace_cli

HIGHEST = np.array([[0.1] * 4, [1.0] * 4, [4.0] * 4])
# Closed form: alone, four tendons of 1.4 N in all compress the tip of this arm to nothing.
TOO_HIGH = np.array([[0.6] * 4, [1.0] * 4, [4.0] * 4])


def assert_same(one: Workspace, other: Workspace) -> None:
    """Bit by bit."""
    for field in dataclasses.fields(Workspace):
        a, b = (np.asarray(getattr(workspace, field.name)) for workspace in (one, other))
        assert (a.shape, a.dtype, a.tobytes()) == (b.shape, b.dtype, b.tobytes()), field.name


def loaded(config: Config) -> Config:
    """The same arm, heavy."""
    material = dataclasses.replace(config.arm.material, density=1080.0)
    return dataclasses.replace(
        config,
        arm=dataclasses.replace(config.arm, material=material),
        model='exact',
        loads=dataclasses.replace(config.loads, gravity=(0.0, 0.0, -9.81)),
    )


@pytest.fixture(scope='module')
def cloud(table4: Config) -> Workspace:
    return sample_workspace(table4, HIGHEST, 4 * CHUNK, processes=1)


def test_tensions_lie_in_the_box_and_fill_it(cloud: Workspace) -> None:
    part = cloud.tensions / HIGHEST
    assert cloud.tensions.shape == (4 * CHUNK, 3, 4)
    assert part.min() >= 0.0
    assert part.max() <= 1.0
    # Evenly: of a power of two of Sobol's points there are as many in every eighth.
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


def test_another_model_and_other_stations_can_be_asked_for(table4: Config) -> None:
    workspace = sample_workspace(table4, HIGHEST, 8, model='exact', stations=11, processes=1)
    expected = table4.solver('exact', 11).solve(workspace.tensions).tip
    np.testing.assert_allclose(workspace.tip, expected, rtol=0.0, atol=1e-9)


def test_a_loaded_arm_is_solved_with_its_loads(prototype: Config) -> None:
    config = loaded(prototype)
    workspace = sample_workspace(config, 1.0, 2, stations=21, processes=1)
    expected = config.solver(stations=21).solve(workspace.tensions).tip
    np.testing.assert_allclose(workspace.tip, expected, rtol=0.0, atol=1e-9)
    light = sample_workspace(prototype, 1.0, 2, model='exact', stations=21, processes=1)
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
    # Divided by a power of two the same sets are drawn to the last bit, and all have an answer.
    options = {'samples': 2 * CHUNK, 'model': 'closed_form', 'processes': 1}
    drawn = sample_workspace(table4, TOO_HIGH / 1024.0, **options)
    assert drawn.refused == 0
    solver = table4.solver('closed_form')
    answered = []
    for tensions in drawn.tensions * 1024.0:
        try:
            answered.append((tensions, solver.solve(tensions).tip))
        except SolveError:
            continue
    workspace = sample_workspace(table4, TOO_HIGH, **options)
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


@pytest.mark.usefixtures('numpy_to_the_last_bit')
def test_two_processes_give_the_same_to_the_last_bit(table4: Config) -> None:
    # Some refused, and a last chunk that is not full.
    options = {'samples': 3 * CHUNK + 5, 'model': 'closed_form'}
    alone = sample_workspace(table4, TOO_HIGH, processes=1, **options)
    assert alone.refused
    assert_same(sample_workspace(table4, TOO_HIGH, processes=2, **options), alone)


def test_by_default_processes_are_started_where_they_pay(
    table4: Config, cloud: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = []
    in_pool = module._in_pool
    monkeypatch.setattr(
        module, '_in_pool', lambda *given: started.append(given) or in_pool(*given)
    )
    monkeypatch.setattr(module.os, 'sched_getaffinity', lambda pid: {0, 1}, raising=False)
    assert_same(sample_workspace(table4, HIGHEST, 4 * CHUNK), cloud)
    assert not started
    monkeypatch.setattr(module, '_POOL_START', 0.0)
    assert_same(sample_workspace(table4, HIGHEST, 4 * CHUNK), cloud)
    assert len(started) == 1


def test_an_interrupt_ends_all_workers(table4: Config) -> None:
    def interrupt(done: int, total: int) -> None:
        if done:
            assert multiprocessing.active_children()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sample_workspace(table4, HIGHEST, 64 * CHUNK, processes=2, progress=interrupt)
    assert not multiprocessing.active_children()


def test_progress_goes_from_none_to_all(table4: Config) -> None:
    calls: list[tuple[int, int]] = []
    count = 2 * CHUNK + 1
    sample_workspace(
        table4, HIGHEST, count, processes=1, progress=lambda *given: calls.append(given)
    )
    assert calls == [(0, count), (CHUNK, count), (2 * CHUNK, count), (count, count)]


@pytest.mark.usefixtures('numpy_to_the_last_bit')
def test_a_dask_cluster_gives_the_same_to_the_last_bit(table4: Config) -> None:
    distributed = pytest.importorskip('distributed')
    options = {'samples': 3 * CHUNK + 5, 'model': 'closed_form'}
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        calls: list[tuple[int, int]] = []
        workspace = sample_workspace(
            table4,
            TOO_HIGH,
            scheduler=cluster.scheduler_address,
            progress=lambda *given: calls.append(given),
            **options,
        )
    assert workspace.refused
    assert_same(workspace, sample_workspace(table4, TOO_HIGH, processes=1, **options))
    assert calls[-1] == (3 * CHUNK + 5, 3 * CHUNK + 5)


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
    monkeypatch.setattr(module, '_CONNECT', 0.2)
    with socket.socket() as taken:  # bound, but nobody listens
        taken.bind(('127.0.0.1', 0))
        deaf = f'tcp://127.0.0.1:{taken.getsockname()[1]}'
        for address in (deaf, 'nowhere', 'carrier-pigeon://loft:1', ''):
            with pytest.raises(ConfigError) as caught:
                sample_workspace(table4, HIGHEST, 8, scheduler=address)
            message = str(caught.value)
            assert f'scheduler is {address!r}, expected the address of a running' in message
            assert '\n' not in message


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'samples': 0}, r'samples is 0, expected a whole number >= 1 and <= 1073741824'),
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
        ({'model': 'guess'}, "model is 'guess', expected one of"),
        ({'stations': 1}, 'stations'),
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


def run(*arguments: str) -> int:
    """As `octo_arm_model.cli.main.main` does, without the other commands."""
    parser = argparse.ArgumentParser(prog='octo-arm')
    workspace_cli.add_command(parser.add_subparsers(required=True))
    options = parser.parse_args(['workspace', *arguments])
    return options.run(options)


def assert_picture(path: Path) -> np.ndarray:
    picture = pytest.importorskip('matplotlib.image').imread(path)[..., :3]
    height, width, _ = picture.shape
    assert min(height, width) > 800
    rows, columns = np.nonzero(picture.min(axis=-1) < 0.9)
    assert np.ptp(rows) > 0.9 * height
    assert np.ptp(columns) > 0.9 * width
    return picture


def colourful(picture: np.ndarray) -> int:
    """Number of dots in colour left of the colour bar."""
    return int((np.ptp(picture[:, :1180], axis=-1) > 0.2).sum())


def test_the_command_writes_a_picture_and_says_how_far_the_tips_reach(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, cloud: Workspace
) -> None:
    path = tmp_path / 'new' / 'cloud'  # a PNG, whatever its name
    highest = json.dumps(HIGHEST.tolist())
    assert (
        run('renda2012_table4', '--highest', highest, '--samples', '256', '--out', str(path)) == 0
    )
    out, err = capsys.readouterr()
    assert 'tensions  up to 0.1 ... 4 N' in out
    assert 'tips      256 of 256 sets of tensions, 0 refused' in out
    for i, name in enumerate('xyz'):
        low, high = cloud.tip[:, i].min() * 1e3, cloud.tip[:, i].max() * 1e3
        assert f'{name}         {low:.2f} to {high:.2f} mm, {high - low:.2f} mm in all' in out
    assert f'picture   {path}' in out
    assert err.startswith('256 sets of tensions in ')
    assert (err.count('\n'), err.count('\r')) == (1, 0)
    assert colourful(assert_picture(path)) > 2000


def test_a_cloud_without_tips_is_a_picture_of_the_arm(tmp_path: Path, table4: Config) -> None:
    pytest.importorskip('matplotlib')
    from octo_arm_model.analysis.workspace_figure import draw_workspace

    empty = sample_workspace(table4, 1e9, 8, processes=1)
    draw_workspace(empty, table4.solver(), tmp_path / 'empty.png')
    assert colourful(assert_picture(tmp_path / 'empty.png')) == 0


def test_a_box_without_any_answer_is_told_and_what_to_do(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    assert run('renda2012_prototype', '--highest', '1e9', '--samples', '8') == 0
    out = capsys.readouterr().out
    assert 'tensions  up to 1e+09 N' in out
    assert '0 of 8 sets of tensions, 8 refused' in out
    assert 'none: give a lower --highest' in out
    assert (tmp_path / 'workspace.png').exists()


def test_json_is_one_object_in_si_units_and_draws_nothing(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    table4: Config,
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ('--samples', '96', '--seed', '7', '--model', 'closed_form', '--json')
    assert run('renda2012_table4', '--highest', '0.6', *arguments) == 0
    out, _ = capsys.readouterr()
    assert out.count('\n') == 1
    found = json.loads(out)
    expected = sample_workspace(table4, 0.6, 96, 7, model='closed_form', processes=1)
    assert expected.refused
    assert (found['refused'], found['samples']) == (expected.refused, 96)
    assert (found['model'], found['seed']) == ('closed_form', 7)
    for name in ('highest', 'tensions', 'tip', 'direction'):
        np.testing.assert_array_equal(found[name], getattr(expected, name), err_msg=name)
    assert not list(tmp_path.iterdir())


def test_by_default_a_tendon_compresses_its_thin_end_by_a_tenth(
    capsys: pytest.CaptureFixture[str], table4: Config
) -> None:
    assert run('renda2012_table4', '--samples', '4', '--json') == 0
    highest = np.array(json.loads(capsys.readouterr().out)['highest'])
    ends = [section.anchorage for section in table4.arm.sections]
    area = np.pi * table4.arm.body.radius(ends) ** 2
    np.testing.assert_allclose(highest, np.repeat(0.1 * 1.1e5 * area, 4).reshape(3, 4))
    # Alone, in the middle, it would shorten the end by a tenth: the four together by 0.4.
    ends_only = np.zeros((3, 4))
    ends_only[0] = highest[0] / 4.0
    q = table4.solver('closed_form').solve(ends_only).q[-1]
    assert q == pytest.approx(-0.1)


@pytest.mark.parametrize(
    ('arguments', 'error', 'message'),
    [
        (('--highest', 'much'), TensionError, '--highest is not JSON at character 1, expected'),
        (('--highest', '"1"'), TensionError, '--highest is "1", expected a number or rows'),
        (('--highest', '[[1]]'), TensionError, r'highest: tensions have shape \(1, 1\)'),
        (('--samples', '0'), ConfigError, 'samples is 0, expected'),
        (('--out', '.'), ConfigError, r"--out is '\.', a folder, expected a picture"),
    ],
)
def test_bad_arguments_of_the_command_are_refused_by_name(
    arguments: tuple[str, ...], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        run('renda2012_table4', '--json', *arguments)


def test_an_interrupted_command_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> Workspace:
        raise KeyboardInterrupt

    monkeypatch.setattr(workspace_cli, 'sample_workspace', interrupted)
    assert run('renda2012_table4', '--json') == 130
    assert capsys.readouterr() == ('', 'octo-arm: interrupted\n')


def test_help_tells_units_defaults_and_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run('--help')
    text = ' '.join(capsys.readouterr().out.split())
    for expected in ('largest tension [N]', '4096', '10 percent', 'octo_arm_model[cluster]'):
        assert expected in text
    assert 'octo-arm workspace renda2012_table4 --out cloud.png' in text


class Terminal(io.StringIO):
    """Something that takes itself for a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar_with_rate_and_remaining_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(progress, '_REFRESH', 0.0)
    terminal = Terminal()
    bar = progress.Bar(terminal, 'sets of tensions')
    for done in (0, 64, 128):
        bar(done, 128)
    bar.leave()
    bar.leave()
    start, half, end = terminal.getvalue().replace('\x1b[K', '').split('\r')[1:]
    assert start == f'[{"." * 30}] 0/128, 0/s, starting'
    assert half.startswith(f'[{"#" * 15}{"." * 15}] 64/128, ')
    assert half.endswith(' s left')
    assert end.startswith('128 sets of tensions in ')
    assert end.count('\n') == 1
