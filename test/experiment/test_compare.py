"""The comparison of model and measurement, with errors and cameras known by construction."""

import dataclasses

import experiments
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.camera import Alignment, clock_offset, undetermined
from octo_arm_model.experiment.compare import compare
from octo_arm_model.experiment.fit import fit_alignment, followed
from octo_arm_model.experiment.recording import Recording

STEPS = (0.0, 1.09, 3.06)
PERCENT = 100.0 / experiments.ARM.length


def answer(tension: float, model: str = 'closed_form') -> np.ndarray:
    return experiments.midline(model, experiments.one_tendon(tension))


def compared(lines: list[np.ndarray], alignment: Alignment | None = Alignment.none()):
    seen = experiments.shapes(lines, [experiments.one_tendon(tension) for tension in STEPS])
    return compare(seen, experiments.PARAMETERS, 'closed_form', alignment)


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
    straight = np.sin(angle) * PERCENT * experiments.ARM.length
    assert comparison.percent('max')[0] == pytest.approx(straight, rel=1e-3)
    assert comparison.percent('mean')[0] == pytest.approx(0.5 * straight, rel=2e-3)
    assert (comparison.percent('max') <= comparison.percent('hausdorff') + 1e-9).all()
    assert (comparison.percent('hausdorff') <= np.array(expected) + 0.05).all()


def test_a_fitted_alignment_takes_away_what_a_camera_could_explain():
    lines = [experiments.FAR.to_camera(answer(tension)) for tension in STEPS]
    comparison = compared(lines, None)
    assert comparison.percent('hausdorff') == pytest.approx([0.0] * 3, abs=0.02)
    assert 'it removes the error that a motion of the camera explains' in comparison.notes[0]
    assert 'mirror image' in comparison.notes[1]
    # The true alignment gives the same errors, a wrong one larger ones.
    assert compared(lines, experiments.FAR).percent('max') == pytest.approx([0.0] * 3, abs=0.01)
    with pytest.raises(MeasurementError, match='is the alignment right'):
        compared(lines, Alignment.none())


def test_steps_without_an_answer_are_named_and_the_others_compared():
    pulls = [experiments.one_tendon(1.0), experiments.one_tendon(500.0)]
    seen = experiments.shapes([answer(1.0), answer(1.0)], pulls)
    comparison = compare(seen, experiments.PARAMETERS, 'closed_form', Alignment.none())
    assert [step.number for step in comparison.steps] == [1]
    assert comparison.refused[0].startswith('step 2: tensions compress the arm to nothing')
    with pytest.raises(SolveError, match='closed_form has no answer for any step; step 1'):
        compare(seen[1:], experiments.PARAMETERS, 'closed_form', None)


def test_where_friction_leaves_no_derivative_a_straight_step_has_errors_but_no_bend():
    rough = {**experiments.PARAMETERS, 'tendons.friction': [0.2]}
    seen = experiments.shapes([answer(0.0)], [experiments.one_tendon(0.0)])
    (step,) = compare(seen, rough, 'exact', Alignment.none()).steps
    assert step.errors.tip == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(step.bend)


# Where a camera is and how its clock is off, from what it saw ------------------------------------


def test_what_an_alignment_leaves_open_is_said():
    line = np.linspace(0.0, 1.0, 10)[:, np.newaxis] * [1.0, 2.0, 0.5]
    assert 'rotation about it is open' in undetermined(line, 0.0)[0]
    assert 'mirror image' in undetermined(experiments.circle(), 0.0)[0]
    assert 'no rotation' in undetermined(np.zeros((4, 3)), 0.0)[0]
    # An arm of 200 mm that goes 5.5 mm out of its plane is told from one in it by the noise.
    points = experiments.circle()
    points[:, 2] = 5.5e-3 * np.sin(np.linspace(0.0, 2.0 * np.pi, len(points)))
    noisy = points + 1e-4 * np.random.default_rng(0).standard_normal(points.shape)
    assert undetermined(noisy, 1e-4 * np.sqrt(3.0)) == ()
    assert 'mirror image' in undetermined(noisy, 5e-3)[0]


