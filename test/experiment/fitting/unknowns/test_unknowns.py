"""Unknowns of a fit, and the derivatives of the residuals by them."""

from __future__ import annotations

import numpy as np
import pytest
from differences import jacobian
from experiments import FAR, PARAMETERS, measured, midline, shapes, with_encoders
from hypothesis import given, settings
from hypothesis import strategies as st

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.experiment.fitting.identify import identify
from octo_arm_model.experiment.fitting.least_squares.fit import Problem
from octo_arm_model.experiment.fitting.unknowns.readings import Readings
from octo_arm_model.experiment.fitting.unknowns.unknown import FITS
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns


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


@settings(max_examples=2)
@given(
    st.integers(0, 2),
    st.integers(0, 1000),
    st.sampled_from([('friction',), ('sheath_stiffness', 'axial_stiffness')]),
)
def test_the_jacobian_is_that_of_differences(step: int, seed: int, without: tuple[str]) -> None:
    """Friction does not go together with the others."""
    rng = np.random.default_rng(seed)
    pulls = tuple(np.array(pull) for pull in ((1.0, 0.5, 0, 0), (0.3, 2.0, 0, 0), (0, 3.0, 0, 0)))
    lines = [FAR.to_camera(midline('exact', pull, 25)) for pull in pulls]
    steps = shapes(lines, pulls, rng, 1e-3)
    steps = [with_encoders(one, np.full(4, 0.01)) for one in steps]
    fits = [name for name in FITS if name not in without]
    unknowns = Unknowns(PARAMETERS, 'exact', fits, Readings.of(steps), FAR)
    problem = Problem(steps, unknowns)
    sizes = np.array([unknown.scale for unknown in unknowns.unknowns])
    x = unknowns.start + 0.05 * sizes * rng.standard_normal(sizes.size)
    x[unknowns.names.index('poisson_ratio')] = 0.3
    got = problem.weighed_change(x, step)
    expected = jacobian(lambda x: problem.weighed(x, step), x, 1e-5 * sizes)
    # A point that crosses from one segment of the model to the next has two derivatives.
    close = np.isclose(got * sizes, expected * sizes, rtol=1e-4, atol=1e-6 * np.abs(got).max())
    assert close.mean() > 0.97


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
