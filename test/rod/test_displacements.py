"""Tendons with given displacements: their tensions and derivatives, with friction too."""

import dataclasses
import math
import re

import numpy as np
import pytest
import strategies
from differences import jacobian
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rods import PULL, cylinder, helical_arm, tendon_points
from strategies import fractions, loaded_arms

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    Loads,
    Material,
    Section,
    SolveError,
    Solver,
    TensionError,
    Uncertainty,
    Wound,
    displacements_of,
    load_config,
    solve_displacements,
    wound_sensitivity,
)
from octo_arm_model.arm.errors import ContinuationError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Budget
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

TENSIONS = 0.5 * np.array(FETCHING_IN_SPACE)
IN_AIR = Loads(gravity=(0.0, 0.0, -9.81))


@pytest.fixture(scope='module')
def solver(table4):
    return Solver(table4.arm, 'exact')


def by_name(solver: Solver, values: FloatArray) -> dict[str, float]:
    return dict(zip(solver.arm.tendon_names, values.ravel().tolist(), strict=True))


def displacements_by_name(solver: Solver, backbone: Backbone) -> dict[str, float]:
    """Return the displacement of every tendon [m], by name."""
    return by_name(solver, displacements_of(solver, backbone))


def test_tendon_lengths_equal_those_of_polygons(solver, table4):
    fine = Solver(table4.arm, 'exact', 2001, material='linear')
    backbone = fine.solve(TENSIONS)
    lengths, paths = fine.tendon_lengths(backbone).ravel(), tendon_points(table4.arm, backbone)
    for tendon, section in enumerate(table4.arm.tendon_section):
        acts = backbone.s <= table4.arm.sections[section - 1].anchorage
        polygon = np.linalg.norm(np.diff(paths[tendon, acts], axis=0), axis=1).sum()
        # The polygon has an error of second order where the strain jumps at an anchorage.
        assert lengths[tendon] == pytest.approx(polygon, rel=2e-5)


def test_displacements_and_tensions_can_be_mixed_and_tendons_can_be_slack(solver):
    wound = solve_displacements(
        solver, {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}, {'tendon_3_1': 1}
    )
    assert wound.displacement[0, 0] == pytest.approx(0.02, abs=1e-9)
    assert wound.displacement[1, 1] == pytest.approx(0.01, abs=1e-9)
    assert wound.backbone.tensions[2, 0] == 1.0
    assert wound.slack == ()
    assert np.count_nonzero(wound.backbone.tensions) == 3
    # A tendon that would need a negative tension is slack.
    wound = solve_displacements(solver, {'tendon_1_1': -0.01}, {'tendon_3_1': 1.0})
    assert wound.slack == ('tendon_1_1',)
    assert wound.backbone.tensions[0, 0] == 0.0
    # Its path is shorter than its paid-out length.
    assert wound.displacement[0, 0] > -0.01
    alone = solver.solve([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]])
    assert_allclose(wound.backbone.tip, alone.tip, atol=1e-12)


@pytest.mark.parametrize(
    ('name', 'changes', 'displacements', 'stretch'),
    [
        ('renda2012_table4', {}, {'tendon_1_1': 0.02, 'tendon_3_2': 20.0}, 0.0),  # millimetres
        ('rao2021', {'axial_stiffness': ()}, {'tendon_2_1': 0.9}, 0.0),
        ('renda2012_prototype', {'axial_stiffness': (800.0,)}, {'tendon_1_1': 30.0}, 0.6387),
        (
            'renda2012_prototype',
            {'axial_stiffness': (800.0,), 'free_length': (0.5,)},
            {'tendon_1_1': 30.0},
            1.8214,
        ),
    ],
)
def test_displacement_beyond_the_length_of_the_tendon_is_refused(
    name, changes, displacements, stretch
):
    config = load_config(name)
    arm = dataclasses.replace(config.arm, **changes)
    solver = dataclasses.replace(config, arm=arm).solver('exact')
    tendon, value = max(displacements.items(), key=lambda item: item[1])
    with pytest.raises(TensionError) as refusal:
        solve_displacements(solver, displacements)
    number = arm.tendon_names.index(tendon)
    length = solver.rest_lengths.ravel()[number]
    message = f'displacement of {tendon} is {value:g} m, expected less than there is to reel in: '
    assert str(refusal.value).startswith(f'{message}{length:.4g} m in the unloaded arm')
    assert solver.largest_displacements[number] - length == pytest.approx(stretch, rel=1e-3)
    assert (' that it stretches at most' in str(refusal.value)) == (stretch > 0.0)
    # Paying out the same length is no error: the tendon is slack.
    assert solve_displacements(solver, {tendon: -value}).slack == (tendon,)