def test_the_camera_is_found_despite_outliers_and_midlines_that_begin_late():
    rng = np.random.default_rng(5)
    pulls = [experiments.one_tendon(tension) for tension in experiments.HELD]
    lines = [
        experiments.FAR.to_camera(experiments.midline('closed_form', pull)[3:]) for pull in pulls
    ]
    seen = experiments.shapes(lines, pulls, rng, noise=2e-4)
    # A third of one midline is far from the arm.
    lost = seen[4].points.copy()
    lost[-15:] += [0.04, -0.03, 0.02]
    seen[4] = dataclasses.replace(seen[4], points=lost)
    found = fit_alignment(seen, experiments.PARAMETERS, 'closed_form')
    assert Rotation.from_matrix(found.rotation @ experiments.FAR.rotation.T).magnitude() < 2e-3
    points = experiments.midline('closed_form', experiments.one_tendon(2.0))
    assert np.abs(found.to_base(experiments.FAR.to_camera(points)) - points).max() < 5e-4
    (tip,) = experiments.shapes([np.zeros((1, 3))], [experiments.one_tendon(1.0)])
    with pytest.raises(MeasurementError, match=r'1 measured point\(s\), expected at least 3'):
        fit_alignment([tip], experiments.PARAMETERS, 'closed_form')


def offset_of(seen: Recording, kept: object = slice(None), **changes: object) -> float | None:
    """The offset of the clock of a camera that saw what is ``kept``, for an arm with changes."""
    tips = np.array([points[-1] for points in seen.frames])[kept]
    arm = dataclasses.replace(experiments.ARM, **changes)
    return clock_offset(arm, seen.tension_time, seen.tensions, seen.frame_time[kept], tips)


@pytest.mark.parametrize('ahead', [-0.7, 0.35])
def test_the_clock_of_the_camera_is_set_by_the_motion(ahead):
    seen = experiments.recording('exact', ahead, material__youngs_modulus=1.3e5)
    assert offset_of(seen) == pytest.approx(-ahead, abs=0.03)
    # The search is by the paper's model, which knows no sheaths, and no friction.
    changes = {'sheath_stiffness': (1e5,), 'friction': (0.1,), 'axial_stiffness': (9.0,)}
    assert offset_of(seen, **changes) == pytest.approx(-ahead, abs=0.03)


@pytest.mark.parametrize(('ahead', 'friction'), [(0.0, 0.1), (0.3, 0.02)])
def test_friction_is_not_taken_for_an_offset(ahead, friction):
    """A tip that is behind at each reversal is so at rest as well, which no clock explains."""
    values = {
        **experiments.PARAMETERS,
        'tendons.friction': [friction],
        'material.youngs_modulus': 1.3e5,
    }
    solver = Config.from_parameters(values).solver('closed_form', 31)
    time, pulled = experiments.staircase((0.0, 1.5, 3.0, 1.5), hold=2.0, rate=25.0)
    tensions = np.outer(pulled, [1.0, 0.0, 0.0, 0.0])
    tips = np.array([backbone.tip for backbone in followed(solver, tensions)])
    tips += 5e-4 * np.random.default_rng(0).standard_normal(tips.shape)
    found = clock_offset(experiments.ARM, time, tensions, time[::3] + ahead, tips[::3])
    assert found == pytest.approx(-ahead, abs=0.021)


def test_an_arm_that_is_only_seen_at_rest_does_not_move_the_clock():
    seen = experiments.recording(held=experiments.HELD[:4], rate=50.0)
    # Of 3 s at rest and 1 s on the way, from 0.5 to 2.5 s.
    at_rest = (seen.frame_time % 4.0 > 0.5) & (seen.frame_time % 4.0 < 2.5)
    assert offset_of(seen, at_rest) == 0.0
    noise = 1e-3 * np.random.default_rng(0).standard_normal((len(seen.frames), 1, 3))
    still = dataclasses.replace(experiments.recording(held=(2.0, 2.0)), frames=tuple(noise))
    still = dataclasses.replace(still, frame_time=still.frame_time[: len(noise)],
                                frames=still.frames[: len(still.frame_time)])  # fmt: skip
    assert offset_of(still) is None
