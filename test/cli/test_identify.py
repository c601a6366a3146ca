"""`octo-arm identify`: what it prints and writes, also of shapes that no model here made."""

import experiments
import numpy as np
import pytest
from labs import at_any

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import load_parameters


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """An arm of modulus `TRUE` by the model closed_form, and a camera away from base_frame."""
    rng = np.random.default_rng(0)

    def see(tension, stamp_ns):
        points = experiments.midline(
            'closed_form',
            experiments.one_tendon(tension),
            31,
            material__youngs_modulus=experiments.TRUE,
        )
        points = experiments.FAR.to_camera(points) + 3e-4 * rng.standard_normal(points.shape)
        return experiments.path_sample(points, stamp_ns, frame='camera')

    return experiments.staircase_bag(
        tmp_path_factory.mktemp('bags') / 'bag', (0.0, 1.0, 2.0, 3.0), see
    )


def test_the_command_fits_every_model_and_writes_the_best(bag, tmp_path, cli):
    out = tmp_path / 'fitted.yaml'
    arguments = ['--model', 'closed_form', 'exact', '--out', str(out), '--json']
    said = cli.json('identify', str(bag), *arguments)
    assert (said['model'], said['steps'], said['trustworthy']) == ('closed_form', 4, True)
    young = said['estimates']['youngs_modulus']
    low, high = young['interval95']
    assert low < young['value'] < high
    assert low <= experiments.TRUE <= high
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
        name: value for name, value in experiments.PARAMETERS.items() if name not in changed
    }
    assert cli('solve', out, '--tensions', '[[2,0,0,0]]')[0] == 0


def test_the_summary_shows_intervals_and_what_is_left(bag, cli):
    status, out, err = cli('identify', bag, '--model', 'closed_form')
    assert status == 0 and err.count('10 fits of closed_form') == 1
    for text in ('95 % interval', 'loads left out of the fit', 'mirror image'):
        assert text in out


def test_undetermined_parameters_end_without_a_config(bag, tmp_path, cli):
    out = tmp_path / 'fitted.yaml'
    status, text, _ = cli('identify', bag, '--fit', 'poisson_ratio', '--out', out)
    assert status == 1 and 'NOTHING FITTED' in text and not out.exists()
    assert 'is not written: the data do not determine the arm' in text


def test_a_model_that_lacks_a_derivative_is_wrong_input(bag, cli):
    fits = '--fit', 'youngs_modulus', 'poisson_ratio', '--align', 'fit'
    status, _, err = cli('identify', bag, '--model', 'renda2012', *fits)
    assert status == 2 and 'renda2012 has no derivative by poisson_ratio' in err
    # Of all models one has the derivative; here it is zero.
    status, out, _ = cli('identify', bag, *fits)
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
    time, pulled = experiments.staircase(HELD, hold=2.0)
    top = time[pulled >= max(HELD)][-1]
    samples = [experiments.description(), *experiments.tension_samples(time, pulled)]
    for at in np.arange(0.0, time[-1], 0.5):
        tension = np.interp(at, time, pulled) * (1.0 - FRICTION if at <= top else 1.0 + FRICTION)
        points = at_any(tension, ALONG)
        points = points + 2e-4 * rng.standard_normal(points.shape)
        samples.append(experiments.path_sample(points, experiments.nanoseconds(at)))
    return experiments.bag_of(tmp_path_factory.mktemp('bags') / 'lab', samples)


def test_branches_models_and_pictures(lab, tmp_path, cli):
    pytest.importorskip('matplotlib')
    arguments = ['--model', 'closed_form', 'exact', '--clock-offset', '0']
    out, pictures = tmp_path / 'fitted.yaml', tmp_path / 'pictures'
    given = ['--out', str(out), '--pictures', str(pictures), '--json']
    said = cli.json('identify', str(lab), *arguments, *given)
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
    arguments = ['--clock-offset', '0', '--model', 'exact', '--json']
    said = cli.json('compare', str(lab), *arguments)
    assert [step['direction'] for step in said['steps']] == 3 * ['loading'] + 2 * ['unloading']
    bend = [step['bend_error_percent'] for step in said['steps']]
    # The same tensions, first while they rise: the arm bends less.
    assert all(one < other - 0.5 for one, other in zip(bend[:2], bend[:2:-1], strict=True))
