"""The arm from measurements: known truths come back, and how far to trust them is right."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from differences import jacobian
from experiments import (
    FAR,
    HELD,
    PARAMETERS,
    bag_of,
    description,
    midline,
    nanoseconds,
    one_tendon,
    path_sample,
    shapes,
    staircase,
    tension_samples,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from octo_arm_model import load_config
from octo_arm_model.cli.main import main
from octo_arm_model.config.config import Config, load_parameters
from octo_arm_model.core.errors import ConfigError, SolveError
from octo_arm_model.experiment.fitting import robust_loss as robust
from octo_arm_model.experiment.fitting.fit import Problem
from octo_arm_model.experiment.fitting.identify import Identification, identify
from octo_arm_model.experiment.fitting.tendon_offsets import move_tendons
from octo_arm_model.experiment.fitting.uncertainty import freedom_of
from octo_arm_model.experiment.fitting.unknowns import FITS, Unknowns
from octo_arm_model.experiment.recording.mean_midlines import Shape

TRUE = 1.23e5  # Young's modulus of the arms measured here [Pa]; the config says 1.1e5
STEPS = HELD[1:]
PULLS = tuple(one_tendon(tension) for tension in STEPS)


def measured(
    model: str = 'closed_form',
    seed: int = 0,
    noise: float = 0.0,
    wrong: float = 0.0,
    pulls: tuple[np.ndarray, ...] = PULLS,
    count: int = 61,
    parameters: dict | None = None,
    **changes: float,
) -> list[Shape]:
    """Steps of an arm of modulus `TRUE`; ``wrong`` is the stddev of each step's tension [N]."""
    rng = np.random.default_rng(seed)
    changes = {'material__youngs_modulus': TRUE, **(parameters or {}), **changes}
    pulled = [np.maximum(pull + wrong * rng.standard_normal() * (pull > 0.0), 0.0)
              for pull in pulls]  # fmt: skip
    lines = [midline(model, pull, count, **changes) for pull in pulled]
    return shapes(lines, pulls, rng, noise, frames=8)


def tips(steps: list[Shape]) -> list[Shape]:
    return [dataclasses.replace(step, points=step.points[-1:]) for step in steps]


def values(fitted: Identification) -> dict[str, float]:
    return {name: one.value for name, one in fitted.estimates.items()}


# Truths come back -------------------------------------------------------------------------------


@pytest.mark.parametrize('only_tips', [False, True])
def test_youngs_modulus_is_found_by_every_model_in_its_own_data(
    model: str, only_tips: bool
) -> None:
    steps = measured(model)
    fitted = identify(tips(steps) if only_tips else steps, PARAMETERS, model)
    assert values(fitted) == {'youngs_modulus': pytest.approx(TRUE, rel=3e-4)}
    assert fitted.after.rms < 5e-5 < fitted.before.rms
    assert fitted.parameters['material.youngs_modulus'] == values(fitted)['youngs_modulus']


def test_scale_offset_and_camera_are_found_together() -> None:
    read = [np.maximum((pull - 0.1 * (pull > 0)) / 1.2, 0.0) for pull in PULLS]
    lines = [FAR.to_camera(midline('closed_form', pull)) for pull in PULLS]
    fits = ('tension_scale', 'tension_offset', 'alignment')
    fitted = identify(shapes(lines, read), PARAMETERS, 'closed_form', fits)
    assert values(fitted)['tension_scale'] == pytest.approx(1.2, rel=1e-3)
    assert values(fitted)['tension_offset'] == pytest.approx(0.1, abs=1e-3)
    np.testing.assert_allclose(fitted.alignment.shift, FAR.shift, atol=3e-4)
    np.testing.assert_allclose(fitted.alignment.rotation, FAR.rotation, atol=1e-3)