@pytest.mark.parametrize('length', [5e305, '0.01', None, True])
def test_invalid_displacement_is_refused(solver, length):
    message = re.escape(f'displacement of tendon_1_1 is {length!r} m, expected a finite number')
    with pytest.raises(TensionError, match=message):
        solve_displacements(solver, {'tendon_1_1': length})


# Tendons that stretch ---------------------------------------------------------------------------


def stretching(arm: Arm, stiffness: float) -> Arm:
    """Return ``arm`` with tendons of an axial ``stiffness`` [N] and 0.5 m of free length."""
    return dataclasses.replace(arm, axial_stiffness=(stiffness,), free_length=(0.5,))


@settings(max_examples=15, deadline=None)
@given(arm=strategies.loaded_arms(2), stiffness=st.floats(1.0, 1e5))
def test_displacements_determine_the_tensions_of_any_arm(arm, stiffness):
    plain_arm, tensions = arm
    solver = Solver(stretching(plain_arm, stiffness), 'exact', 31)
    displacements = displacements_by_name(solver, solver.solve(tensions))
    wound = solve_displacements(solver, displacements)
    result = wound.displacement.ravel()
    assert_allclose(result, list(displacements.values()), atol=1e-9 * plain_arm.length)
    # Rounding of lengths times the stiffness of a tendon is an error of its tension.
    rounding, actual = 1e-14 * stiffness, wound.backbone.tensions
    # A tendon may stay slack if its stretch is below 1e-10 of the arm's length.
    expected = np.where((actual == 0.0) & (tensions <= 1e-10 * stiffness), 0.0, tensions)
    assert_allclose(actual, expected, atol=1e-9 * float(tensions.max()) + rounding)


@pytest.mark.parametrize('stiffness', [0.0, 500.0])
def test_slack_tendon_among_four_is_found(table2, stiffness):
    solver = Solver(stretching(table2.arm, stiffness), 'exact')
    tensions = np.zeros(table2.arm.tension_shape)
    tensions.flat[:4] = 0.4, 0.3, 0.0, 0.1
    displacements = dict(list(displacements_by_name(solver, solver.solve(tensions)).items())[:4])
    name = solver.arm.tendon_names[2]
    displacements[name] -= 3e-3
    wound = solve_displacements(solver, displacements)
    assert wound.slack == (name,)
    assert_allclose(wound.backbone.tensions, tensions, atol=1e-9)
    assert wound.displacement.flat[2] - displacements[name] == pytest.approx(3e-3, abs=1e-10)


@pytest.mark.parametrize('friction', [(), (0.1,)], ids=['smooth', 'rough'])
def test_all_solves_for_displacements_share_one_budget(table4, friction, monkeypatch):
    arm = dataclasses.replace(
        table4.arm.with_density(1080.0), axial_stiffness=(2000.0,), friction=friction
    )
    clock = iter(np.arange(0.0, 1e4, 1e-3))
    monkeypatch.setattr('octo_arm_model.arm.limits.time.monotonic', lambda: next(clock))
    displacements = dict.fromkeys(arm.tendon_names, 0.05)
    # The clock advances at every reading, so that a budget is a number of readings.
    solver = Solver(arm, 'exact', loads=IN_AIR, budget=Budget(seconds=0.0015))
    with pytest.raises(ContinuationError, match=r'spent (its|their) budget'):
        solve_displacements(solver, displacements)
    assert next(clock) < 0.01


