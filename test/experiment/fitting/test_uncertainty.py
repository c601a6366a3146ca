"""Intervals, correlations and directions that the data leave undetermined."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import PARAMETERS, PULLS, TRUE, measured, midline, one_tendon, shapes, tips
from scipy.stats import binom

from octo_arm_model.experiment.fitting.identify import identify
from octo_arm_model.experiment.fitting.uncertainty import freedom_of


@pytest.mark.slow
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
    assert 'one step says nothing' in ' '.join(fitted.notes)
    at_rest = measured(pulls=(one_tendon(0.0), one_tendon(2.0)))
    fitted = identify(at_rest, PARAMETERS, 'closed_form')
    assert fitted.estimates['youngs_modulus'].interval95 is None
    assert 'without step 2 it would be open' in ' '.join(fitted.notes)
