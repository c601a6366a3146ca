"""Tendons of prescribed displacement: the tensions that hold them, with friction too."""

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
from rods import PULL, helical_arm, tendon_points
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
from octo_arm_model.arm.errors import ContinuationError, ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Budget
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.rod.winch_equations import Tolerance, complementary_step

TENSIONS = 0.5 * np.array(FETCHING_IN_SPACE)
IN_AIR = Loads(gravity=(0.0, 0.0, -9.81))


@pytest.fixture(scope='module')
def solver(table4):
    return Solver(table4.arm, 'exact')


def by_name(solver: Solver, values: FloatArray) -> dict[str, float]:
    return dict(zip(solver.arm.tendon_names, values.ravel().tolist(), strict=True))


def reeled_in(solver: Solver, backbone: Backbone) -> dict[str, float]:
    """Displacement of every tendon [m], by name."""
    return by_name(solver, displacements_of(solver, backbone))


def test_lengths_are_those_of_polygons_through_the_tendons(solver, table4):
    fine = Solver(table4.arm, 'exact', 2001, material='linear')
    backbone = fine.solve(TENSIONS)
    lengths, paths = fine.tendon_lengths(backbone).ravel(), tendon_points(table4.arm, backbone)
    for tendon, section in enumerate(table4.arm.tendon_section):
        acts = backbone.s <= table4.arm.sections[section - 1].anchorage
        polygon = np.linalg.norm(np.diff(paths[tendon, acts], axis=0), axis=1).sum()
        # At an anchorage the strain jumps and the polygon with it: second order in the step.
        assert lengths[tendon] == pytest.approx(polygon, rel=2e-5)


def test_a_wound_tendon_meets_its_length_beside_others_held_by_tension(solver):
    wound = solve_displacements(
        solver, {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}, {'tendon_3_1': 1}
    )
    assert wound.displacement[0, 0] == pytest.approx(0.02, abs=1e-9)
    assert wound.displacement[1, 1] == pytest.approx(0.01, abs=1e-9)
    assert wound.backbone.tensions[2, 0] == 1.0
    assert wound.slack == ()
    assert np.count_nonzero(wound.backbone.tensions) == 3
    # A tendon that would have to push is slack.
    wound = solve_displacements(solver, {'tendon_1_1': -0.01}, {'tendon_3_1': 1.0})
    assert wound.slack == ('tendon_1_1',)
    assert wound.backbone.tensions[0, 0] == 0.0
    # Its path is shorter than the length paid out: it is slack.
    assert wound.displacement[0, 0] > -0.01
    alone = solver.solve([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]])
    assert_allclose(wound.backbone.tip, alone.tip, atol=1e-12)


