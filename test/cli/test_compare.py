"""`octo-arm compare`: the table, JSON, CSV and pictures."""

from __future__ import annotations

import csv
import functools
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import printed
from experiments import PARAMETERS, midline, one_tendon, path_sample, pose_sample, staircase_bag
from recordings import Sample

from octo_arm_model.cli.main import main
from octo_arm_model.config.parameter_files import parameters_as_yaml

STEPS = (0.0, 1.09, 3.06)
Write = Callable[..., Path]


@pytest.fixture(scope='module')
def write(tmp_path_factory: pytest.TempPathFactory) -> Write:
    """Path of a bag: three steps, the arm seen ``off`` where the paper's model has it [m]."""

    @functools.cache
    def make(off: float = 0.0, tips: bool = False) -> Path:
        def see(tension: float, stamp_ns: int) -> Sample:
            points = midline('renda2012', one_tendon(tension), 21) + [0.0, 0.0, off]
            return pose_sample(points[-1], stamp_ns) if tips else path_sample(points, stamp_ns)

        return staircase_bag(tmp_path_factory.mktemp('steps') / 'bag', STEPS, see)

    return make


def test_the_table_is_the_papers(write: Write, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(0.27 * 0.02)
    assert main(['compare', str(bag), '--clock-offset', '0']) == 0
    out, _ = capsys.readouterr()
    assert '3 steady steps, 3 of them with frames' in out
    assert 'no alignment' in out
    rows = [line.split() for line in out.split('noise of a frame\n')[1].splitlines()[:-1]]
    assert [float(row[1]) for row in rows] == list(STEPS)
    assert [[row[4], *row[6:9]] for row in rows] == 3 * [4 * ['2.00']]
    assert out.splitlines()[-1].split() == ['Average', *4 * ['2.00']]


def test_json_csv_and_pictures_say_the_same(
    write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = write(0.0027), tmp_path / 'out'
    models = ['--model', 'renda2012', 'exact']
    said = printed(capsys, 'compare', str(bag), *models, '--out', str(out), '--json')
    stored = json.loads((out / 'compare.json').read_text())
    assert stored['steps'] == said['steps']
    assert [step['model'] for step in stored['steps']] == 3 * ['renda2012'] + 3 * ['exact']
    for step, tension in zip(stored['steps'], STEPS):
        assert step['tension'] == pytest.approx(tension, abs=1e-3)
        assert step['tensions'] == pytest.approx([step['tension'], 0.0, 0.0, 0.0])
        for name in ('tip_error', 'mean_error', 'max_error', 'hausdorff'):
            assert step[f'{name}_percent'] == pytest.approx(1.0, rel=0.01)
        assert step['frames'] >= 10
    assert stored['models']['renda2012']['average_tip_error_percent'] == pytest.approx(1.0, 0.01)
    with (out / 'compare.csv').open(newline='') as file:
        table = list(csv.DictReader(file))
    assert [float(row['tip_error_percent']) for row in table] == [
        step['tip_error_percent'] for step in stored['steps']
    ]
    assert [float(row['tendon_1_1 [N]']) for row in table] == [
        step['tension'] for step in stored['steps']
    ]
    for name in ('step_01', 'step_02', 'step_03', 'error_over_tension'):
        assert (out / f'{name}.png').read_bytes().startswith(b'\x89PNG')


def test_tips_have_the_papers_error_and_no_other(
    write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    steps = printed(capsys, 'compare', str(write(0.0027, tips=True)), '--json')['steps']
    assert [step['tip_error_percent'] for step in steps] == pytest.approx([1.0] * 3, rel=0.01)
    assert {step['hausdorff_percent'] for step in steps} == {None}


@pytest.mark.parametrize(
    ('arguments', 'status', 'message'),
    [
        (['--align', '1', '2'], 2, '--align is 1 2, expected fit, none or X Y Z QX QY QZ QW'),
        (['--align', *'0001110'], 2, '--align: quaternion is (1.0, 1.0, 1.0, 0.0) of length'),
        (['--tolerance', '-1'], 2, '--tolerance is -1.0, expected a finite time >= 0 [s]'),
        (['--clock-offset', 'nan'], 2, '--clock-offset is nan, expected a finite time [s]'),
        (['--steady', '0'], 2, 'steady tolerance is 0.0'),
        (['--hold', '-1'], 2, '--hold: steady duration is -1.0, expected a finite number > 0 [s]'),
        (['--hold', '60'], 1, 'nothing to compare: no tension stays within'),
        (['--settle', '60'], 1, 'for 1 s, and beyond the first 60 s'),
        (['--clock-offset', '99'], 1, 'nothing to compare: none of'),
        (['--midlines', 'nowhere'], 2, 'no topic nowhere for midlines or tips; it has /arm_'),
        (['--config', 'renda2012_table4'], 2, 'no tensions for this arm on /tendon_tensions'),
    ],
)
def test_nonsense_is_refused_in_one_line(
    write: Write,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    status: int,
    message: str,
) -> None:
    assert main(['compare', str(write()), *arguments]) == status
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith('octo-arm: error: ')
    assert message in err
    assert err.count('\n') == 1


@pytest.mark.parametrize(
    'written', [('compare', '--out'), ('identify', '--out'), ('identify', '--csv')]
)
def test_nothing_is_written_into_the_bag(
    write: Write, capsys: pytest.CaptureFixture[str], written: tuple[str, str]
) -> None:
    command, option = written
    bag = write()
    before = sorted(bag.iterdir())
    assert main([command, str(bag), option, str(bag / 'new')]) == 2
    assert f'inside {bag}, which stays as it is' in capsys.readouterr().err
    assert sorted(bag.iterdir()) == before


def test_a_command_that_fails_leaves_no_empty_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, new = tmp_path / 'kept', tmp_path / 'new'
    kept.mkdir()
    for command in ('compare', 'identify', 'replay', 'estimate'):
        for folder in (kept / 'deep' / 'tables', new / 'tables'):
            given = [command, str(tmp_path / 'nowhere')]
            given += [str(tmp_path / 'out')] if command == 'replay' else []
            option = '--out' if command == 'compare' else '--csv'
            assert main([*given, option, str(folder)]) == 2
            assert 'no such bag' in capsys.readouterr().err
    assert kept.exists() and not list(kept.iterdir()) and not new.exists()


def test_of_all_models_those_that_cover_the_arm_are_compared(
    write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weight = {**PARAMETERS, 'loads.gravity': [0.0, 0.0, -9.81], 'material.density': 1000.0}
    config = tmp_path / 'heavy.yaml'
    config.write_text(parameters_as_yaml(weight))
    arguments = ['compare', str(write()), '--config', str(config), '--json']
    said = printed(capsys, *arguments, '--model', 'all')
    assert set(said['models']) == {'exact'}
    assert any('renda2012 is not compared: model is' in note for note in said['notes'])
    assert main([*arguments, '--model', 'renda2012']) == 2


def test_the_examples_of_its_help_work_on_the_demo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['record-demo', 'experiment']) == 0
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(['compare', '--help'])
    examples = capsys.readouterr().out.replace('\\\n', ' ').splitlines()
    tried = [line.split()[1:] for line in examples if '  octo-arm compare experiment' in line]
    assert len(tried) >= 3
    for arguments in tried:
        if 'all' not in arguments:  # which takes long, and differs in nothing else
            assert main(arguments) == 0, capsys.readouterr().err
