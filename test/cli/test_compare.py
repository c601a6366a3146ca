"""`octo-arm compare`, and the CSV files of compare, identify and replay."""

import csv
import functools
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from experiments import (
    ARM,
    PARAMETERS,
    midline,
    one_tendon,
    path_sample,
    pose_sample,
    staircase_bag,
)
from labs import MARKER_S, TENSIONS, TIP_ERRORS, marker_bag, seen
from numpy.testing import assert_allclose
from recordings import START, STEP, samples, text_sample, write_bag

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.simulation.profiles import read_profile

pytest.importorskip('matplotlib', reason='needs matplotlib')
STEPS = (0.0, 1.09, 3.06)
Write = Callable[..., Path]


@pytest.fixture(scope='module')
def write(tmp_path_factory):
    """Path of a bag: three steps, the arm seen ``off`` where the paper's model has it [m]."""

    @functools.cache
    def make(off=0.0, tips=False):
        def see(tension, stamp_ns):
            points = midline('renda2012', one_tendon(tension), 21) + [0.0, 0.0, off]
            return pose_sample(points[-1], stamp_ns) if tips else path_sample(points, stamp_ns)

        return staircase_bag(tmp_path_factory.mktemp('steps') / 'bag', STEPS, see)

    return make


def test_the_table_is_the_papers(write, cli):
    status, out, _ = cli('compare', write(0.27 * 0.02), '--clock-offset', '0')
    assert status == 0 and 'no alignment' in out
    assert '3 steady steps, 3 of them with frames' in out
    rows = [line.split() for line in out.split('noise of a frame\n')[1].splitlines()[:-1]]
    assert [float(row[1]) for row in rows] == list(STEPS)
    assert [[row[4], *row[6:9]] for row in rows] == 3 * [4 * ['2.00']]
    assert out.splitlines()[-1].split() == ['Average', *4 * ['2.00']]


def test_json_csv_and_pictures_say_the_same(write, tmp_path, cli):
    out, models = tmp_path / 'out', ('renda2012', 'exact')
    said = cli.json('compare', write(0.0027), '--model', *models, '--out', out, '--json')
    steps = said['steps']
    assert json.loads((out / 'compare.json').read_text())['steps'] == steps
    assert [step['model'] for step in steps] == 3 * ['renda2012'] + 3 * ['exact']
    for step, tension in zip(steps, STEPS):
        assert step['tension'] == pytest.approx(tension, abs=1e-3)
        assert step['tensions'] == pytest.approx([step['tension'], 0.0, 0.0, 0.0])
        for name in ('tip_error', 'mean_error', 'max_error', 'hausdorff'):
            assert step[f'{name}_percent'] == pytest.approx(1.0, rel=0.01)
        assert step['frames'] >= 10
    assert said['models']['renda2012']['average_tip_error_percent'] == pytest.approx(1.0, 0.01)
    with (out / 'compare.csv').open(newline='') as file:
        table = list(csv.DictReader(file))
    for column, name in (('tip_error_percent',) * 2, ('tendon_1_1 [N]', 'tension')):
        assert [float(row[column]) for row in table] == [step[name] for step in steps]
    for name in ('step_01', 'step_02', 'step_03', 'error_over_tension'):
        assert (out / f'{name}.png').read_bytes().startswith(b'\x89PNG')


def test_tips_have_the_papers_error_and_no_other(write, cli):
    steps = cli.json('compare', str(write(0.0027, tips=True)), '--json')['steps']
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
        (['--clock-offset', '1e6'], 1, 'nothing to compare: none of'),
        (['--settle', '60'], 1, 'for 1 s, and beyond the first 60 s'),
        (['--clock-offset', '99'], 1, 'nothing to compare: none of'),
        (['--midlines', 'nowhere'], 2, 'no topic nowhere for midlines or tips; it has /arm_'),
        (['--config', 'renda2012_table4'], 2, 'no tensions for this arm on /tendon_tensions'),
    ],
)
def test_nonsense_is_refused_in_one_line(write, cli, arguments, status, message):
    assert message in cli.refused('compare', write(), *arguments, status=status)


def test_of_all_models_those_that_cover_the_arm_are_compared(write, tmp_path, cli):
    weight = {**PARAMETERS, 'loads.gravity': [0.0, 0.0, -9.81], 'material.density': 1000.0}
    config = tmp_path / 'heavy.yaml'
    config.write_text(parameters_as_yaml(weight))
    given = 'compare', write(), '--config', config, '--json', '--model'
    said = cli.json(*given, 'all')
    assert set(said['models']) == {'exact'}
    assert any('renda2012 is not compared: model is' in note for note in said['notes'])
    assert cli(*given, 'renda2012')[0] == 2


