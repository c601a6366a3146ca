"""Unknowns of a fit, and the derivatives of the residuals by them."""

from __future__ import annotations

import pytest
from experiments import PARAMETERS, measured

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.experiment.identify import identify


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
