"""Friction and sheaths of tendons: closed forms, least energy, hysteresis and derivatives."""

import dataclasses
import math

import numpy as np
import pytest
import reference_exact
import rods
from differences import along
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from rods import PULL, helical_arm
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize
from scipy.spatial.transform import Rotation
from strategies import fractions, loaded_arms

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    ConfigError,
    Loads,
    Material,
    Section,
    SolveError,
    Solver,
    TipPosition,
    find_tensions,
    load_config,
)
from octo_arm_model.arm.stiffness import estimate_sheath_stiffness
from octo_arm_model.rod.elements import LEVELS

MODELS = ('closed_form', 'exact')
YOUNG, RADIUS, LENGTH, OFFSET, MU = 1e5, 0.01, 0.4, 0.006, 0.3
BENDING = YOUNG * math.pi * RADIUS**4 / 4
GRAVITY = Loads(gravity=(0.0, 0.0, -9.81))
IN_WATER = dataclasses.replace(GRAVITY, fluid_density=1000.0)


def uniform(angles: tuple[float, ...] = (0.0,), friction: float = MU) -> Arm:
    """Return a cylinder with parallel tendons at ``angles``."""
    return rods.cylinder(LENGTH, RADIUS, YOUNG, angles, friction=(friction,))


# The law in closed form -------------------------------------------------------------------------


@pytest.mark.parametrize('pull', [0.01, 0.3, 3.0])
@pytest.mark.parametrize('friction', [0.05, 0.3, 1.0])
def test_one_parallel_tendon_equals_the_closed_form(pull, friction):
    solver = Solver(uniform(friction=friction), 'exact', material='linear')
    backbone = solver.solve([[pull]])
    slope = friction * OFFSET / BENDING
    tension = 1.0 / (1.0 / pull + slope * backbone.s)
    # The error of tensions (`rod._TENSION_ERROR`) is 4e-7 for the largest tension and friction,
    # 1e-7 otherwise.
    assert_allclose(backbone.tendon_tensions[:, 0], tension, rtol=1e-6)
    per_reference_length = backbone.k * (1.0 + backbone.q)
    assert_allclose(per_reference_length, tension * OFFSET / BENDING, rtol=1e-6)
    angle = math.log(1.0 + slope * pull * LENGTH) / friction
    x, y, _ = Rotation.from_quat(backbone.quaternion[-1]).apply([1.0, 0.0, 0.0])
    assert math.remainder(math.atan2(y, x) - angle, math.tau) == pytest.approx(0.0, abs=1e-6)
    tip_tension = pull * math.exp(-friction * angle)
    assert backbone.tendon_tensions[-1, 0] == pytest.approx(tip_tension, rel=1e-8)


def test_tension_in_closed_form_obeys_its_differential_equation():
    def slope(s, tension):
        bend = tension * OFFSET / (BENDING + tension * OFFSET**2)
        stretch = 1.0 + (bend * tension * OFFSET - tension) / (YOUNG * math.pi * RADIUS**2)
        return -MU * tension * bend * stretch

    backbone = Solver(uniform(), 'closed_form').solve([[1.0]])
    expected = solve_ivp(slope, (0.0, LENGTH), [1.0], t_eval=backbone.s, rtol=1e-11, atol=1e-13).y[
        0
    ]
    assert_allclose(backbone.tendon_tensions[:, 0], expected, rtol=1e-9)


@pytest.mark.parametrize('model', MODELS)
def test_zero_and_tiny_friction_equal_no_friction(model):
    without, zero = helical_arm(), helical_arm(friction=(0.0,))
    assert zero == without
    assert zero.friction == ()
    plain = Solver(without, model).solve(PULL)
    again = Solver(zero, model).solve(PULL)
    assert_allclose(again.position, plain.position, rtol=0.0, atol=1e-12)
    little = Solver(helical_arm(friction=(1e-11,)), model).solve(PULL)
    assert_allclose(little.position, plain.position, atol=2e-10)
    assert_allclose(little.tendon_tensions, plain.tendon_tensions, atol=1e-10)
    # Without friction the tension is constant from the base to the anchorage.
    inside = plain.s[:, np.newaxis] <= np.repeat([0.4, 0.25], 3)
    assert_array_equal(plain.tendon_tensions, PULL.ravel() * inside)


