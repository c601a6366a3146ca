"""`octo-arm workspace`: the picture, the summary, JSON and wrong input."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from workspaces import HIGHEST

from octo_arm_model import Config
from octo_arm_model.analysis.workspace import Workspace, sample_workspace
from octo_arm_model.cli import workspace
from octo_arm_model.cli.main import main


def run(*arguments: str) -> int:
    return main(['workspace', *arguments])


def assert_picture(path: Path) -> np.ndarray:
    picture = pytest.importorskip('matplotlib.image').imread(path)[..., :3]
    height, width, _ = picture.shape
    assert min(height, width) > 800
    rows, columns = np.nonzero(picture.min(axis=-1) < 0.9)
    assert np.ptp(rows) > 0.9 * height
    assert np.ptp(columns) > 0.9 * width
    return picture


def colourful(picture: np.ndarray) -> int:
    """Number of coloured pixels left of the colour bar."""
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
    from octo_arm_model.analysis.workspace import draw_workspace

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
    config = dataclasses.replace(table4, model='closed_form')
    expected = sample_workspace(config, 0.6, 96, 7, processes=1)
    assert expected.refused
    assert (found['refused'], found['samples']) == (expected.refused, 96)
    assert (found['model'], found['seed']) == ('closed_form', 7)
    for name in ('highest', 'tensions', 'tip', 'direction'):
        np.testing.assert_allclose(found[name], getattr(expected, name), atol=1e-12, err_msg=name)
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
    ('arguments', 'message'),
    [
        (('--highest', 'much'), '--highest is not JSON at character 1, expected'),
        (('--highest', '"1"'), '--highest is "1", expected a number or rows'),
        (('--highest', '[[1]]'), 'highest: tensions have shape (1, 1)'),
        (('--samples', '0'), 'samples is 0, expected'),
        (('--out', '.'), "--out is '.', a folder, expected a file"),
    ],
)
def test_bad_arguments_of_the_command_are_refused_by_name(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    assert run('renda2012_table4', *arguments) == 2
    assert capsys.readouterr().err.startswith(f'octo-arm: error: {message}')


def test_an_interrupted_command_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> Workspace:
        raise KeyboardInterrupt

    monkeypatch.setattr(workspace, 'sample_workspace', interrupted)
    assert run('renda2012_table4', '--json') == 130
    assert capsys.readouterr() == ('', 'octo-arm: interrupted\n')


def test_help_tells_units_defaults_and_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run('--help')
    text = ' '.join(capsys.readouterr().out.split())
    for expected in ('largest tension [N]', '4096', '10 percent', 'octo_arm_model[cluster]'):
        assert expected in text
    assert 'octo-arm workspace renda2012_table4 --out cloud.png' in text