S = ['--marker-s', *map(str, MARKER_S), '--clock-offset', '0', '--json']


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def numbers(table: list[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in table])


def test_compared_points_residuals_and_shapes_are_a_row_each(cli, tmp_path):
    bag, out = marker_bag(tmp_path / 'bag'), tmp_path / 'out'
    assert cli('compare', bag, *S, '--out', out)[0] == 0
    table = rows(out / 'midlines.csv')
    assert len(table) == len(TENSIONS) * len(MARKER_S)
    axes = [[f'{what}_{axis} [m]' for axis in 'xyz'] for what in ('measured', 'model', 'residual')]
    measured, model, residual = (numbers(table, *names) for names in axes)
    assert_allclose(measured - model, residual, atol=1e-12)
    expected = np.concatenate([seen(tension, MARKER_S) for tension in TENSIONS])
    assert_allclose(measured, expected, atol=1e-9)
    tips = np.linalg.norm(residual[3::4], axis=1)
    assert_allclose(100.0 * tips / 0.27, TIP_ERRORS, atol=0.03)
    assert numbers(table, 's [m]').ravel().tolist() == list(MARKER_S) * len(TENSIONS)
    stations = rows(out / 'stations.csv')
    assert {row['step'] for row in stations} == {str(n + 1) for n in range(len(TENSIONS))}
    assert float(stations[-1]['s [m]']) == 0.27
    profile = read_profile(out / 'tensions.csv', ARM)
    assert profile.tensions[::2, 0] == pytest.approx(TENSIONS, abs=2e-3)
    again = tmp_path / 'again.csv'
    given = '--config', 'renda2012_prototype', '--csv', again
    assert cli('play', out / 'tensions.csv', *given)[0] == 0
    assert read_profile(again, ARM).duration == pytest.approx(profile.duration)


def test_tables_of_a_fit_have_less_left_and_the_tensions_of_the_fitted_load_cells(cli, tmp_path):
    bag, given, fitted = marker_bag(tmp_path / 'bag'), tmp_path / 'given', tmp_path / 'fitted'
    exact = *S, '--model', 'exact'
    fits = '--fit', 'youngs_modulus', 'tension_offset', '--loss', 'linear'
    assert cli('compare', bag, *exact, '--out', given)[0] == 0
    said = cli.json('identify', bag, *exact, *fits, '--csv', fitted)
    offset = said['estimates']['tension_offset']['value']
    assert abs(offset) > 0.01
    tensions = read_profile(fitted / 'tensions.csv', ARM).tensions
    assert tensions[::2, 0] == pytest.approx(np.array(TENSIONS) + offset, abs=2e-3)
    axes = [f'residual_{axis} [m]' for axis in 'xyz']
    before, after = (
        (numbers(rows(folder / 'midlines.csv'), *axes) ** 2).sum(axis=1).mean()
        for folder in (given, fitted)
    )
    assert after < 0.7 * before
    # What is left is what the fit says is left.
    assert np.sqrt(after) == pytest.approx(said['residuals']['after']['rms'], rel=1e-6)


def test_a_replay_has_a_row_for_each_station_and_its_tensions_are_played(cli, tmp_path):
    pulls = [[pull, 0.0, 0.1, 0.0] for pull in (0.0, 1.0, 2.0)]
    content = [text_sample('/arm_description', parameters_as_yaml(PARAMETERS))]
    content += samples(ARM, [pulls[0], [-1.0, 0.0, 0.0, 0.0], *pulls[1:]])
    bag, out = write_bag(tmp_path / 'bag', content), tmp_path / 'tables'
    said = cli.json('replay', bag, tmp_path / 'new', '--csv', out, '--json')
    (report,) = said['topics'].values()
    assert 'load cells: tension_deadband takes readings near zero as zero' in said['notes']
    reason = 'tension of tendon_1_1 is -1.0 N, expected a finite number >= 0'
    assert report['reasons'] == {reason: 1}
    table, stations = rows(out / 'stations.csv'), PARAMETERS['stations']
    expected = Config.from_parameters(PARAMETERS).solver().solve(np.reshape(pulls, (3, 1, 4)))
    got = numbers(table, 'x [m]', 'y [m]', 'z [m]').reshape(3, stations, 3)
    assert_allclose(got, expected.position, atol=1e-12)
    k = numbers(table, 'k [1/m]').reshape(3, stations)
    assert_allclose(k, expected.k, atol=1e-9)
    assert {int(row['stamp [ns]']) for row in table} == {START + n * STEP for n in (0, 2, 3)}
    profile = read_profile(out / 'tensions.csv', ARM)
    assert_allclose(profile.tensions, pulls)
    assert_allclose(profile.times, [0.0, 0.002, 0.003])