def test_tendons_of_constant_length_prevent_buckling():
    # More than Euler's load of a clamped free rod, which tendons of constant length stiffen.
    body, sections = Body(0.3, 0.001, 0.001, disc_radius=0.01), (Section(0.3, 0.008, 0.008),)
    solver = Solver(Arm(Material(200e9, 0.3), body, sections), 'exact', material='linear')
    euler = math.pi**2 * 200e9 * math.pi * 0.001**4 / 4.0 / (4.0 * 0.3**2)
    wrench = (-1.2 * euler, 0.0, 0.0, 0.0, 0.0, 0.0)
    lengths = displacements_by_name(solver, solver.solve(np.full((1, 4), 2.0)))
    shape = solve_displacements(solver, lengths, tip_wrench=wrench).backbone
    assert np.hypot(*shape.tip[1:]) < 1e-6
    assert np.hypot(*solver.solve(shape.tensions, wrench).tip[1:]) > 0.1


# Derivatives where displacements do not determine every tension --------------------------------

GENTLE = np.array([[0.03, 0.01, 0.02, 0.015]])  # [N]


@pytest.fixture(scope='module', params=['closed_form', 'exact'])
def of_four(request, prototype):
    return prototype.solver(request.param)


def solve_at_lengths_of(of_four: Solver, tensions: np.ndarray) -> Wound:
    """Solve for the displacements that the four tendons have at ``tensions``."""
    return solve_displacements(of_four, displacements_by_name(of_four, of_four.solve(tensions)))


def test_derivatives_by_compatible_displacements_of_four_tendons(of_four):
    wound = solve_at_lengths_of(of_four, GENTLE)
    assert (wound.backbone.tensions > 0.0).all()
    sensitivity = wound_sensitivity(of_four, wound)

    def tip(x):
        return of_four.solve(x.reshape(1, 4)).tip

    def displacements(x):
        return displacements_of(of_four, of_four.solve(x.reshape(1, 4))).ravel()

    # Compatible displacements move the tip like the tensions that cause them. In closed_form a
    # change of tensions without a change of shape exists to 2e-5 only.
    steps = 4 * [1e-4]
    tensions = wound.backbone.tensions.ravel()
    analytic = sensitivity.by_displacement.tip[:3] @ jacobian(displacements, tensions, steps)
    expected = jacobian(tip, tensions, steps)
    assert_allclose(analytic, expected, rtol=0.0, atol=5e-5 * np.abs(expected).max())


def test_uncertainty_of_tensions_has_no_effect_on_tendons_given_by_displacement(of_four):
    taut = solve_at_lengths_of(of_four, GENTLE)
    names = of_four.arm.tendon_names
    slack = solve_displacements(of_four, {names[0]: 0.01, names[2]: -0.05}, {names[1]: 0.01})
    assert slack.slack == (names[2],)
    uncertainty = Uncertainty(tension=0.05)
    assert not wound_sensitivity(of_four, taut).tip_covariance(uncertainty).any()
    by_tension = wound_sensitivity(of_four, slack).held.by_tension
    is_given_by_tension = [not driven for driven in slack.driven]
    assert [bool(column.any()) for column in by_tension.tip.T] == is_given_by_tension


# With friction -----------------------------------------------------------------------------------


# The free length makes the tension at the base observable.
HELICAL = helical_arm(
    friction=(0.1, 0.2, 0.3, 0.1, 0.0, 0.2), axial_stiffness=(100.0,), free_length=(0.05,)
)


