"""`octo-arm compare` and `identify`, and the CSV files of these and of replay."""

import csv
import functools
import json
from pathlib import Path

import numpy as np
import pytest
from experiments import (
    ARM,
    FAR,
    MARKER_S,
    PARAMETERS,
    TENSIONS,
    TIP_ERRORS,
    TRUE,
    arm_file,
    at_any,
    bag_of,
    description,
    marker_bag,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    pose_sample,
    seen,
    staircase,
    staircase_bag,
    tension_samples,
)
from numpy.testing import assert_allclose
from recordings import START, STEP, samples, text_sample, write_bag

from octo_arm_model import Config, load_config
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml
from octo_arm_model.simulation.profiles import read_profile

pytest.importorskip('matplotlib', reason='needs matplotlib')


STEPS = (0.0, 1.09, 3.06)


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
    ('options', 'status', 'message'),
    [
        ('--align 1 2', 2, '--align is 1 2, expected fit, none or X Y Z QX QY QZ QW'),
        ('--align 0 0 0 1 1 1 0', 2, '--align: quaternion is (1.0, 1.0, 1.0, 0.0) of length'),
        ('--tolerance -1', 2, '--tolerance is -1.0, expected a finite time >= 0 [s]'),
        ('--clock-offset nan', 2, '--clock-offset is nan, expected a finite time [s]'),
        ('--steady 0', 2, 'steady tolerance is 0.0'),
        ('--settle nan', 2, 'time is nan, expected'),
        ('--hold -1', 2, '--hold: steady duration is -1.0, expected a finite number > 0 [s]'),
        ('--hold 60', 1, 'nothing to compare: no tension stays within'),
        ('--clock-offset 99', 1, 'nothing to compare: none of'),
        ('--settle 60', 1, 'for 1 s, and beyond the first 60 s'),
        ('--midlines nowhere', 2, 'no topic nowhere for midlines or tips; it has /arm_'),
        ('--config renda2012_table4', 2, 'no tensions for this arm on /tendon_tensions'),
    ],
)
def test_nonsense_is_refused_in_one_line(write, cli, options, status, message):
    assert message in cli.refused(f'compare {write()} {options}', status=status)


def test_of_all_models_those_that_cover_the_arm_are_compared(write, tmp_path, cli):
    weight = {**PARAMETERS, 'loads.gravity': [0.0, 0.0, -9.81], 'material.density': 1000.0}
    given = f'compare {write()} --config {arm_file(tmp_path, weight)} --json --model'
    said = cli.json(f'{given} all')
    assert set(said['models']) == {'exact'}
    assert any('renda2012 is not compared: model is' in note for note in said['notes'])
    assert cli(f'{given} renda2012')[0] == 2


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
    assert cli(f'play {out}/tensions.csv --config renda2012_prototype --csv {again}')[0] == 0
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


# identify ----------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """An arm of modulus `TRUE` by the model closed_form, and a camera away from base_frame."""
    rng = np.random.default_rng(0)

    def see(tension, stamp_ns):
        points = midline('closed_form', one_tendon(tension), 31, material__youngs_modulus=TRUE)
        points = FAR.from_base(points) + 3e-4 * rng.standard_normal(points.shape)
        return path_sample(points, stamp_ns, frame='camera')

    return staircase_bag(tmp_path_factory.mktemp('bags') / 'bag', (0.0, 1.0, 2.0, 3.0), see)


def test_the_command_fits_every_model_and_writes_the_best(bag, tmp_path, cli):
    out = tmp_path / 'fitted.yaml'
    said = cli.json(f'identify {bag} --model closed_form exact --out {out} --json')
    assert (said['model'], said['steps'], said['trustworthy']) == ('closed_form', 4, True)
    young = said['estimates']['youngs_modulus']
    low, high = young['interval95']
    assert low < young['value'] < high and low <= TRUE <= high
    assert young['stddev'] > 0.0
    assert {f'alignment_{axis}' for axis in 'xyz'} < set(said['estimates'])
    assert said['correlations']['youngs_modulus']['youngs_modulus'] == pytest.approx(1.0)
    assert said['residuals']['after']['rms'] < 0.5 * said['residuals']['before']['rms']
    assert len(said['cross_validation']['left_out']) == 4
    assert {one['model'] for one in said['models']} == {'closed_form', 'exact'}
    assert "midlines are in 'camera'" in ' '.join(said['notes'])
    # The file describes the fitted arm, with the standard deviation of its modulus.
    config = load_config(out)
    assert config.model == 'closed_form'
    assert config.arm.material.youngs_modulus == young['value']
    assert config.uncertainty.youngs_modulus == pytest.approx(young['stddev'] / young['value'])
    # All other parameters are unchanged.
    young = 'material.youngs_modulus'
    changed = {'model', young, f'{young}_stddev', 'model_error_stddev'}
    assert config.uncertainty.model_position == said['model_error_stddev'] * config.arm.length
    fitted = load_parameters(out)
    assert {name: fitted[name] for name in fitted if name not in changed} == {
        name: value for name, value in PARAMETERS.items() if name not in changed
    }
    assert cli('solve', out, '--tensions', '[[2,0,0,0]]')[0] == 0