def test_converging_tendon_loses_tension_at_the_anchorage_of_another():
    # The arm is straight, with more compression up to 0.2 m, so that the slopes of the long
    # tendons to the midline jump there.
    ring = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
    sections = (Section(0.4, 0.008, 0.002, ring), Section(0.2, 0.005, 0.005, ring))
    arm = Arm(Material(YOUNG, 0.5), Body(0.4, 0.01, 0.01), sections, friction=8 * (MU,))
    solver = Solver(arm, 'exact', material='linear')
    backbone = solver.solve(np.repeat([[0.5], [2.0]], 4, axis=1))
    stretch = 1.0 + backbone.q[backbone.s != 0.2][[0, -1]]
    before, after = np.arctan(0.015 / stretch)
    expected = 0.5 * math.exp(-MU * (before - after))
    assert before - after > 1e-3
    assert_allclose(backbone.tendon_tensions[-1, :4], expected, rtol=1e-6)


@settings(max_examples=20, deadline=None)
@given(loaded_arms(3), fractions(0.01, 0.6), st.sampled_from(MODELS))
def test_tension_falls_with_the_angle_of_the_tendon(case, friction, model):
    arm, tensions = case
    with_friction = dataclasses.replace(arm, friction=(friction,))
    try:
        backbone = Solver(with_friction, model, 801, material='linear').solve(tensions)
    except SolveError:
        assume(False)
    local, paths = backbone.tendon_tensions, rods.tendon_points(arm, backbone)
    assert (np.diff(local, axis=0) <= 1e-9 * np.maximum(tensions.ravel(), 1e-3)).all()
    for j, pull in enumerate(tensions.ravel()):
        inside = local[:, j] > 0.0
        inside[1:] &= np.diff(backbone.s) > 1e-9  # an anchorage can be next to the tip
        if not pull or np.count_nonzero(inside) < 10:
            continue
        chords = np.diff(paths[j, inside], axis=0)
        chords /= np.linalg.norm(chords, axis=1)[:, np.newaxis]
        # From the midpoint of the first interval to that of the last.
        angle = np.linalg.norm(np.diff(chords, axis=0), axis=1).sum()
        ends = local[inside, j]
        middle = 0.5 * (ends[:-1] + ends[1:])
        logarithm = math.log(middle[0] / middle[-1])
        assert logarithm == pytest.approx(friction * angle, rel=0.02, abs=2e-3)


# History ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('model', MODELS)
def test_small_unloading_changes_only_the_arm_near_its_base(model):
    solver = Solver(uniform(), model, 401)
    pulled = solver.solve([[1.0]])
    decrease = 0.05
    released = solver.follow([[1.0 - decrease]], pulled)
    before, after = pulled.tendon_tensions[:, 0], released.tendon_tensions[:, 0]
    # The tendon slips back over the angle in which its tension rises to its value before.
    angle = np.log(1.0 / before) / MU
    slip_angle = -math.log(1.0 - decrease) / (2.0 * MU)
    sticks = angle > 1.1 * slip_angle
    assert 0.5 < np.count_nonzero(sticks) / sticks.size < 0.99
    assert_allclose(after[sticks], before[sticks], rtol=3e-3)
    assert_allclose(released.k[sticks], pulled.k[sticks], rtol=3e-3)
    slips = angle < 0.9 * slip_angle
    angles = np.cumsum([0.0, *(0.5 * (released.k[1:] + released.k[:-1]) * np.diff(released.s))])
    assert (after[slips] < before[slips]).all()
    if model == 'exact':
        return  # there the tangent turns by k (1 + q) per reference length
    assert_allclose(after[slips], (1.0 - decrease) * np.exp(MU * angles[slips]), rtol=5e-3)