@pytest.mark.parametrize('mu', [0.0, 0.3])
def test_stretch_with_friction_equals_the_closed_form(mu):
    young, radius, length, offset, pull = 1e5, 0.01, 0.4, 0.006, 3.0
    axial_stiffness, free_length = 200.0, 0.5
    stretch = {'axial_stiffness': (axial_stiffness,), 'free_length': (free_length,)}
    arm = cylinder(length, radius, young, (0.0,), friction=(mu,), **stretch)
    solver = Solver(arm, 'exact', material='linear')
    backbone = solver.solve([[pull]])
    # T = 1 / (1 / T_0 + rate s), with the curvature T y / (E J) and the strain -T / (E A).
    area, rate = math.pi * radius**2, mu * offset / (young * math.pi * radius**4 / 4)
    integral = math.log1p(rate * pull * length) / rate if mu else pull * length
    shortening = integral * (offset**2 / (young * area * radius**2 / 4) + 1.0 / (young * area))
    expected = shortening + (integral + pull * free_length) / axial_stiffness
    assert displacements_of(solver, backbone).item() == pytest.approx(expected, rel=1e-8)
    wound = solve_displacements(solver, {'tendon_1_1': expected})
    assert wound.backbone.tensions.item() == pytest.approx(pull, rel=1e-7)


def test_displacements_determine_the_tensions_along_a_history():
    loads = Loads(gravity=(0.0, 0.0, -9.81))
    solver = Solver(HELICAL, 'exact', 11, loads=loads, accuracy=1e-11)
    shape, wound = solver.solve(PULL), solve_displacements(solver, {}, by_name(solver, PULL))
    # Unload, a little more, load again, and change tensions in different proportions.
    for factor in (0.9, 0.899, 0.5, 0.5005, np.linspace(0.6, 1.1, 6).reshape(2, 3)):
        shape = solver.follow(factor * PULL, shape)
        wound = solve_displacements(solver, displacements_by_name(solver, shape), start=wound)
        assert_allclose(wound.backbone.tensions, factor * PULL, rtol=0.0, atol=1e-7 * PULL.max())
        assert_allclose(wound.backbone.position, shape.position, atol=1e-8)
    # Without the history the same displacements need other tensions.
    fresh = solve_displacements(solver, displacements_by_name(solver, shape))
    assert np.abs(fresh.backbone.tensions - shape.tensions).max() > 1e-3


@settings(max_examples=6, deadline=None, derandomize=True)
@given(loaded_arms(2), fractions(0.01, 0.4), fractions(0.2, 0.9))
def test_displacements_of_any_arm_are_followed_with_friction(case, friction, factor):
    arm, tensions = case
    stiffness = 20.0 * float(np.max(tensions)) + 1.0
    arm = dataclasses.replace(arm, friction=(friction,), axial_stiffness=(stiffness,))
    solver = Solver(arm, 'exact', 41, material='linear', accuracy=1e-11)
    try:
        loaded = solver.solve(tensions)
        released = solver.follow(factor * tensions, loaded)
    except SolveError:
        assume(False)
    wound = solve_displacements(solver, {}, by_name(solver, tensions))
    for each in (loaded, released):
        wound = solve_displacements(solver, displacements_by_name(solver, each), start=wound)
        displacements = displacements_of(solver, each)
        assert_allclose(wound.displacement, displacements, rtol=0.0, atol=1e-9 * arm.length)
        # Displacements do not determine the tension of a tendon that sticks before its first
        # point, nor the bending up to there.
        assert_allclose(wound.backbone.position, each.position, rtol=0.0, atol=2e-5 * arm.length)
        scale = max(float(np.max(tensions)), 1e-6)
        assert_allclose(wound.backbone.tensions, each.tensions, atol=2e-2 * scale)