def test_the_summary_shows_intervals_and_what_is_left(bag, cli):
    status, out, err = cli('identify', bag, '--model', 'closed_form')
    assert status == 0 and err.count('2 fits of closed_form') == 1
    for text in ('95 % interval', 'loads left out of the fit', 'mirror image'):
        assert text in out


def test_undetermined_parameters_end_without_a_config(bag, tmp_path, cli):
    out = tmp_path / 'fitted.yaml'
    status, text, _ = cli('identify', bag, '--fit', 'poisson_ratio', '--out', out)
    assert status == 1 and 'NOTHING FITTED' in text and not out.exists()
    assert 'is not written: the data do not determine the arm' in text


def test_a_model_that_lacks_a_derivative_is_wrong_input(bag, cli):
    command = f'identify {bag} --fit youngs_modulus poisson_ratio --align fit'
    status, _, err = cli(f'{command} --model renda2012')
    assert status == 2 and 'renda2012 has no derivative by poisson_ratio' in err
    # Of all models one has the derivative; here it is zero.
    status, out, _ = cli(command)
    assert status == 0
    assert 'renda2012 is not fitted: the model renda2012 has no derivative' in out
    assert 'poisson_ratio changes nothing that was measured' in out
    assert 'NOT FITTED, as these data leave open' in out


HELD = (1.0, 2.5, 3.7, 2.5, 1.0)
FRICTION = 0.04
ALONG = np.linspace(0.0, 0.27, 16)


@pytest.fixture(scope='module')
def lab(tmp_path_factory):
    """Sheaths take 4 % of the tension while it rises and add as much while it falls."""
    rng = np.random.default_rng(0)
    time, pulled = staircase(HELD, hold=2.0)
    top = time[pulled >= max(HELD)][-1]
    samples = [description(), *tension_samples(time, pulled)]
    for at in np.arange(0.0, time[-1], 0.5):
        tension = np.interp(at, time, pulled) * (1.0 - FRICTION if at <= top else 1.0 + FRICTION)
        points = at_any(tension, ALONG)
        points = points + 2e-4 * rng.standard_normal(points.shape)
        samples.append(path_sample(points, nanoseconds(at)))
    return bag_of(tmp_path_factory.mktemp('bags') / 'lab', samples)


def test_branches_models_and_pictures(lab, tmp_path, cli):
    pytest.importorskip('matplotlib')
    out, pictures = tmp_path / 'fitted.yaml', tmp_path / 'pictures'
    said = cli.json(
        f'identify {lab} --model closed_form exact --clock-offset 0 --out {out} '
        f'--pictures {pictures} --json'
    )
    notes = ' '.join(said['notes'])
    assert 'loading and unloading differ by more than the noise' in notes
    assert '5 steps are of 3 loads' in notes
    assert 'less bent while loading, as friction or creep does' in notes
    young = said['estimates']['youngs_modulus']
    low, high = young['interval95']
    assert low < 1.1e5 < high
    assert young['interval95_near_models'][0] <= low
    assert young['model_stddev'] > 0.0
    assert 0.0 < said['model_error_floor']
    assert f'model_error_stddev: {said["model_error_stddev"]}'[:26] in out.read_text()
    assert {path.name for path in pictures.iterdir()} == {'intervals.png', 'residuals_along_s.png'}


def test_steps_of_one_load_are_told_apart_by_their_direction(lab, cli):
    said = cli.json(f'compare {lab} --clock-offset 0 --model exact --json')
    assert [step['direction'] for step in said['steps']] == 3 * ['loading'] + 2 * ['unloading']
    bend = [step['bend_error_percent'] for step in said['steps']]
    # The same tensions, first while they rise: the arm bends less.
    assert all(one < other - 0.5 for one, other in zip(bend[:2], bend[:2:-1], strict=True))