def test_tension_let_out_to_a_half_equals_the_closed_form():
    # On a metal rod; the tension has a kink where the tendon begins to stick.
    section = Section(0.5, 0.014, 0.014, angles=(0.0,))
    body = Body(0.5, 0.0016, 0.0016, disc_radius=0.03)
    arm = Arm(Material(2e9, 0.3), body, (section,), friction=(MU,))
    solver = Solver(arm, 'exact', material='linear', accuracy=1e-9)
    pulled = solver.solve([[24.0]])
    released = solver.follow([[12.0]], pulled)
    slope = MU * 0.014 / (2e9 * math.pi * 0.0016**4 / 4) * released.s
    let_out = 1.0 / np.maximum(1.0 / 12.0 - slope, 1.0 / 24.0)
    expected = np.minimum(1.0 / (1.0 / 24.0 + slope), let_out)
    assert_allclose(released.tendon_tensions[:, 0], expected, rtol=0.0, atol=2e-4)
    # A slack tendon has no kink, so that coarse nodes serve again.
    pulled_again = solver.follow([[1.0]], solver.follow([[0.0]], released))
    assert pulled_again.equilibrium.level < released.equilibrium.level
    assert_allclose(pulled_again.tip, solver.solve([[1.0]]).tip, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize(('model', 'loads'), [('closed_form', Loads()), ('exact', GRAVITY)])
def test_hysteresis_loop_closes_and_has_an_area(model, loads):
    arm = helical_arm(friction=(0.2,))
    solver = Solver(arm, model, loads=loads)
    high, low = PULL, 0.4 * PULL
    loops = [[], [], []]
    first = last = solver.follow(high, None)
    assert_allclose(last.tip, solver.solve(high).tip, atol=1e-12)
    falling = [high + tolerance * (low - high) for tolerance in (0.5, 1.0)]
    rising = [low + tolerance * (high - low) for tolerance in (0.5, 1.0)]
    for loop in loops:
        for tensions in falling + rising:
            last = solver.follow(tensions, last)
            loop.append(last)
    # The first loop may use fewer nodes, with slightly other points where a tendon sticks.
    for shapes, next_shapes, tolerance in ((loops[0], loops[1], 5e-6), (loops[1], loops[2], 1e-7)):
        for before, after in zip(shapes, next_shapes):
            assert_allclose(before.position, after.position, rtol=0.0, atol=tolerance * arm.length)
            assert_allclose(
                before.tendon_tensions, after.tendon_tensions, rtol=0.0, atol=100.0 * tolerance
            )
    assert_allclose(loops[-1][-1].tip, first.tip, atol=1e-7 * arm.length)
    # The same tensions give different shapes when they rise and when they fall.
    assert np.linalg.norm(loops[-1][0].tip - loops[-1][2].tip) > 2e-3 * arm.length


def test_a_course_of_tensions_takes_few_nodes():
    # The course turns back, so that tensions along the tendons have kinks.
    arm = load_config('renda2012_table4').arm.with_density(1080.0)
    arm = dataclasses.replace(arm, friction=(0.2,))
    quick, exact = (
        Solver(arm, 'exact', 11, loads=IN_WATER, accuracy=accuracy) for accuracy in (1e-8, 1e-11)
    )
    pull = np.random.default_rng(5).uniform(0.2, 1.0, (3, 4)) * [[0.2], [1.0], [3.0]]
    shape, reference, levels = None, None, []
    for factor in (0.5, 1.0, 0.9, 0.6, 0.8, 0.3, 0.7):
        tensions = factor * pull
        shape, reference = quick.follow(tensions, shape), exact.follow(tensions, reference)
        assert_allclose(shape.position, reference.position, rtol=0.0, atol=3e-5 * arm.length)
        levels.append((shape.equilibrium.level, reference.equilibrium.level))
    assert max(level for level, _ in levels) <= 1
    assert max(level for _, level in levels) == len(LEVELS) - 1


def test_solve_does_not_depend_on_a_history():
    solver = Solver(uniform(), 'exact')
    fresh = solver.solve([[0.6]])
    released = solver.follow([[0.6]], solver.solve([[1.0]]))
    assert_allclose(solver.solve([[0.6]]).position, fresh.position, rtol=0, atol=1e-12)
    assert np.linalg.norm(released.tip - fresh.tip) > 0.01
    started = solver.solve([[0.6]], start=solver.solve([[1.0]]))
    assert_allclose(started.position, fresh.position, rtol=0.0, atol=1e-12)


def test_following_the_same_tensions_changes_nothing():
    section = Section(1.0, 0.0635, 0.014)
    arm = Arm(Material(1e4, 0.0), Body(1.0, 0.078, 0.056), (section,), friction=(0.25,))
    solver = Solver(arm, 'exact', material='linear')
    pulled = solver.solve([[0.0, 0.0, 21.7, 8.7]])
    assert_allclose(solver.follow(pulled.tensions, pulled).position, pulled.position, atol=1e-12)


@pytest.mark.parametrize('loads', [Loads(), Loads(tip_force=(0.01, 0.0, 0.0))])
def test_history_of_another_solver_is_refused(loads):
    solver = Solver(uniform(), 'exact', loads=loads)
    last = solver.solve([[1.0]])
    other = dataclasses.replace(last, point_tensions=np.ones((1, 7)))
    with pytest.raises(ConfigError, match='by another solver'):
        solver.follow([[0.9]], other)


def test_batch_with_friction_equals_single_solves():
    for model, loads in (('closed_form', Loads()), ('exact', GRAVITY)):
        solver = Solver(helical_arm(friction=(MU,)), model, loads=loads)
        several = np.stack([PULL, 0.1 * PULL, 0.0 * PULL])
        batch = solver.solve(several)
        last = solver.solve(1.2 * PULL)
        followed = solver.follow(several, last)
        assert batch.tendon_tensions.shape == (3, batch.s.size, 6)
        for number, tensions in enumerate(several):
            for shape, one in (
                (batch, solver.solve(tensions)),
                (followed, solver.follow(tensions, last)),
            ):
                assert_allclose(shape.position[number], one.position, atol=1e-10)
                assert_allclose(shape.tendon_tensions[number], one.tendon_tensions, atol=1e-9)


# Derivatives ------------------------------------------------------------------------------------


def test_derivatives_of_closed_form_equal_finite_differences():
    friction, young = np.linspace(0.05, 0.4, 6), float(rods.RUBBER.youngs_modulus)
    solver = Solver(helical_arm(friction=tuple(friction)), 'closed_form', 41)
    by = solver.sensitivity(solver.solve(PULL))
    # Varies all inputs at once, in different proportions.
    pull, rub = 5e-3 * np.arange(-2.0, 4.0), 5e-3 * np.array([1.0, -0.5, 0.3, -1.0, 0.8, 0.2])
    parts = ((by.by_tension, pull), (by.by_youngs_modulus, [1e-3]), (by.by_friction, rub))

    def outcome(factor):
        arm = helical_arm(friction=tuple(friction + factor * rub))
        material = dataclasses.replace(arm.material, youngs_modulus=young * (1 + 1e-3 * factor[0]))
        solver_ = Solver(dataclasses.replace(arm, material=material), 'closed_form', 41)
        shape = solver_.solve(PULL + (factor * pull).reshape(2, 3))
        strains = np.stack([shape.tau, shape.xi, shape.k, shape.q], axis=1)
        lengths = solver_.tendon_lengths(shape).ravel()
        return np.concatenate([shape.position.ravel(), strains.ravel(), lengths])

    expected = along(outcome, np.zeros(1), np.ones(1))
    position = sum(change.pose[:, :3] @ step for change, step in parts)
    strain = sum(change.strain @ step for change, step in parts)
    length = sum(change.tendon_length @ step for change, step in parts)
    for actual, reference in zip((position, strain, length), np.split(expected, [123, 287])):
        assert_allclose(np.ravel(actual), reference, atol=1e-5 * np.abs(reference).max())


@pytest.mark.parametrize('model', MODELS)
def test_derivatives_after_unloading_equal_finite_differences(model):
    solver = Solver(helical_arm(friction=(0.03,)), model, 41)
    pulled = solver.solve(2.0 * PULL)
    released = solver.follow(PULL, pulled)
    assert (np.diff(released.tendon_tensions[released.s < 0.25], axis=0) >= -1e-12).all()
    step = 2e-3 * np.array([1.0, -0.5, 0.7, -1.0, 0.3, -0.8])
    columns = solver.sensitivity(released).by_tension.tip[:3]
    expected = along(lambda x: solver.follow(x.reshape(2, 3), pulled).tip, PULL.ravel(), step)
    atol = 2e-6 * (np.abs(columns) @ np.abs(step)).max()
    assert_allclose(columns @ step, expected, rtol=0.0, atol=atol)


@pytest.mark.parametrize('model', MODELS)
def test_derivatives_of_sticking_and_straight_tendons_are_refused(model):
    solver = Solver(uniform(), model)
    part = solver.follow([[0.9]], solver.solve([[1.0]]))
    with pytest.raises(SolveError, match=r'friction, tendon_1_1 of 0\.9 N sticks'):
        solver.sensitivity(part)
    both = Solver(uniform((0.0, math.pi)), model)
    # Opposite parallel tendons of equal tension stay straight and have no friction.
    straight = both.solve([[2.0, 2.0]])
    assert_allclose(straight.position[:, 1:], 0.0, atol=1e-12)
    assert_allclose(straight.tendon_tensions, 2.0, rtol=1e-12)
    with pytest.raises(SolveError, match='tendon_1_1 of 2 N is straight'):
        both.sensitivity(straight)
    # Slack tendons have derivatives.
    assert np.isfinite(both.sensitivity(both.solve([[0.0, 0.0]])).by_tension.tip).all()


@pytest.mark.parametrize('model', MODELS)
def test_find_tensions_works_with_friction(model):
    solver = Solver(uniform((0.0, 2.0, 4.0), 0.2), model, 31)
    goal = solver.solve([[0.5, 0.3, 0.0]]).tip
    result = find_tensions(solver, TipPosition(tuple(goal)), 2.0)
    assert_allclose(solver.solve(result.backbone.tensions).tip, goal, atol=1e-6)


# In sheaths --------------------------------------------------------------------------------------


SHEATH = 1.5e5
SHEATHED = dataclasses.replace(uniform(), sheath_stiffness=(SHEATH,))
# One tendon has no friction, and one has a rigid sheath.
IN_SHEATHS = helical_arm(
    Material(1.1e5, 0.5, 1080.0),
    friction=(0.1, 0.2, 0.3, 0.1, 0.0, 0.2),
    sheath_stiffness=(3e5, 5e5, 0.0, 4e5, 2e5, 6e5),
)


@pytest.mark.parametrize('pull', [0.1, 1.0, 4.0])
def test_tendon_in_a_sheath_equals_the_closed_form(pull):
    # The tendon is displaced by T kappa / k, so that E J kappa = T (y + T kappa / k), and
    # T' = -mu T kappa is separable.
    def passed(tension):
        """Return the arc coordinate at which the tension has fallen to ``tension`` [m]."""
        bent = BENDING * (1.0 / tension - 1.0 / pull) - (pull - tension) / SHEATH
        return bent / (MU * OFFSET)

    backbone = Solver(SHEATHED, 'exact', material='linear').solve([[pull]])
    expected = np.array([brentq(lambda t: passed(t) - s, 1e-3, pull) for s in backbone.s])
    assert_allclose(backbone.tendon_tensions[:, 0], expected, rtol=1e-7)
    bent = expected * OFFSET / (BENDING - expected**2 / SHEATH)
    assert_allclose(backbone.k * (1.0 + backbone.q), bent, rtol=1e-6)


@pytest.mark.parametrize('loads', [Loads(), GRAVITY], ids=['free', 'under gravity'])
def test_rigid_sheaths_and_zero_friction_are_limits_of_both(loads):
    def tip(**changes):
        arm = dataclasses.replace(IN_SHEATHS, **changes)
        return Solver(arm, 'exact', loads=loads).solve(PULL).tip

    both = tip()
    friction_only, sheaths_only = tip(sheath_stiffness=()), tip(friction=())
    assert min(np.linalg.norm(both - friction_only), np.linalg.norm(both - sheaths_only)) > 1e-4
    assert_allclose(tip(sheath_stiffness=(1e14,)), friction_only, atol=1e-8)
    assert_allclose(tip(friction=(1e-10,)), sheaths_only, atol=1e-8)


# Sheaths -----------------------------------------------------------------------------------------


RUBBER = Material(1.1e5, 0.5, 1080.0)
SHEAR_MODULUS = 1.1e5 / 3.0


@pytest.mark.parametrize('s', [0.1, 0.3])
def test_strains_have_the_least_energy_over_strains_and_tendon_positions(s):
    # A general optimiser of all unknowns. Its sheaths have equal stiffness, none is rigid.
    arm = helical_arm(RUBBER, sheath_stiffness=(3e5,))
    backbone = Solver(arm, 'exact', 41).solve(PULL)
    i = int(np.argmin(np.abs(backbone.s - s)))
    stretch = 1.0 + backbone.q[i]
    strains = np.array([backbone.tau[i], backbone.xi[i], backbone.k[i]]) * stretch
    cut = reference_exact.Cut(
        arm, backbone.s[i], reference_exact.active_at(arm, backbone.s[i]), PULL, 'neo_hookean'
    )
    positions, units = cut.r, np.concatenate([[10.0, 10.0, 10.0, 0.1], np.full(12, 1e-3)])

    def scaled(x):
        offsets = (units * x)[4:].reshape(6, 2).T[:, : positions.shape[1]]
        cut.r = positions + np.pad(offsets, [(1, 0), (0, 0)])[..., np.newaxis]
        section_energy = cut.energy((units * x)[:4, np.newaxis]).item()
        return section_energy + 0.5 * 3e5 * float((offsets**2).sum())

    start = np.zeros(16)
    start[3] = 10.0
    result = minimize(scaled, start, method='BFGS', options={'gtol': 1e-9, 'maxiter': 2000})
    optimum = (units * result.x)[:4]
    assert_allclose(optimum[:3], strains, atol=2e-4 * np.abs(strains).max())
    assert optimum[3] == pytest.approx(stretch, abs=2e-5)
    assert np.abs(result.x[4:]).max() > 0.01  # tendons move by more than 10 micrometres


def test_soft_sheaths_with_friction_do_not_converge(table4):
    arm = table4.arm.with_density(1080.0)
    arm = dataclasses.replace(arm, friction=(0.1,), sheath_stiffness=(2e4,))
    solver = Solver(arm, 'exact', loads=Loads((0.0, 0.0, -9.81), 1000.0))
    with pytest.raises(SolveError, match='did not converge'):
        solver.solve([[0.0, 0.0, 0.5, 0.0], [4.0, 0.0, 0.0, 0.0], [0.0, 8.0, 0.0, 0.0]])


def test_estimated_sheath_stiffness_equals_plane_elasticity():
    # The reference is Kelvin's line force in a disc, with displacements averaged by quadrature.
    radius, thread = 0.011, 0.001
    angle = 2.0 * np.pi * (np.arange(400) + 0.5) / 400

    def along_force(points, sources):
        """Return the displacement along a force of 1 N/m on ``sources``, times 4 pi G."""
        distance = points[:, :, np.newaxis] - sources[:, np.newaxis]
        square = np.sum(distance**2, axis=0)
        return np.mean(-0.5 * np.log(square) + distance[0] ** 2 / square, axis=-1)

    ring = thread * np.stack([np.cos(angle), np.sin(angle)])
    midpoints = thread * np.stack([np.cos(angle + np.pi / 400), np.sin(angle + np.pi / 400)])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r = radius * np.sqrt(0.5 * (nodes + 1.0))
    mean = sum(
        0.5 * w * along_force(size * np.stack([np.cos(angle), np.sin(angle)]), ring).mean()
        for w, size in zip(weights, r)
    )
    compliance = (along_force(midpoints, ring).mean() - mean) / (4.0 * np.pi * SHEAR_MODULUS)
    estimate = estimate_sheath_stiffness(thread, radius, SHEAR_MODULUS)
    assert estimate == pytest.approx(1.0 / compliance, rel=5e-3)


@pytest.mark.parametrize(
    ('thread', 'message'),
    [
        (0.0, r'thread_radius is 0\.0, expected a finite numbe'),
        (0.006, r'is 0\.006, expected at most 0\.5 of the radius'),
    ],
)
def test_estimate_of_invalid_radii_is_refused(thread, message):
    with pytest.raises(ArmDefinitionError, match=message):
        estimate_sheath_stiffness(thread, 0.01, 1e5)
