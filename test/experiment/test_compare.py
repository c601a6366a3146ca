"""The comparison of model and measurement, on errors that are known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from experiments import ARM, FAR, PARAMETERS, midline, one_tendon, shapes
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.experiment.camera import Alignment
from octo_arm_model.experiment.compare import compare

STEPS = (0.0, 1.09, 3.06)
PERCENT = 100.0 / ARM.length


def answer(tension: float, model: str = 'closed_form') -> np.ndarray:
    return midline(model, one_tendon(tension))


def compared(lines: list[np.ndarray], alignment: Alignment | None = Alignment.none()):
    seen = shapes(lines, [one_tendon(tension) for tension in STEPS])
    return compare(seen, PARAMETERS, 'closed_form', alignment)


@pytest.mark.parametrize('angle', [0.02, 0.1])
def test_an_arm_turned_about_its_base_is_off_by_the_chord(angle):
    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    lines = [turn.apply(answer(tension)) for tension in STEPS]
    expected = [
        2.0 * np.sin(0.5 * angle) * np.linalg.norm(answer(tension)[-1]) * PERCENT
        for tension in STEPS
    ]
    comparison = compared(lines)
    assert comparison.percent('tip') == pytest.approx(expected, rel=1e-3)
    # Of the straight arm every point is off in proportion to its distance from the base, and the
    # nearest point of the model is the foot of the perpendicular.
    straight = np.sin(angle) * PERCENT * ARM.length
    assert comparison.percent('max')[0] == pytest.approx(straight, rel=1e-3)
    assert comparison.percent('mean')[0] == pytest.approx(0.5 * straight, rel=2e-3)
    assert (comparison.percent('max') <= comparison.percent('hausdorff') + 1e-9).all()
    assert (comparison.percent('hausdorff') <= np.array(expected) + 0.05).all()


def test_a_fitted_alignment_takes_away_what_a_camera_could_explain():
    lines = [FAR.to_camera(answer(tension)) for tension in STEPS]
    comparison = compared(lines, None)
    assert comparison.percent('hausdorff') == pytest.approx([0.0] * 3, abs=0.02)
    assert 'it removes the error that a motion of the camera explains' in comparison.notes[0]
    assert 'mirror image' in comparison.notes[1]
    # The true alignment gives the same errors, a wrong one larger ones.
    assert compared(lines, FAR).percent('max') == pytest.approx([0.0] * 3, abs=0.01)
    with pytest.raises(MeasurementError, match='is the alignment right'):
        compared(lines, Alignment.none())


def test_steps_without_an_answer_are_named_and_the_others_compared():
    pulls = [one_tendon(1.0), one_tendon(500.0)]
    seen = shapes([answer(1.0), answer(1.0)], pulls)
    comparison = compare(seen, PARAMETERS, 'closed_form', Alignment.none())
    assert [step.number for step in comparison.steps] == [1]
    assert comparison.refused[0].startswith('step 2: tensions compress the arm to nothing')
    with pytest.raises(SolveError, match='closed_form has no answer for any step; step 1'):
        compare(seen[1:], PARAMETERS, 'closed_form', None)


def test_where_friction_leaves_no_derivative_a_straight_step_has_errors_but_no_bend():
    rough = {**PARAMETERS, 'tendons.friction': [0.2]}
    seen = shapes([answer(0.0)], [one_tendon(0.0)])
    (step,) = compare(seen, rough, 'exact', Alignment.none()).steps
    assert step.errors.tip == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(step.bend)
