"""The choice among models, on shapes of three-dimensional finite elements."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from experiments import PARAMETERS, one_tendon, shapes

from octo_arm_model.experiment.identification import (
    Identification,
    best_of,
    disagreements,
    envelope_of,
)
from octo_arm_model.experiment.identify import identify

RESULTS = Path(__file__).parents[2] / 'validation' / 'results.json'


@pytest.fixture(scope='module')
def fitted() -> dict[str, Identification]:
    """Fits to the prototype of E = 110 kPa as finite elements have it, seen by a camera."""
    case = json.loads(RESULTS.read_text(encoding='utf-8'))['cases']['prototype']
    lines = 1e-3 * np.array(case['midlines_mm'])[1:]
    pulls = [one_tendon(tension) for (tension,) in case['tensions_N'][1:]]
    steps = shapes(list(lines), pulls, np.random.default_rng(0), 3e-4)
    fits = ('youngs_modulus', 'alignment')
    return {
        model: identify(steps, PARAMETERS, model, fits, loss='linear')
        for model in ('closed_form', 'exact')
    }


def test_models_that_disagree_at_a_near_misfit_are_named(
    fitted: dict[str, Identification],
) -> None:
    both = list(fitted.values())
    values = [one.estimates['youngs_modulus'].value for one in both]
    assert abs(values[0] / values[1] - 1.0) > 0.03
    (note,) = disagreements(both)
    assert note.startswith('MODELS DISAGREE: ')
    low, high = envelope_of(both, 'youngs_modulus')
    assert low < 1.1e5 < high
    assert disagreements([best_of(both)]) == []