def test_displaced_tendons_and_poissons_ratio_are_found() -> None:
    # Tendons that wind about the arm twist it, and only then nu matters.
    winding = {
        'tendons.twist': [2.0, 2.0, 2.0, 2.0],
        'sections.offset_anchorage': [0.005],
    }
    parameters = {**PARAMETERS, **winding}
    moved = {'tendon_1_1': 4e-4, 'tendon_1_2': -3e-4, 'tendon_1_3': 0.0, 'tendon_1_4': 0.0}
    true = move_tendons(
        {**parameters, 'material.poisson_ratio': 0.3},
        Config.from_parameters(parameters).arm,
        moved,
    )
    assert 'sections.offset_base' not in true
    config = Config.from_parameters({**true, 'model': 'exact'})
    pulls = [np.array(pull) for pull in ((2, 0, 0, 0), (4, 0, 0, 0), (0, 2, 0, 0), (0, 4, 0, 0),
                                         (3, 2, 0, 0), (1, 4, 0, 0))]  # fmt: skip
    lines = [config.solver().solve([pull]).position for pull in pulls]
    fitted = identify(
        shapes(lines, pulls), parameters, 'exact', ('poisson_ratio', 'tendon_offsets')
    )
    assert values(fitted) == {
        'poisson_ratio': pytest.approx(0.3, abs=0.02),
        'tendon_offset.tendon_1_1': pytest.approx(4e-4, abs=2e-5),
        'tendon_offset.tendon_1_2': pytest.approx(-3e-4, abs=2e-5),
    }
    # The others are not pulled: nothing could be said of them.
    again = Config.from_parameters(fitted.parameters).solver().solve([pulls[4]]).tip
    np.testing.assert_allclose(again, lines[4][-1], atol=2e-4)


def test_a_modulus_that_varies_along_the_arm_is_scaled_as_a_whole() -> None:
    table = {
        'material.table_s': [0.0, 0.27],
        'material.table_youngs_modulus': [1e5, 1.4e5],
    }
    steps = measured(parameters={
        'material__table_s': [0.0, 0.27],
        'material__table_youngs_modulus': [1.1e5, 1.54e5],
    })  # fmt: skip
    fitted = identify(steps, {**PARAMETERS, **table}, 'closed_form')
    assert fitted.parameters['material.table_youngs_modulus'] == pytest.approx(
        [1.1e5, 1.54e5], rel=1e-3
    )


# Derivatives ------------------------------------------------------------------------------------


