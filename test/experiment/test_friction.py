"""Friction fitted to steps of loading and unloading."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from experiments import PARAMETERS, TRUE, one_tendon, shapes, with_encoders

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.alignment import Alignment
from octo_arm_model.experiment.compare import compare
from octo_arm_model.experiment.fit import followed
from octo_arm_model.experiment.identify import identify
from octo_arm_model.experiment.measured_shapes import MeasuredShape
from octo_arm_model.experiment.midlines import resample
from octo_arm_model.experiment.steady_windows import by_length
from octo_arm_model.rod.displacements import displacements_of

LOOP = tuple(map(one_tendon, (1.0, 2.4, 3.6, 2.4)))
LONG_LOOP = tuple(map(one_tendon, (1.0, 2.0, 3.0, 3.6, 3.0, 2.0, 1.0)))
ROUGH = {'material.youngs_modulus': TRUE, 'tendons.friction': [0.2]}


def loop(
    model: str, noise: float = 0.0, pulls: Sequence[np.ndarray] = LOOP, **changes: Any
) -> list[MeasuredShape]:
    """Steps up and down of an arm with friction, with encoders whose slack tendons are loose."""
    values = {**PARAMETERS, **ROUGH, **changes, 'model': model, 'stations': 101}
    solver = Config.from_parameters(values).solver()
    backbones = followed(solver, pulls)
    lines = [resample(backbone.position, np.linspace(0.0, 1.0, 61)) for backbone in backbones]
    return [
        with_encoders(step, displacements_of(solver, backbone).ravel() - 3e-3 * (pull == 0.0))
        for step, pull, backbone in zip(shapes(lines, pulls, noise=noise), pulls, backbones)
    ]


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_friction_and_stiffness_are_found_together(model: str) -> None:
    fitted = identify(
        loop(model, 2e-4), PARAMETERS, model, ['friction', 'youngs_modulus'], Alignment.none(),
        loss='linear',
    )  # fmt: skip
    found = fitted.estimates
    for name, true in (('friction', 0.2), ('youngs_modulus', TRUE)):
        low, high = found[name].interval95
        assert low < true < high
        assert found[name].value == pytest.approx(true, rel=0.02)
    assert fitted.parameters['tendons.friction'] == [found['friction'].value]


def test_without_it_the_branches_are_left_over() -> None:
    steps = loop('closed_form', pulls=LONG_LOOP)
    fits = ['youngs_modulus']
    without = identify(steps, PARAMETERS, 'closed_form', fits, Alignment.none(), loss='linear')
    assert without.after.rms > 1e-3
    assert any('loading and unloading differ' in note for note in without.notes)


def test_a_comparison_follows_the_steps() -> None:
    steps = loop('exact')
    rough = compare(steps, {**PARAMETERS, **ROUGH}, 'exact', Alignment.none())
    assert rough.percent('tip').max() < 0.02
    smooth = {**PARAMETERS, **ROUGH, 'tendons.friction': []}
    assert compare(steps, smooth, 'exact', Alignment.none()).percent('tip').max() > 1.0


def test_friction_and_the_stretch_of_tendons_are_found_together() -> None:
    pulls = tuple(map(one_tendon, (3.0, 2.4)))
    steps = loop('exact', 1e-4, pulls, **{'tendons.axial_stiffness': [400.0]})
    guess = {**PARAMETERS, 'material.youngs_modulus': TRUE, 'tendons.axial_stiffness': [700.0]}
    fitted = identify(
        steps, guess, 'exact', ['friction', 'axial_stiffness'], Alignment.none(), loss='linear'
    )
    for name, true in (('friction', 0.2), ('axial_stiffness', 400.0)):
        assert fitted.estimates[name].value == pytest.approx(true, rel=0.02)


def test_friction_is_found_without_load_cells() -> None:
    """It makes the arm lag behind its tendons, whose tensions nobody reads."""
    guess = {**PARAMETERS, **ROUGH, 'tendons.friction': [0.1], 'tendons.axial_stiffness': [400.0]}
    pulls = tuple(map(one_tendon, (3.0, 2.4)))
    steps = loop('exact', 1e-5, pulls, **{'tendons.axial_stiffness': [400.0]})
    windows = by_length([step.window for step in steps], Config.from_parameters(guess))
    steps = [
        dataclasses.replace(step, window=window)
        for step, window in zip(steps, windows, strict=True)
    ]
    fitted = identify(steps, guess, 'exact', ['friction'], Alignment.none(), loss='linear')
    assert fitted.estimates['friction'].value == pytest.approx(0.2, rel=0.02)
    np.testing.assert_allclose(fitted.tensions[:, 0], [pull[0] for pull in pulls], rtol=0.01)


def test_the_papers_model_cannot_be_fitted_with_friction() -> None:
    with pytest.raises(ConfigError, match='the model renda2012 has no friction'):
        identify(loop('closed_form'), PARAMETERS, 'renda2012', ['friction'], Alignment.none())
