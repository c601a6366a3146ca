"""`octo-arm identify`: what it prints and writes, and its exit statuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import printed
from experiments import FAR, PARAMETERS, TRUE, midline, one_tendon, path_sample, staircase_bag
from recordings import Sample

from octo_arm_model import load_config
from octo_arm_model.cli.main import main
from octo_arm_model.config.parameter_files import load_parameters


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm of modulus `TRUE` by the model closed_form, and a camera away from base_frame."""
    rng = np.random.default_rng(0)

    def see(tension: float, stamp_ns: int) -> Sample:
        points = midline('closed_form', one_tendon(tension), 31, material__youngs_modulus=TRUE)
        points = FAR.to_camera(points) + 3e-4 * rng.standard_normal(points.shape)
        return path_sample(points, stamp_ns, frame='camera')

    return staircase_bag(tmp_path_factory.mktemp('bags') / 'bag', (0.0, 1.0, 2.0, 3.0), see)


def test_the_command_fits_every_model_and_writes_the_best(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'fitted.yaml'
    arguments = ['--model', 'closed_form', 'exact', '--out', str(out), '--json']
    said = printed(capsys, 'identify', str(bag), *arguments)
    assert (said['model'], said['steps'], said['trustworthy']) == ('closed_form', 4, True)
    young = said['estimates']['youngs_modulus']
    low, high = young['interval95']
    assert low < young['value'] < high
    assert low <= TRUE <= high
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
    changed = {
        'model', 'material.youngs_modulus', 'material.youngs_modulus_stddev', 'model_error_stddev',
    }  # fmt: skip
    assert config.uncertainty.model_position == said['model_error_stddev'] * config.arm.length
    fitted = load_parameters(out)
    assert {name: fitted[name] for name in fitted if name not in changed} == {
        name: value for name, value in PARAMETERS.items() if name not in changed
    }
    assert main(['solve', str(out), '--tensions', '[[2,0,0,0]]']) == 0


def test_the_summary_shows_intervals_and_what_is_left(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['identify', str(bag), '--model', 'closed_form']) == 0
    out, err = capsys.readouterr()
    for text in ('95 % interval', 'loads left out of the fit', 'mirror image'):
        assert text in out
    assert err.count('10 fits of closed_form') == 1


def test_undetermined_parameters_end_without_a_config(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'fitted.yaml'
    fits = ['--fit', 'poisson_ratio', '--out', str(out)]
    assert main(['identify', str(bag), *fits]) == 1
    text = capsys.readouterr().out
    assert 'NOTHING FITTED' in text
    assert 'is not written: the data do not determine the arm' in text
    assert not out.exists()


def test_a_model_that_lacks_a_derivative_is_wrong_input(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fits = ['--fit', 'youngs_modulus', 'poisson_ratio', '--align', 'fit']
    assert main(['identify', str(bag), '--model', 'renda2012', *fits]) == 2
    assert 'renda2012 has no derivative by poisson_ratio' in capsys.readouterr().err
    # Of all models one has the derivative; here it is zero.
    assert main(['identify', str(bag), *fits]) == 0
    out = capsys.readouterr().out
    assert 'renda2012 is not fitted: the model renda2012 has no derivative' in out
    assert 'poisson_ratio changes nothing that was measured' in out
    assert 'NOT FITTED, as these data leave open' in out