@settings(max_examples=4)
@given(st.integers(0, 2), st.integers(0, 1000))
def test_the_jacobian_is_that_of_differences(step: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pulls = tuple(np.array(pull) for pull in ((1.0, 0.5, 0, 0), (0.3, 2.0, 0, 0), (0, 3.0, 0, 0)))
    lines = [FAR.to_camera(midline('exact', pull, 25)) for pull in pulls]
    steps = shapes(lines, pulls, rng, 1e-3)
    tensions = np.array(pulls)
    unknowns = Unknowns(PARAMETERS, 'exact', FITS, tensions, FAR)
    problem = Problem(steps, unknowns)
    sizes = np.array([unknown.scale for unknown in unknowns.unknowns])
    x = unknowns.start + 0.05 * sizes * rng.standard_normal(sizes.size)
    x[unknowns.names.index('poisson_ratio')] = 0.3
    got = problem.change(x, step)
    expected = jacobian(lambda x: problem.residuals(x, step), x, 1e-5 * sizes)
    # A point that crosses from one straight piece of the model to the next has two derivatives.
    close = np.isclose(got * sizes, expected * sizes, rtol=1e-4, atol=1e-6 * np.abs(got).max())
    assert close.mean() > 0.97


@given(st.floats(0.0, 1e3))
def test_small_residuals_count_as_squares_and_large_ones_as_distances(ratio: float) -> None:
    away = ratio * np.array([2.0, -1.0, 2.0]) / 3.0
    rho, first, second = robust.loss(away**2)
    assert rho.sum() == pytest.approx(2.0 * (np.sqrt(1.0 + ratio**2) - 1.0))
    near = robust.loss((away * (1.0 + 1e-5)) ** 2)
    squares = 2e-5 * ratio**2
    assert (near[0] - rho).sum() == pytest.approx(first[0] * squares, rel=1e-3, abs=1e-15)
    assert near[1][0] - first[0] == pytest.approx(second[0] * squares, rel=1e-3, abs=1e-15)


# Trust ------------------------------------------------------------------------------------------


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Noise of the camera alone, and tensions that are wrong for all frames of a step."""
    parameters = {**PARAMETERS, 'material.youngs_modulus': 1.01 * TRUE, 'stations': 61}
    pulls = tuple(one_tendon(tension) for tension in (1.5, 2.2, 2.8, 3.3, 3.8))
    trials, inside = 32, 0
    for seed in range(trials):
        wrong = 0.03 * (seed % 2)
        steps = tips(measured(seed=seed, noise=5e-4, wrong=wrong, pulls=pulls, count=21))
        estimate = identify(steps, parameters, 'closed_form').estimates['youngs_modulus']
        low, high = estimate.interval95
        inside += low <= TRUE <= high
    assert binom.cdf(inside, trials, 0.95) > 1e-3


def test_more_frames_of_the_same_steps_do_not_make_a_wrong_tension_right() -> None:
    deviations = []
    for frames in (4, 64):
        rng = np.random.default_rng(4)
        pulled = [pull * (1.0 + 0.03 * rng.standard_normal()) for pull in PULLS]
        lines = [midline('closed_form', pull, 21) for pull in pulled]
        steps = shapes(lines, PULLS, rng, 5e-4, frames)
        fitted = identify(steps, PARAMETERS, 'closed_form')
        deviations.append(fitted.estimates['youngs_modulus'].stddev)
    assert deviations[1] > 0.7 * deviations[0]


def test_steps_that_say_little_do_not_count_as_steps() -> None:
    alike = [np.ones((4, 3, 1)) for _ in range(6)]
    folds = [[number] for number in range(6)]
    assert freedom_of(alike, folds) == pytest.approx([5.0])
    unlike = [1e-3 * part for part in alike[:3]] + alike[3:]
    assert freedom_of(unlike, folds) == pytest.approx([2.0], rel=1e-4)


def test_outliers_hardly_move_the_estimate() -> None:
    steps = measured(noise=5e-4)
    clean = identify(steps, PARAMETERS, 'closed_form')
    spoiled = list(steps)
    lost = steps[2].points.copy()
    lost[60:] += [0.03, -0.04, 0.02]
    spoiled[2] = dataclasses.replace(steps[2], points=lost)
    fitted = identify(spoiled, PARAMETERS, 'closed_form')
    assert values(fitted)['youngs_modulus'] == pytest.approx(TRUE, rel=0.01)
    assert values(clean)['youngs_modulus'] == pytest.approx(TRUE, rel=2e-3)


def test_what_the_data_cannot_tell_apart_is_said_and_not_fitted() -> None:
    # Without loads only the ratio of tensions and modulus matters.
    fitted = identify(measured(), PARAMETERS, 'closed_form', ('youngs_modulus', 'tension_scale'))
    assert not fitted.is_trustworthy
    assert (
        fitted.undetermined
        == (
            'changed together in this proportion nothing measured changes: youngs_modulus +100 %, '
            'tension_scale +100 %',
        )
        or 'youngs_modulus -100 %, tension_scale -100 %' in fitted.undetermined[0]
    )
    assert {one.value for one in fitted.estimates.values()} == {None}
    flat = identify(measured('exact'), PARAMETERS, 'exact', ('poisson_ratio',))
    assert flat.undetermined == ('poisson_ratio changes nothing that was measured',)


def test_strong_correlations_are_pointed_out() -> None:
    fits = ('youngs_modulus', 'tendon_offsets')
    fitted = identify(measured('exact', noise=2e-4), PARAMETERS, 'exact', fits)
    one, other = fitted.correlations[0, 1], fitted.correlations[1, 0]
    assert one == other
    assert one > 0.95
    assert any(
        'hardly tell youngs_modulus and tendon_offset.tendon_1_1 apart' in note
        for note in fitted.notes
    )
    # Little is known of each, and the intervals say so.
    for name, true in (('youngs_modulus', TRUE), ('tendon_offset.tendon_1_1', 0.0)):
        low, high = fitted.estimates[name].interval95
        assert low <= true <= high


def test_without_another_step_there_is_no_interval() -> None:
    (estimate,) = (fitted := identify(measured()[3:4], PARAMETERS, 'exact')).estimates.values()
    assert (estimate.stddev, estimate.interval95) == (None, None)
    assert fitted.cross_validation is None
    assert 'one step says nothing' in ' '.join(fitted.notes)
    at_rest = measured(pulls=(one_tendon(0.0), one_tendon(2.0)))
    fitted = identify(at_rest, PARAMETERS, 'closed_form')
    assert fitted.estimates['youngs_modulus'].interval95 is None
    assert 'without step 2 it would be open' in ' '.join(fitted.notes)


def test_the_model_that_made_the_data_explains_them_best() -> None:
    steps = measured('exact', noise=3e-4)
    fitted = {model: identify(steps, PARAMETERS, model) for model in ('renda2012', 'exact')}
    assert fitted['exact'].cross_validation.rms < 0.3 * fitted['renda2012'].cross_validation.rms
    assert not any('biases the estimates' in note for note in fitted['exact'].notes)
    # The other makes up for what it lacks by another modulus, and it is said that it may.
    assert abs(values(fitted['renda2012'])['youngs_modulus'] / TRUE - 1.0) > 0.03
    assert any('biases the estimates' in note for note in fitted['renda2012'].notes)


def test_cross_validation_tells_a_step_that_does_not_belong() -> None:
    steps = measured(noise=3e-4)
    wrong = dataclasses.replace(steps[4].window, tensions=1.3 * steps[4].window.tensions)
    steps[4] = dataclasses.replace(steps[4], window=wrong)
    fitted = identify(steps, PARAMETERS, 'closed_form')
    misfits = {numbers: misfit.rms for numbers, misfit in fitted.step_misfits}
    assert max(misfits, key=misfits.get) == (5,)
    assert fitted.cross_validation.rms == pytest.approx(
        np.sqrt(np.mean(np.square(list(misfits.values()))))
    )


@pytest.mark.parametrize(
    ('model', 'fits', 'message'),
    [
        ('renda2012', ['poisson_ratio'], 'renda2012 has no derivative by poisson_ratio: choose'),
        ('closed_form', ['tendon_offsets'], 'no derivative by tendon_offsets: choose --model exa'),
        ('exact', ['mass'], "cannot fit 'mass', expected one of youngs_modulus"),
    ],
)
def test_what_cannot_be_fitted_is_refused(model: str, fits: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        identify(measured()[:2], PARAMETERS, model, fits)


def test_a_tension_without_an_answer_is_an_error() -> None:
    steps = measured()
    steps[0] = dataclasses.replace(
        steps[0], window=dataclasses.replace(steps[0].window, tensions=one_tendon(500.0))
    )
    with pytest.raises(SolveError, match='compress the arm to nothing'):
        identify(steps, PARAMETERS, 'closed_form')


# The command ------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm of modulus `TRUE` that the model closed_form is right for, and a camera afar."""
    held = (0.0, 1.0, 2.0, 3.0)
    time, pulled = staircase(held, hold=2.0)
    rng = np.random.default_rng(0)
    seen = np.arange(0.0, time[-1], 0.1)
    samples = [description(), *tension_samples(time, pulled)]
    for at, tension in zip(seen, np.interp(seen, time, pulled)):
        if tension in held:
            points = midline('closed_form', one_tendon(tension), 31,
                             material__youngs_modulus=TRUE)  # fmt: skip
            points = FAR.to_camera(points) + 3e-4 * rng.standard_normal(points.shape)
            samples.append(path_sample(points, nanoseconds(at), frame='camera'))
    return bag_of(tmp_path_factory.mktemp('bags') / 'bag', samples)


def test_the_command_fits_every_model_and_writes_the_best(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'fitted.yaml'
    arguments = ['--model', 'closed_form', 'exact', '--out', str(out), '--json']
    assert main(['identify', str(bag), *arguments]) == 0
    said = json.loads(capsys.readouterr().out)
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
    # What was written is that arm, and how well it is known.
    config = load_config(out)
    assert config.model == 'closed_form'
    assert config.arm.material.youngs_modulus == young['value']
    assert config.uncertainty.youngs_modulus == pytest.approx(young['stddev'] / young['value'])
    # It differs from what it began with in nothing else.
    changed = {'model', 'material.youngs_modulus', 'material.youngs_modulus_stddev'}
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
    for text in ('95 % interval', 'steps left out of the fit', 'mirror image'):
        assert text in out
    assert '5 fits of closed_form' in err


def test_undetermined_parameters_end_without_a_config(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'fitted.yaml'
    fits = ['--fit', 'youngs_modulus', 'tension_scale', '--out', str(out)]
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
    # Of all models, that which has one is left; but here it changes nothing.
    assert main(['identify', str(bag), '--model', 'all', *fits]) == 1
    out = capsys.readouterr().out
    assert 'renda2012 is not fitted: the model renda2012 has no derivative' in out
    assert 'poisson_ratio changes nothing that was measured' in out
