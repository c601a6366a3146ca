"""Find tensions for targets: accuracy, bounds, least effort, and Jacobians of targets."""

import numpy as np
import pytest
from differences import jacobian as derivative
from numpy.testing import assert_allclose
from rods import THIRDS
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    BackboneShape,
    Bending,
    Body,
    Loads,
    Material,
    Section,
    Solver,
    Stiffness,
    TargetError,
    TensionError,
    TipPose,
    TipPosition,
    find_tensions,
)
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

TENSIONS = 0.6 * np.array(FETCHING_IN_SPACE)
HIGHEST = np.array([[0.5], [4.0], [13.0]]) * np.ones((3, 4))


@pytest.fixture(scope='module')
def solver(table4):
    return table4.solver('exact', 61)


def effort(tensions: np.ndarray) -> float:
    return float(((tensions / HIGHEST) ** 2).sum())


def test_tip_position_is_reached_with_less_effort(solver):
    target = solver.solve(TENSIONS)
    result = find_tensions(solver, TipPosition(target.tip), HIGHEST)
    assert result.reached
    assert_allclose(solver.solve(result.backbone.tensions).tip, target.tip, atol=1e-7)
    assert (result.backbone.tensions >= 0.0).all()
    assert (result.backbone.tensions <= HIGHEST).all()
    assert effort(result.backbone.tensions) < 0.5 * effort(TENSIONS)


def test_slack_tendons_have_no_tension(solver):
    straight = solver.solve(0.0 * TENSIONS)
    result = find_tensions(solver, TipPosition(straight.tip), HIGHEST, start=0.0 * TENSIONS)
    assert result.reached and not result.backbone.tensions.any()


def test_least_effort_fulfils_the_optimality_conditions(solver):
    result = find_tensions(solver, TipPosition([0.25, 0.1, -0.1]), HIGHEST)
    fraction = (result.backbone.tensions / HIGHEST).ravel()
    jacobian = solver.sensitivity(result.backbone).by_tension.tip[:3] * HIGHEST.ravel()
    is_free = fraction > 1e-6
    # Karush-Kuhn-Tucker conditions: for free tensions the gradient of the effort is a combination
    # of those of the constraints; for tensions at a bound the multiplier has the right sign.
    multipliers = np.linalg.lstsq(jacobian[:, is_free].T, fraction[is_free], rcond=None)[0]
    assert_allclose(jacobian[:, is_free].T @ multipliers, fraction[is_free], atol=1e-4)
    assert (jacobian[:, ~is_free].T @ multipliers <= 1e-4).all()


@pytest.mark.parametrize('is_slack', [False, True])
def test_tip_pose_is_reached(solver, is_slack):
    parts, drawn = np.random.default_rng(6).uniform(size=(2, 3, 4))
    target = solver.solve(HIGHEST * parts * (drawn < 0.6) if is_slack else TENSIONS)
    result = find_tensions(solver, TipPose(target.tip, target.quaternion[-1]), HIGHEST)
    assert result.reached
    rotation = Rotation.from_quat(np.array(result.backbone.quaternion[-1]))
    difference = rotation * Rotation.from_quat(np.array(target.quaternion[-1])).inv()
    assert difference.magnitude() < 1e-5
    assert_allclose(result.backbone.tip, target.tip, atol=1e-6)


@pytest.mark.parametrize(('plane', 'angle'), [(0.0, 1.1), (2.0, 1.1), (-1.3, 1.1), (0.5, np.pi)])
def test_bending_target_has_its_angle_and_plane(solver, plane, angle):
    result = find_tensions(solver, Bending(plane, angle), HIGHEST)
    base, tip = (Rotation.from_quat(result.backbone.quaternion[i].copy()) for i in (0, -1))
    t, n, b = (base.inv() * tip).apply([1.0, 0.0, 0.0])
    assert result.reached
    assert np.arccos(t) == pytest.approx(angle, abs=1e-4)
    if angle < np.pi:
        assert np.angle(np.exp(1j * (np.arctan2(b, n) - plane))) == pytest.approx(0.0, abs=1e-4)


def of_three(scale: float = 1.0) -> Arm:
    """Return a cone with three tendons."""
    section = Section(0.3 * scale, 0.009 * scale, 0.0045 * scale, THIRDS)
    return Arm(Material(1e5), Body(0.3 * scale, 0.015 * scale, 0.0075 * scale), (section,))


@pytest.mark.parametrize('scale', [1e-2, 1.0, 30.0])
@pytest.mark.parametrize('parts', [(0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.3, 0.6, 0.2)])
def test_targets_with_slack_tendons_are_reached_at_any_scale(scale, parts):
    # Small and large arms, with tendons at the lower bound of zero.
    solver, unit = Solver(of_three(scale), 'exact', 31), 10.0 * scale**2
    target = solver.solve(unit * np.array([parts]))
    result = find_tensions(solver, TipPosition(target.tip), 2.0 * unit)
    assert result.reached, result.error
    assert_allclose(result.backbone.tip, target.tip, rtol=0.0, atol=1e-6 * solver.arm.length)


