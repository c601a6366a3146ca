"""The loss is that of the lesser misfit at held-back loads."""

from __future__ import annotations

import dataclasses

import pytest
from experiments import PARAMETERS, measured

from octo_arm_model.experiment.fitting.identify import identify


@pytest.mark.parametrize('spoiled', [False, True])
def test_the_better_loss_is_taken(spoiled: bool) -> None:
    # A wrong model leaves residuals that are no outliers; half a midline from elsewhere is one.
    steps = measured('exact', noise=5e-4, wrong=0.05)
    if spoiled:
        lost = steps[2].points.copy()
        lost[60:] += [0.03, -0.04, 0.02]
        steps[2] = dataclasses.replace(steps[2], points=lost)
    fits = {loss: identify(steps, PARAMETERS, 'closed_form', loss=loss)
            for loss in ('linear', 'soft_l1')}  # fmt: skip
    chosen = identify(steps, PARAMETERS, 'closed_form')
    assert chosen.loss == ('soft_l1' if spoiled else 'linear')
    assert chosen.estimates == fits[chosen.loss].estimates
    assert any('loss ' in note for note in chosen.notes)
    if not spoiled:
        assert fits['linear'].after.rms <= fits['soft_l1'].after.rms
