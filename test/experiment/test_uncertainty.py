"""Intervals, correlations and directions that the data leave undetermined."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import PARAMETERS, PULLS, TRUE, measured, midline, one_tendon, shapes, tips
from scipy.stats import binom

from octo_arm_model.experiment.identify import identify


@pytest.mark.parametrize('trials', [2, pytest.param(64, marks=pytest.mark.endurance)])
def test_intervals_hold_the_truth_as_often_as_they_say(trials: int) -> None:
    """Noise of the camera alone, and tensions that are wrong for all frames of a step."""
    parameters = {**PARAMETERS, 'material.youngs_modulus': 1.01 * TRUE, 'stations': 31}
    pulls = tuple(one_tendon(tension) for tension in (1.5, 2.5, 3.5))
    inside = 0
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
        fitted = identify(steps, PARAMETERS, 'closed_form', loss='linear')
        deviations.append(fitted.estimates['youngs_modulus'].stddev)
    assert deviations[1] > 0.7 * deviations[0]


def test_what_the_data_cannot_tell_apart_is_said_and_not_fitted() -> None:
    # Without loads only the ratio of tensions and modulus matters.
    fitted = identify(measured(), PARAMETERS, 'closed_form', ('youngs_modulus', 'tension_scale'))
    (reason,) = fitted.undetermined
    assert reason.startswith(
        'tension_scale is left as it is: changed together in this proportion nothing measured '
        'changes: youngs_modulus '
    )
    # The other is fitted as if it were alone.
    assert fitted.is_trustworthy
    assert fitted.estimates['tension_scale'].value is None
    assert fitted.estimates['youngs_modulus'].value == pytest.approx(TRUE, rel=3e-4)
    assert fitted.parameters['material.youngs_modulus'] == pytest.approx(TRUE, rel=3e-4)
    both = identify(measured('exact'), PARAMETERS, 'exact', ('youngs_modulus', 'poisson_ratio'))
    assert both.estimates['youngs_modulus'].value == pytest.approx(TRUE, rel=3e-4)
    assert both.estimates['poisson_ratio'].value is None
    assert both.correlations.shape == (1, 1)
    flat = identify(measured('exact'), PARAMETERS, 'exact', ('poisson_ratio',))
    assert not flat.is_trustworthy
    assert flat.undetermined == (
        'poisson_ratio is left as it is: poisson_ratio changes nothing that was measured',
    )


def test_strong_correlations_are_pointed_out() -> None:
    fits = ('youngs_modulus', 'tendon_offsets')
    fitted = identify(measured('exact', noise=2e-4), PARAMETERS, 'exact', fits, loss='linear')
    one, other = fitted.correlations[0, 1], fitted.correlations[1, 0]
    assert one == pytest.approx(other, rel=1e-12)
    assert one > 0.95
    assert any(
        'hardly tell youngs_modulus and tendon_offset.tendon_1_1 apart' in note
        for note in fitted.notes
    )
    # Each is determined badly, and the intervals are wide.
    for name, true in (('youngs_modulus', TRUE), ('tendon_offset.tendon_1_1', 0.0)):
        low, high = fitted.estimates[name].interval95
        assert low <= true <= high


def test_without_another_step_there_is_no_interval() -> None:
    (estimate,) = (fitted := identify(measured()[3:4], PARAMETERS, 'exact')).estimates.values()
    assert (estimate.stddev, estimate.interval95) == (None, None)
    assert fitted.cross_validation is None
    assert 'there is one load (step 1)' in ' '.join(fitted.notes)
    at_rest = measured(pulls=(one_tendon(0.0), one_tendon(2.0)))
    fitted = identify(at_rest, PARAMETERS, 'closed_form')
    assert fitted.estimates['youngs_modulus'].interval95 is None
    assert 'there is one load (step 2)' in ' '.join(fitted.notes)


def test_repeats_of_one_load_confirm_nothing() -> None:
    # One load cell reads 7 % too much, each time: E comes out wrong each time alike.
    pull = one_tendon(2.0)
    lines = [midline('closed_form', 0.93 * pull, 41) for _ in range(6)]
    fitted = identify(
        shapes(lines, 6 * [pull], np.random.default_rng(1), 5e-4), PARAMETERS, 'closed_form'
    )
    young = fitted.estimates['youngs_modulus']
    assert young.value == pytest.approx(1.1e5 / 0.93, rel=0.01)
    assert (young.interval95, fitted.cross_validation) == (None, None)
    assert 'there is one load (step 1, 2, 3, 4, 5, 6)' in ' '.join(fitted.notes)


def test_repeats_do_not_narrow_an_interval() -> None:
    rng = np.random.default_rng(2)
    pulls = [one_tendon(tension) for tension in (1.5, 2.2, 3.0, 3.8)]
    pulled = [pull * (1.0 + 0.03 * rng.standard_normal()) for pull in pulls]
    lines = [midline('closed_form', pull, 21) for pull in pulled]
    once, often = (
        identify(shapes(times * lines, times * pulls), PARAMETERS, 'closed_form', loss='linear')
        for times in (1, 3)
    )
    one, other = (fit.estimates['youngs_modulus'].stddev for fit in (once, often))
    assert other == pytest.approx(one, rel=0.02)
    assert next(steps for steps, _ in often.step_misfits) == (1, 5, 9)


def test_the_error_of_a_wrong_model_is_in_the_interval() -> None:
    fitted = identify(measured('exact', noise=3e-4), PARAMETERS, 'closed_form', loss='linear')
    young = fitted.estimates['youngs_modulus']
    assert fitted.floor > 3e-4
    assert 0.0 < young.model_stddev < young.stddev
    assert 'model error floor' in ' '.join(fitted.notes)
    # The tip of held-back loads is off by about its standard deviation in three coordinates.
    assert fitted.tip_stddev * np.sqrt(3.0) == pytest.approx(
        fitted.cross_validation.tip_error, rel=0.5
    )
    right = identify(measured('closed_form', noise=3e-4), PARAMETERS, 'closed_form', loss='linear')
    assert right.floor < 0.1 * fitted.floor