@pytest.mark.parametrize('angles', [(0.187, 2.389, 3.106), (3.106, 2.389, 0.187)])
def test_target_that_one_tendon_reaches_is_found_in_any_order_of_tendons(angles):
    # Nearly all searches from three taut tendons end in another minimum, 12 mm away.
    section = Section(0.4, 0.009, 0.006, angles, (3.0, 3.0, 3.0))
    arm = Arm(Material(68_813.0, 0.45, 1050.0), Body(0.4, 0.016, 0.009), (section,))
    solver = Solver(arm, 'exact', 31, loads=Loads(gravity=(0.0, 0.0, -9.81)))
    alone = 4.964 * (np.array(angles) == 0.187)
    target = TipPosition(solver.solve([alone]).tip)
    assert_allclose(find_tensions(solver, target, 7.783).backbone.tensions[0], alone, atol=1e-3)


def test_backbone_shape_is_reached(solver):
    shape = solver.solve(TENSIONS)
    target = BackboneShape(shape.s[::10], shape.position[::10])
    result = find_tensions(solver, target, HIGHEST)
    assert_allclose(result.backbone.position, shape.position, atol=1e-5)


def test_unreachable_target_gives_the_smallest_error():
    solver = Solver(of_three(), 'exact', 11)
    result = find_tensions(solver, TipPosition([1.0, 0.0, 0.0]), 4.0)
    assert not result.reached
    # The straight arm has the smallest error.
    assert result.error == pytest.approx(0.7, abs=1e-6)
    assert_allclose(result.backbone.tensions, 0.0, atol=1e-4)


def test_co_contraction_gives_the_target_stiffness(solver):
    target = TipPosition(solver.solve(TENSIONS).tip)
    relaxed = find_tensions(solver, target, HIGHEST)
    direction = np.array([0.0, 1.0, 0.0])
    soft = Stiffness(direction, 1.0).of(solver.sensitivity(relaxed.backbone))
    stiff = find_tensions(
        solver,
        target,
        HIGHEST,
        stiffness=Stiffness(direction, 1.2 * soft),
        start=relaxed.backbone.tensions,
    )
    assert stiff.reached
    assert stiff.stiffness == pytest.approx(1.2 * soft, rel=1e-4)
    # By definition of the stiffness: a small force along the direction.
    push = 1e-5
    pushed = solver.solve(stiff.backbone.tensions, [0, push, 0, 0, 0, 0])
    assert push / (pushed.tip - stiff.backbone.tip)[1] == pytest.approx(1.2 * soft, rel=1e-3)


@pytest.mark.parametrize('highest', [0.0, -1.0, np.nan, np.inf])
def test_bounds_must_be_positive(solver, highest):
    with pytest.raises(TensionError, match='highest tension of tendon_1_1 is'):
        find_tensions(solver, TipPosition([0.3, 0.0, 0.0]), highest)
    with pytest.raises(ArmDefinitionError, match='seed is -1, expected an integer >= 0'):
        find_tensions(solver, TipPosition([0.3, 0.0, 0.0]), 1.0, seed=-1)


@pytest.mark.parametrize('name', ['position', 'pose', 'bending', 'shape'])
def test_jacobians_of_targets_equal_finite_differences(solver, name):
    other = solver.solve(0.7 * TENSIONS)
    target = {
        'position': TipPosition(other.tip),
        'pose': TipPose(other.tip, other.quaternion[-1]),
        'bending': Bending(0.4, 0.9),
        'shape': BackboneShape(other.s[::7], other.position[::7]),
    }[name]
    backbone = solver.solve(TENSIONS + 0.05)

    def error(tensions):
        return target.error(solver.solve(tensions.reshape(3, 4)))

    analytic = target.jacobian(backbone, solver.sensitivity(backbone).by_tension)
    expected = derivative(error, backbone.tensions.ravel(), step=1e-4)
    assert_allclose(analytic, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: TipPosition([0.0, 0.0]), 'tip position is .*, expected 3 finite'),
        (lambda: TipPosition([0.0, np.nan, 0.0]), 'tip position is .*, expected 3 finite'),
        (lambda: TipPosition([0.0, 1e300, 0.0]), 'tip position is .*, each of at most 1e'),
        (lambda: TipPose([0.0] * 3, [0.0, 0.0, 0.0, 2.0]), 'tip quaternion is .*, expected'),
        (lambda: Bending(0.0, 4.0), 'bending angle is 4.0, expected 0 to pi'),
        (lambda: Bending(np.inf, 1.0), 'bending plane is inf'),
        (lambda: BackboneShape([0.1], [[0.0] * 3] * 2), 'backbone position has 2 points'),
        (lambda: Stiffness([0.0, 0.0, 0.0], 1.0), 'stiffness direction is .*, expected'),
        (lambda: Stiffness([np.inf, 0.0, 0.0], 1.0), 'direction is .*, expected 3 finite'),
        (lambda: Stiffness([np.nan, 1.0, 0.0], 1.0), 'direction is .*, expected 3 finite'),
        (lambda: Stiffness([1.0, 0.0, 0.0], 0.0), 'stiffness is 0.0, expected a number > 0'),
    ],
)
def test_invalid_targets_are_refused(build, message):
    with pytest.raises(TargetError, match=message):
        build()  # type: ignore[operator]
