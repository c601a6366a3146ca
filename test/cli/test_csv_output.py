"""CSV files of compare, identify and replay, and what `octo-arm play` makes of them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from command_line import printed

pytest.importorskip('rosbags', reason='needs rosbags')
pytest.importorskip('matplotlib', reason='needs matplotlib')

from experiments import ARM, PARAMETERS
from labs import MARKER_S, TENSIONS, TIP_ERRORS, marker_bag, seen
from recordings import START, STEP, samples, text_sample, write_bag

from octo_arm_model.cli.main import main
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.simulation.profiles.profile_files import read_profile

S = ['--marker-s', *map(str, MARKER_S), '--clock-offset', '0', '--json']


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def numbers(table: list[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in table])


def test_compared_points_residuals_and_shapes_are_a_row_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = str(marker_bag(tmp_path / 'bag')), tmp_path / 'out'
    assert main(['compare', bag, *S, '--out', str(out)]) == 0
    table = rows(out / 'midlines.csv')
    assert len(table) == len(TENSIONS) * len(MARKER_S)
    axes = [[f'{what}_{axis} [m]' for axis in 'xyz'] for what in ('measured', 'model', 'residual')]
    measured, model, residual = (numbers(table, *names) for names in axes)
    np.testing.assert_allclose(measured - model, residual, atol=1e-12)
    np.testing.assert_allclose(
        measured, np.concatenate([seen(tension, MARKER_S) for tension in TENSIONS]), atol=1e-9
    )
    tips = np.linalg.norm(residual[3::4], axis=1)
    np.testing.assert_allclose(100.0 * tips / 0.27, TIP_ERRORS, atol=0.03)
    assert numbers(table, 's [m]').ravel().tolist() == list(MARKER_S) * len(TENSIONS)
    stations = rows(out / 'stations.csv')
    assert {row['step'] for row in stations} == {str(n + 1) for n in range(len(TENSIONS))}
    assert float(stations[-1]['s [m]']) == 0.27
    profile = read_profile(out / 'tensions.csv', ARM)
    assert profile.tensions[::2, 0] == pytest.approx(TENSIONS, abs=2e-3)
    assert main(['play', str(out / 'tensions.csv'), '--config', 'renda2012_prototype', '--csv',
                 str(tmp_path / 'again.csv')]) == 0  # fmt: skip
    assert read_profile(tmp_path / 'again.csv', ARM).duration == pytest.approx(profile.duration)


def test_the_fitted_arm_has_less_left_than_the_one_that_was_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(marker_bag(tmp_path / 'bag'))
    model = '--model', 'exact'
    assert main(['compare', bag, *S, *model, '--out', str(tmp_path / 'compared')]) == 0
    assert main(['identify', bag, *S, *model, '--csv', str(tmp_path / 'fitted')]) == 0
    capsys.readouterr()
    axes = [f'residual_{axis} [m]' for axis in 'xyz']
    before, after = (
        (numbers(rows(tmp_path / name / 'midlines.csv'), *axes) ** 2).sum()
        for name in ('compared', 'fitted')
    )
    assert after < 0.7 * before


def test_tables_of_a_fit_have_the_tensions_of_the_fitted_load_cells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = str(marker_bag(tmp_path / 'bag')), tmp_path / 'fitted'
    fits = ['--model', 'exact', '--fit', 'youngs_modulus', 'tension_offset', '--loss', 'linear']
    said = printed(capsys, 'identify', bag, *S, *fits, '--csv', str(out))
    offset = said['estimates']['tension_offset']['value']
    assert abs(offset) > 0.01
    tensions = read_profile(out / 'tensions.csv', ARM).tensions
    assert tensions[::2, 0] == pytest.approx(np.array(TENSIONS) + offset, abs=2e-3)
    # What is left is what the fit says is left.
    axes = [f'residual_{axis} [m]' for axis in 'xyz']
    squares = (numbers(rows(out / 'midlines.csv'), *axes) ** 2).sum(axis=1)
    assert np.sqrt(squares.mean()) == pytest.approx(said['residuals']['after']['rms'], rel=1e-6)


def test_a_replay_has_a_row_for_each_station_and_its_tensions_are_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pulls = [[pull, 0.0, 0.1, 0.0] for pull in (0.0, 1.0, 2.0)]
    content = [text_sample('/arm_description', parameters_as_yaml(PARAMETERS))]
    content += samples(ARM, [pulls[0], [-1.0, 0.0, 0.0, 0.0], *pulls[1:]])
    bag = str(write_bag(tmp_path / 'bag', content))
    out = tmp_path / 'tables'
    said = printed(capsys, 'replay', bag, str(tmp_path / 'new'), '--csv', str(out), '--json')
    (report,) = said['topics'].values()
    assert 'load cells: tension_deadband takes readings near zero as zero' in said['notes']
    (reason,) = report['reasons'].items()
    assert reason == ('tension of tendon_1_1 is -1.0 N, expected a finite number >= 0', 1)
    solver = Config.from_parameters(PARAMETERS).solver()
    table = rows(out / 'stations.csv')
    stations = PARAMETERS['stations']
    assert len(table) == 3 * stations
    expected = solver.solve(np.array(pulls).reshape(3, 1, 4))
    got = numbers(table, 'x [m]', 'y [m]', 'z [m]').reshape(3, stations, 3)
    np.testing.assert_allclose(got, expected.position, atol=1e-12)
    np.testing.assert_allclose(
        numbers(table, 'k [1/m]').reshape(3, stations), expected.k, atol=1e-9
    )
    stamps = {int(row['stamp [ns]']) for row in table}
    assert stamps == {START + n * STEP for n in (0, 2, 3)}
    profile = read_profile(out / 'tensions.csv', ARM)
    np.testing.assert_allclose(profile.tensions, pulls)
    np.testing.assert_allclose(profile.times, [0.0, 0.002, 0.003])


def test_a_file_in_the_place_of_a_folder_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'file').write_text('')
    for command in (['identify', 'bag'], ['replay', 'bag', str(tmp_path / 'out')]):
        assert main([*command, '--csv', str(tmp_path / 'file')]) == 2
        assert '--csv is ' in capsys.readouterr().err
