"""Known parameters come back from synthetic measurements, by every model."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from experiments import (
    FAR,
    PARAMETERS,
    PULLS,
    STEPS,
    TRUE,
    measured,
    midline,
    one_tendon,
    shapes,
    tips,
)

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.identification import Identification
from octo_arm_model.experiment.identify import identify
from octo_arm_model.experiment.unknowns import move_tendons


def values(fitted: Identification) -> dict[str, float]:
    return {name: one.value for name, one in fitted.estimates.items()}


@pytest.mark.parametrize('only_tips', [False, True])
def test_youngs_modulus_is_found_by_every_model_in_its_own_data(
    model: str, only_tips: bool
) -> None:
    steps = measured(model)
    seen = tips(steps) if only_tips else steps
    fitted = identify(seen, PARAMETERS, model, loss='linear')
    assert values(fitted) == {'youngs_modulus': pytest.approx(TRUE, rel=3e-4)}
    assert fitted.after.rms < 5e-5 < fitted.before.rms
    assert fitted.parameters['material.youngs_modulus'] == values(fitted)['youngs_modulus']


def test_scale_offset_and_camera_are_found_together() -> None:
    read = [np.maximum((pull - 0.1 * (pull > 0)) / 1.2, 0.0) for pull in PULLS]
    lines = [FAR.to_camera(midline('closed_form', pull)) for pull in PULLS]
    fits = ('tension_scale', 'tension_offset', 'alignment')
    fitted = identify(shapes(lines, read), PARAMETERS, 'closed_form', fits, loss='linear')
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
        shapes(lines, pulls),
        parameters,
        'exact',
        ('poisson_ratio', 'tendon_offsets'),
        loss='linear',
    )
    assert values(fitted) == {
        'poisson_ratio': pytest.approx(0.3, abs=0.02),
        'tendon_offset.tendon_1_1': pytest.approx(4e-4, abs=2e-5),
        'tendon_offset.tendon_1_2': pytest.approx(-3e-4, abs=2e-5),
    }
    # The other tendons are not pulled, so they have no unknown.
    again = Config.from_parameters(fitted.parameters).solver().solve([pulls[4]]).tip
    np.testing.assert_allclose(again, lines[4][-1], atol=2e-4)


def test_modulus_and_sheath_are_told_apart_by_tensions_of_many_sizes() -> None:
    """At small tensions a sheath does nothing, a modulus as much as ever."""
    changes = {'tendons__sheath_stiffness': [2.5e5]}
    steps = measured(
        'exact', noise=1e-4, pulls=tuple(map(one_tendon, STEPS[1::2])), parameters=changes
    )
    fits = ('youngs_modulus', 'sheath_stiffness')
    fitted = identify(steps, PARAMETERS, 'exact', fits, loss='linear')
    assert values(fitted) == {
        'youngs_modulus': pytest.approx(TRUE, rel=3e-3),
        'sheath_stiffness': pytest.approx(2.5e5, rel=3e-2),
    }
    low, high = fitted.estimates['sheath_stiffness'].interval95
    assert low < 2.5e5 < high
    assert fitted.parameters['tendons.sheath_stiffness'] == [values(fitted)['sheath_stiffness']]
    rigid = identify(steps, PARAMETERS, 'exact', loss='linear')
    assert fitted.cross_validation.rms < 0.2 * rigid.cross_validation.rms


def test_a_sheath_that_no_tension_shows_stays_as_it_is() -> None:
    steps = measured('exact', pulls=(np.array([0.0, 0.0, 0.0, 0.0]),))
    fitted = identify(steps, PARAMETERS, 'exact', ('youngs_modulus', 'sheath_stiffness'))
    assert values(fitted) == {'youngs_modulus': None, 'sheath_stiffness': None}
    assert any('sheath_stiffness is left as it is' in why for why in fitted.undetermined)


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


def test_the_model_that_made_the_data_explains_them_best() -> None:
    steps = measured('exact', noise=3e-4)
    fitted = {
        model: identify(steps, PARAMETERS, model, loss='linear')
        for model in ('renda2012', 'exact')
    }
    assert fitted['exact'].cross_validation.rms < 0.3 * fitted['renda2012'].cross_validation.rms
    assert not any('biases the estimates' in note for note in fitted['exact'].notes)
    # The other model compensates by another modulus, and a note says so.
    assert abs(values(fitted['renda2012'])['youngs_modulus'] / TRUE - 1.0) > 0.03
    assert any('biases the estimates' in note for note in fitted['renda2012'].notes)


def test_cross_validation_tells_a_step_that_does_not_belong() -> None:
    steps = measured(noise=3e-4)
    wrong = dataclasses.replace(steps[2].window, tensions=1.2 * steps[2].window.tensions)
    steps[2] = dataclasses.replace(steps[2], window=wrong)
    fitted = identify(steps, PARAMETERS, 'closed_form')
    misfits = {numbers: misfit.rms for numbers, misfit in fitted.step_misfits}
    assert max(misfits, key=misfits.get) == (3,)
    assert fitted.cross_validation.rms == pytest.approx(
        np.sqrt(np.mean(np.square(list(misfits.values()))))
    )


def test_a_tension_without_an_answer_is_an_error() -> None:
    steps = measured()
    steps[0] = dataclasses.replace(
        steps[0], window=dataclasses.replace(steps[0].window, tensions=one_tendon(500.0))
    )
    with pytest.raises(SolveError, match='compress the arm to nothing'):
        identify(steps, PARAMETERS, 'closed_form')
