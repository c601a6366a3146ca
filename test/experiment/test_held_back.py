"""The loss is that of the lesser misfit at held-back loads."""

from __future__ import annotations

import dataclasses

import pytest
from experiments import PARAMETERS, STEPS, measured, one_tendon

from octo_arm_model.experiment.identify import identify


@pytest.mark.parametrize('spoiled', [True, pytest.param(False, marks=pytest.mark.endurance)])
def test_the_better_loss_is_taken(spoiled: bool) -> None:
    # A wrong model leaves residuals that are no outliers; half a midline from elsewhere is one.
    pulls = tuple(map(one_tendon, STEPS))
    steps = measured('exact', noise=5e-4, wrong=0.05, pulls=pulls)
    if spoiled:
        lost = steps[2].points.copy()
        lost[60:] += [0.03, -0.04, 0.02]
        steps[2] = dataclasses.replace(steps[2], points=lost)
    expected = 'soft_l1' if spoiled else 'linear'
    told = identify(steps, PARAMETERS, 'closed_form', loss=expected)
    chosen = identify(steps, PARAMETERS, 'closed_form')
    assert chosen.loss == expected
    assert chosen.estimates == told.estimates
    assert any('loss ' in note for note in chosen.notes)