def test_derivatives_with_displacements_equal_finite_differences():
    loads = Loads(gravity=(0.0, 0.0, -9.81))
    arm = dataclasses.replace(HELICAL, sheath_stiffness=(5e5,), free_length=(0.1,))
    solver = Solver(arm, 'exact', 11, loads=loads)
    displacements = displacements_by_name(solver, solver.solve(PULL))
    first = displacements.pop('tendon_1_1')
    wound = solve_displacements(solver, displacements, {'tendon_1_1': PULL[0, 0]})
    sensitivity = wound_sensitivity(solver, wound)
    assert not sensitivity.by_displacement.tip[:, 0].any()
    assert not sensitivity.held.by_tension.tip[:, 1:].any() and first > 0.0
    changes = 0.01 * np.array([1.0, -0.5, 2.0, 1.0, -1.0])

    # Varies all inputs at once, without the history.
    without_history = dataclasses.replace(wound.backbone, point_tensions=None)
    first_guess = dataclasses.replace(wound, backbone=without_history)

    def tip_of(x):
        factor = 1.0 + x.item()
        young = factor * float(arm.material.youngs_modulus)
        changed_arm = dataclasses.replace(
            arm,
            friction=tuple(factor * np.array(arm.friction)),
            sheath_stiffness=tuple(factor * np.array(arm.sheath_stiffness)),
            material=dataclasses.replace(arm.material, youngs_modulus=young),
        )
        solver_ = Solver(changed_arm, 'exact', 11, loads=loads)
        tensions = {'tendon_1_1': factor * PULL[0, 0]}
        changed = zip(displacements.items(), x.item() * changes)
        lengths = {name: length + change for (name, length), change in changed}
        return solve_displacements(solver_, lengths, tensions, start=first_guess).backbone.tip

    analytic = (
        sensitivity.by_displacement.tip[:3, 1:] @ changes
        + sensitivity.held.by_youngs_modulus.tip[:3, 0]
        + sensitivity.held.by_friction.tip[:3] @ arm.friction
        + sensitivity.held.by_sheath_stiffness.tip[:3] @ arm.sheath_stiffness
        + sensitivity.held.by_tension.tip[:3, 0] * PULL[0, 0]
    )
    expected = jacobian(tip_of, np.zeros(1), 0.01)[:, 0]
    assert_allclose(analytic, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


def test_derivatives_of_a_sticking_tendon_are_refused():
    solver = Solver(HELICAL, 'exact', 11)
    wound = solve_displacements(solver, {}, by_name(solver, PULL))
    shorter = by_name(solver, 0.98 * displacements_of(solver, wound.backbone))
    released = solve_displacements(solver, shorter, start=wound)
    with pytest.raises(SolveError, match='no derivatives: with friction'):
        wound_sensitivity(solver, released)


# Cases with nearly incompatible lengths, a tendon that becomes slack first, or slip regions that
# grow past points of the arm.
REVERSALS = [('by tension', 27), ('by length', 23)]


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
@pytest.mark.parametrize('kind, seed', REVERSALS)
def test_inextensible_tendons_converge_after_random_reversals(table4, model, kind, seed):
    arm = dataclasses.replace(table4.arm, friction=(0.1,))
    solver = Solver(arm, model, 41)
    random = np.random.default_rng(seed)
    tensions = random.uniform(0.1, 1.0, (3, 4)) * np.array([[0.15], [1.0], [3.0]])
    wound = solve_displacements(solver, {}, by_name(solver, tensions))
    reversed_tensions = tensions * random.uniform(0.5, 1.2, (3, 4))
    lengths = displacements_of(solver, solver.follow(reversed_tensions, wound.backbone))
    if kind == 'by length':
        lengths = wound.displacement * random.uniform(0.9, 1.05, (3, 4))
    result = solve_displacements(solver, by_name(solver, lengths), start=wound)
    taut = result.backbone.tensions > 0.0
    errors = np.where(taut, result.displacement - lengths, 0.0)
    assert (result.displacement - lengths >= -1e-6 * arm.length).all()
    assert np.abs(errors).max() <= 1e-6 * arm.length
    # The sums of the lengths of opposite tendons are equal, for four parallel tendons.
    alternate = np.array([1.0, -1.0, 1.0, -1.0])
    compatible = errors - np.outer(errors @ alternate, alternate) / 4.0
    assert np.abs(compatible).max() <= 1e-8 * arm.length