@pytest.mark.parametrize(
    ('name', 'changes', 'asked', 'stretch'),
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
def test_a_displacement_longer_than_what_there_is_to_reel_in_is_told_as_that(
    name, changes, asked, stretch
):
    config = load_config(name)
    arm = dataclasses.replace(config.arm, **changes)
    solver = dataclasses.replace(config, arm=arm).solver('exact')
    tendon, value = max(asked.items(), key=lambda one: one[1])
    with pytest.raises(TensionError) as refusal:
        solve_displacements(solver, asked)
    number = arm.tendon_names.index(tendon)
    length = solver.rest_lengths.ravel()[number]
    told = f'displacement of {tendon} is {value:g} m, expected less than there is to reel in: '
    assert str(refusal.value).startswith(f'{told}{length:.4g} m in the unloaded arm')
    assert solver.largest_displacements[number] - length == pytest.approx(stretch, rel=1e-3)
    assert (' that it stretches at most' in str(refusal.value)) == (stretch > 0.0)
    # A length paid out is no such error: the tendon is slack.
    assert solve_displacements(solver, {tendon: -value}).slack == (tendon,)


@pytest.mark.parametrize('length', [5e305, '0.01', None, True])
def test_what_is_no_length_is_named(solver, length):
    said = re.escape(f'displacement of tendon_1_1 is {length!r} m, expected a finite number')
    with pytest.raises(TensionError, match=said):
        solve_displacements(solver, {'tendon_1_1': length})


# Tendons that stretch ---------------------------------------------------------------------------


def stretching(arm: Arm, stiffness: float) -> Arm:
    """The same arm on tendons of an axial ``stiffness`` [N], 0.5 m longer than the arm."""
    return dataclasses.replace(arm, axial_stiffness=(stiffness,), free_length=(0.5,))


@settings(max_examples=15, deadline=None)
@given(arm=strategies.loaded_arms(2), stiffness=st.floats(1.0, 1e5))
def test_tensions_come_back_of_any_arm(arm, stiffness):
    described, tensions = arm
    solver = Solver(stretching(described, stiffness), 'exact', 31)
    asked = reeled_in(solver, solver.solve(tensions))
    wound = solve_displacements(solver, asked)
    reached = wound.displacement.ravel()
    assert_allclose(reached, list(asked.values()), atol=1e-9 * described.length)
    # Lengths are rounded, which a tendon's own stiffness turns into newtons.
    rounding, found = 1e-14 * stiffness, wound.backbone.tensions
    # And a tendon stays slack where its length tells no more than 1e-10 of that of the arm.
    expected = np.where((found == 0.0) & (tensions <= 1e-10 * stiffness), 0.0, tensions)
    assert_allclose(found, expected, atol=1e-9 * float(tensions.max()) + rounding)


def test_lengths_and_tensions_without_names_are_refused(table4):
    solver = table4.solver('exact')
    with pytest.raises(TensionError, match='displacements are'):
        solve_displacements(solver, [0.01])
    with pytest.raises(TensionError, match='tensions are'):
        solve_displacements(solver, {'tendon_1_1': 0.01}, np.zeros((3, 4)))


@pytest.mark.parametrize('stiffness', [0.0, 500.0])
def test_one_slack_tendon_among_four_is_found(table2, stiffness):
    """Three hold the arm; the fourth is paid out by 3 mm more than it needs."""
    solver = Solver(stretching(table2.arm, stiffness), 'exact')
    tensions = np.zeros(table2.arm.tension_shape)
    tensions.flat[:4] = 0.4, 0.3, 0.0, 0.1
    asked = dict(list(reeled_in(solver, solver.solve(tensions)).items())[:4])
    name = solver.arm.tendon_names[2]
    asked[name] -= 3e-3
    wound = solve_displacements(solver, asked)
    assert wound.slack == (name,)
    assert_allclose(wound.backbone.tensions, tensions, atol=1e-9)
    assert wound.displacement.flat[2] - asked[name] == pytest.approx(3e-3, abs=1e-10)


@pytest.mark.parametrize('friction', [(), (0.1,)], ids=['smooth', 'rough'])
def test_the_solves_of_a_winding_have_the_time_of_one_budget_together(
    table4, friction, monkeypatch
):
    arm = dataclasses.replace(
        table4.arm.with_density(1080.0), axial_stiffness=(2000.0,), friction=friction
    )
    clock = iter(np.arange(0.0, 1e4, 1e-3))
    monkeypatch.setattr('octo_arm_model.arm.limits.time.monotonic', lambda: next(clock))
    reeled = dict.fromkeys(arm.tendon_names, 0.05)
    # Of a clock that ticks whenever it is looked at, a budget is an exact number of looks.
    solver = Solver(arm, 'exact', loads=IN_AIR, budget=Budget(seconds=0.0015))
    with pytest.raises(ContinuationError, match=r'spent (its|their) budget'):
        solve_displacements(solver, reeled)
    assert next(clock) < 0.01


def test_an_arm_that_buckles_under_tension_is_held_by_lengths():
    # Under more than Euler's load of a clamped free rod, which tendons of held lengths stiffen.
    body, sections = Body(0.3, 0.001, 0.001, disc_radius=0.01), (Section(0.3, 0.008, 0.008),)
    solver = Solver(Arm(Material(200e9, 0.3), body, sections), 'exact', material='linear')
    euler = math.pi**2 * 200e9 * math.pi * 0.001**4 / 4.0 / (4.0 * 0.3**2)
    wrench = (-1.2 * euler, 0.0, 0.0, 0.0, 0.0, 0.0)
    lengths = reeled_in(solver, solver.solve(np.full((1, 4), 2.0)))
    held = solve_displacements(solver, lengths, tip_wrench=wrench).backbone
    assert np.hypot(*held.tip[1:]) < 1e-6
    assert np.hypot(*solver.solve(held.tensions, wrench).tip[1:]) > 0.1


# Derivatives where displacements do not say what every tension is -----------------------------

GENTLE = np.array([[0.03, 0.01, 0.02, 0.015]])  # [N]


@pytest.fixture(scope='module', params=['closed_form', 'exact'])
def of_four(request, prototype):
    return prototype.solver(request.param)


def wound_as(of_four: Solver, tensions: np.ndarray) -> Wound:
    """The arm whose four tendons are held at the lengths that they have under ``tensions``."""
    return solve_displacements(of_four, reeled_in(of_four, of_four.solve(tensions)))


def test_four_taut_tendons_of_a_section_that_deforms_in_three_ways(of_four):
    wound = wound_as(of_four, GENTLE)
    assert (wound.backbone.tensions > 0.0).all()
    found = wound_sensitivity(of_four, wound)

    def tip(x):
        return of_four.solve(x.reshape(1, 4)).tip

    def displacements(x):
        return displacements_of(of_four, of_four.solve(x.reshape(1, 4))).ravel()

    # Displacements that agree move the tip as the tensions do that they come of; closed_form has
    # an energy, and so a change of tensions that changes no shape, to 2e-5 only.
    steps = 4 * [1e-4]
    at = wound.backbone.tensions.ravel()
    moved = found.by_displacement.tip[:3] @ jacobian(displacements, at, steps)
    expected = jacobian(tip, at, steps)
    assert_allclose(moved, expected, rtol=0.0, atol=5e-5 * np.abs(expected).max())


def test_how_well_tensions_are_known_says_nothing_of_tendons_driven_by_length(of_four):
    """Of slack ones neither: what they hold follows from their displacements."""
    taut = wound_as(of_four, GENTLE)
    names = of_four.arm.tendon_names
    slack = solve_displacements(of_four, {names[0]: 0.01, names[2]: -0.05}, {names[1]: 0.01})
    assert slack.slack == (names[2],)
    known = Uncertainty(tension=0.05)
    assert not wound_sensitivity(of_four, taut).tip_covariance(known).any()
    found = wound_sensitivity(of_four, slack).held.by_tension
    given = [not driven for driven in slack.driven]
    assert [bool(column.any()) for column in found.tip.T] == given


def test_a_tendon_that_slackens_as_it_is_reeled_in_has_no_tension():
    one, tolerance = np.ones(1), Tolerance.of(1.0, has_friction=False)
    with pytest.raises(ConvergenceError, match='the displacement of the tendons'):
        complementary_step(-np.eye(1), one, 0.0 * one, one > 0.0, tolerance)


# With friction -----------------------------------------------------------------------------------


# Without a part that is free of friction the tension at the base itself stretches nothing.
HELICAL = helical_arm(
    friction=(0.1, 0.2, 0.3, 0.1, 0.0, 0.2), axial_stiffness=(100.0,), free_length=(0.05,)
)


@pytest.mark.parametrize('mu', [0.0, 0.3])
def test_a_tendon_stretches_by_its_tension_at_every_station(mu):
    young, radius, length, offset, pull = 1e5, 0.01, 0.4, 0.006, 3.0
    stretching, free = 200.0, 0.5
    arm = Arm(
        Material(young, 0.5),
        Body(length, radius, radius),
        (Section(length, offset, offset, angles=(0.0,)),),
        friction=(mu,),
        axial_stiffness=(stretching,),
        free_length=(free,),
    )
    solver = Solver(arm, 'exact', material='linear')
    backbone = solver.solve([[pull]])
    # T = 1 / (1 / T_0 + rate s), and the arm bends by T y / (E J) and is compressed by T / (E A).
    area, rate = math.pi * radius**2, mu * offset / (young * math.pi * radius**4 / 4)
    integral = math.log1p(rate * pull * length) / rate if mu else pull * length
    shorter = integral * (offset**2 / (young * area * radius**2 / 4) + 1.0 / (young * area))
    expected = shorter + (integral + pull * free) / stretching
    assert displacements_of(solver, backbone).item() == pytest.approx(expected, rel=1e-8)
    wound = solve_displacements(solver, {'tendon_1_1': expected})
    assert wound.backbone.tensions.item() == pytest.approx(pull, rel=1e-7)


def test_they_are_along_a_history_too():
    solver = Solver(HELICAL, 'exact', 11, loads=Loads(gravity=(0.0, 0.0, -9.81)))
    pulled, wound = solver.solve(PULL), solve_displacements(solver, {}, by_name(solver, PULL))
    # Let out, a little more, drawn in again, and some of them more than others.
    for part in (0.9, 0.899, 0.5, 0.5005, np.linspace(0.6, 1.1, 6).reshape(2, 3)):
        pulled = solver.follow(part * PULL, pulled)
        wound = solve_displacements(solver, reeled_in(solver, pulled), start=wound)
        assert_allclose(wound.backbone.tensions, part * PULL, rtol=0.0, atol=1e-7 * PULL.max())
        assert_allclose(wound.backbone.position, pulled.position, atol=1e-8)
    # Without the history the same lengths need other tensions.
    fresh = solve_displacements(solver, reeled_in(solver, pulled))
    assert np.abs(fresh.backbone.tensions - pulled.tensions).max() > 1e-3


@settings(max_examples=6, deadline=None, derandomize=True)
@given(loaded_arms(2), fractions(0.01, 0.4), fractions(0.2, 0.9))
def test_any_stretching_arm_follows_its_lengths(case, friction, part):
    arm, tensions = case
    stiffness = 20.0 * float(np.max(tensions)) + 1.0
    arm = dataclasses.replace(arm, friction=(friction,), axial_stiffness=(stiffness,))
    solver = Solver(arm, 'exact', 41, material='linear')
    try:
        pulled = solver.solve(tensions)
        released = solver.follow(part * tensions, pulled)
    except SolveError:
        assume(False)
    wound = solve_displacements(solver, {}, by_name(solver, tensions))
    for each in (pulled, released):
        wound = solve_displacements(solver, reeled_in(solver, each), start=wound)
        reeled = displacements_of(solver, each)
        assert_allclose(wound.displacement, reeled, rtol=0.0, atol=1e-9 * arm.length)
        # Lengths do not tell by which tension a tendon sticks before it slips at the first point,
        # and so not how it bends the arm up to there.
        assert_allclose(wound.backbone.position, each.position, rtol=0.0, atol=2e-5 * arm.length)
        scale = max(float(np.max(tensions)), 1e-6)
        assert_allclose(wound.backbone.tensions, each.tensions, atol=2e-2 * scale)


def test_derivatives_with_displacements_held_are_those_of_differences():
    loads = Loads(gravity=(0.0, 0.0, -9.81))
    arm = dataclasses.replace(HELICAL, sheath_stiffness=(5e5,), free_length=(0.1,))
    solver = Solver(arm, 'exact', 11, loads=loads)
    whole = reeled_in(solver, solver.solve(PULL))
    first = whole.pop('tendon_1_1')
    wound = solve_displacements(solver, whole, {'tendon_1_1': PULL[0, 0]})
    found = wound_sensitivity(solver, wound)
    assert not found.by_displacement.tip[:, 0].any()
    assert not found.held.by_tension.tip[:, 1:].any() and first > 0.0
    reeled = 0.01 * np.array([1.0, -0.5, 2.0, 1.0, -1.0])

    # Everything at once, without the history.
    alone = dataclasses.replace(wound.backbone, point_tensions=None)
    at_once = dataclasses.replace(wound, backbone=alone)

    def tip_of(x):
        part = 1.0 + x.item()
        young = part * float(arm.material.youngs_modulus)
        moved = dataclasses.replace(
            arm,
            friction=tuple(part * np.array(arm.friction)),
            sheath_stiffness=tuple(part * np.array(arm.sheath_stiffness)),
            material=dataclasses.replace(arm.material, youngs_modulus=young),
        )
        own = Solver(moved, 'exact', 11, loads=loads)
        given = {'tendon_1_1': part * PULL[0, 0]}
        moves = zip(whole.items(), x.item() * reeled)
        lengths = {name: length + more for (name, length), more in moves}
        return solve_displacements(own, lengths, given, start=at_once).backbone.tip

    got = (
        found.by_displacement.tip[:3, 1:] @ reeled
        + found.held.by_youngs_modulus.tip[:3, 0]
        + found.held.by_friction.tip[:3] @ arm.friction
        + found.held.by_sheath_stiffness.tip[:3] @ arm.sheath_stiffness
        + found.held.by_tension.tip[:3, 0] * PULL[0, 0]
    )
    expected = jacobian(tip_of, np.zeros(1), 0.01)[:, 0]
    assert_allclose(got, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


def test_where_a_tendon_sticks_derivatives_are_refused():
    solver = Solver(HELICAL, 'exact', 11)
    wound = solve_displacements(solver, {}, by_name(solver, PULL))
    less = {name: 0.98 * length for name, length in reeled_in(solver, wound.backbone).items()}
    released = solve_displacements(solver, less, start=wound)
    with pytest.raises(SolveError, match='no derivatives: with friction'):
        wound_sensitivity(solver, released)


# The lengths of these contradicted each other by less than tensions can tell, a tendon had to get
# slack first, or the slipping part of many grew past points of the arm.
REVERSALS = [('by tension', 27), ('by length', 23)]


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
@pytest.mark.parametrize('kind, seed', REVERSALS)
def test_tendons_that_do_not_stretch_are_reversed_at_random(table4, model, kind, seed):
    arm = dataclasses.replace(table4.arm, friction=(0.1,))
    solver = Solver(arm, model, 41)
    random = np.random.default_rng(seed)
    tensions = random.uniform(0.1, 1.0, (3, 4)) * np.array([[0.15], [1.0], [3.0]])
    wound = solve_displacements(solver, {}, by_name(solver, tensions))
    reversed_tensions = tensions * random.uniform(0.5, 1.2, (3, 4))
    lengths = displacements_of(solver, solver.follow(reversed_tensions, wound.backbone))
    if kind == 'by length':
        lengths = wound.displacement * random.uniform(0.9, 1.05, (3, 4))
    found = solve_displacements(solver, by_name(solver, lengths), start=wound)
    taut = found.backbone.tensions > 0.0
    lacking = np.where(taut, found.displacement - lengths, 0.0)
    assert (found.displacement - lengths >= -1e-6 * arm.length).all()
    assert np.abs(lacking).max() <= 1e-6 * arm.length
    # Four parallel tendons of an arm have lengths of which two together are the other two.
    alternate = np.array([1.0, -1.0, 1.0, -1.0])
    agreeing = lacking - np.outer(lacking @ alternate, alternate) / 4.0
    assert np.abs(agreeing).max() <= 1e-8 * arm.length
