"""Friction of the tendons, and sheaths: closed forms, least energy, hysteresis, derivatives."""

import dataclasses
import math

import numpy as np
import pytest
import reference_exact
import rods
import strategies
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
)
from octo_arm_model.arm.stiffness import estimate_sheath_stiffness

MODELS = ('closed_form', 'exact')
YOUNG, RADIUS, LENGTH, OFFSET, MU = 1e5, 0.01, 0.4, 0.006, 0.3
BENDING = YOUNG * math.pi * RADIUS**4 / 4
GRAVITY = Loads(gravity=(0.0, 0.0, -9.81))


def uniform(angles: tuple[float, ...] = (0.0,), friction: float = MU) -> Arm:
    """Parallel tendons at ``angles`` in a cylinder."""
    return Arm(
        Material(YOUNG, 0.5, 1080.0),
        Body(LENGTH, RADIUS, RADIUS),
        (Section(LENGTH, OFFSET, OFFSET, angles=angles),),
        friction=len(angles) * (friction,),
    )


# The law in closed form -------------------------------------------------------------------------


@pytest.mark.parametrize('pull', [0.01, 0.3, 3.0])
@pytest.mark.parametrize('friction', [0.05, 0.3, 1.0])
def test_one_parallel_tendon_is_that_of_the_closed_form(pull, friction):
    solver = Solver(uniform(friction=friction), 'exact', material='linear')
    backbone = solver.solve([[pull]])
    slope = friction * OFFSET / BENDING
    tension = 1.0 / (1.0 / pull + slope * backbone.s)
    # As exact as the rod has tensions (`rod._TENSION_ERROR`): 4e-7 under the largest pull and
    # friction, 1e-7 under all others.
    assert_allclose(backbone.tendon_tensions[:, 0], tension, rtol=1e-6)
    per_reference_length = backbone.k * (1.0 + backbone.q)
    assert_allclose(per_reference_length, tension * OFFSET / BENDING, rtol=1e-6)
    angle = math.log(1.0 + slope * pull * LENGTH) / friction
    x, y, _ = Rotation.from_quat(backbone.quaternion[-1]).apply([1.0, 0.0, 0.0])
    assert math.remainder(math.atan2(y, x) - angle, math.tau) == pytest.approx(0.0, abs=1e-6)
    left = pull * math.exp(-friction * angle)
    assert backbone.tendon_tensions[-1, 0] == pytest.approx(left, rel=1e-8)


def test_in_the_closed_form_model_tension_obeys_its_differential_equation():
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
def test_without_friction_nothing_changes(model):
    without, zero = helical_arm(), helical_arm(friction=(0.0,))
    assert zero == without
    assert zero.friction == ()
    plain = Solver(without, model).solve(PULL)
    again = Solver(zero, model).solve(PULL)
    assert_allclose(again.position, plain.position, rtol=0.0, atol=1e-12)
    little = Solver(helical_arm(friction=(1e-11,)), model).solve(PULL)
    assert_allclose(little.position, plain.position, atol=2e-10)
    assert_allclose(little.tendon_tensions, plain.tendon_tensions, atol=1e-10)
    # Its tension is that of the base up to the anchorage.
    inside = plain.s[:, np.newaxis] <= np.repeat([0.4, 0.25], 3)
    assert_array_equal(plain.tendon_tensions, PULL.ravel() * inside)


def test_a_converging_tendon_loses_tension_where_another_ends():
    # Straight, but compressed more up to the anchorage of the ring at 0.2 m: there the slopes of
    # the long tendons in the plane through the midline jump.
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


# Balance, from positions alone ------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(loaded_arms(3), fractions(0.01, 0.6), st.sampled_from(MODELS))
def test_tension_falls_by_the_angle_that_a_tendon_turns_by(case, friction, model):
    arm, tensions = case
    rough = dataclasses.replace(arm, friction=(friction,))
    try:
        backbone = Solver(rough, model, 801, material='linear').solve(tensions)
    except SolveError:
        assume(False)
    along, paths = backbone.tendon_tensions, rods.tendon_points(arm, backbone)
    assert (np.diff(along, axis=0) <= 1e-9 * np.maximum(tensions.ravel(), 1e-3)).all()
    for j, pull in enumerate(tensions.ravel()):
        inside = along[:, j] > 0.0
        inside[1:] &= np.diff(backbone.s) > 1e-9  # An anchorage may be next to the tip.
        if not pull or np.count_nonzero(inside) < 10:
            continue
        chords = np.diff(paths[j, inside], axis=0)
        chords /= np.linalg.norm(chords, axis=1)[:, np.newaxis]
        # From the middle of the first interval to that of the last.
        turned = np.linalg.norm(np.diff(chords, axis=0), axis=1).sum()
        ends = along[inside, j]
        middle = 0.5 * (ends[:-1] + ends[1:])
        lost = math.log(middle[0] / middle[-1])
        assert lost == pytest.approx(friction * turned, rel=0.02, abs=2e-3)


# History ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('model', MODELS)
def test_unloading_a_little_changes_the_arm_near_its_base_alone(model):
    solver = Solver(uniform(), model, 401)
    pulled = solver.solve([[1.0]])
    part = 0.05
    released = solver.follow([[1.0 - part]], pulled)
    before, after = pulled.tendon_tensions[:, 0], released.tendon_tensions[:, 0]
    # It slips back over the angle in which its tension can rise to what it was.
    angle = np.log(1.0 / before) / MU
    holds = -math.log(1.0 - part) / (2.0 * MU)
    sticks = angle > 1.1 * holds
    assert 0.5 < np.count_nonzero(sticks) / sticks.size < 0.99
    assert_allclose(after[sticks], before[sticks], rtol=3e-3)
    assert_allclose(released.k[sticks], pulled.k[sticks], rtol=3e-3)
    slips = angle < 0.9 * holds
    turned = np.cumsum([0.0, *(0.5 * (released.k[1:] + released.k[:-1]) * np.diff(released.s))])
    assert (after[slips] < before[slips]).all()
    if model == 'exact':
        return  # A tangent along the stretched arm turns by k (1 + q).
    assert_allclose(after[slips], (1.0 - part) * np.exp(MU * turned[slips]), rtol=5e-3)


@pytest.mark.parametrize(('model', 'loads'), [('closed_form', Loads()), ('exact', GRAVITY)])
def test_a_loop_closes_and_encloses_something(model, loads):
    arm = helical_arm(friction=(0.2,))
    solver = Solver(arm, model, loads=loads)
    high, low = PULL, 0.4 * PULL
    loops = [[], [], []]
    first = last = solver.follow(high, None)
    assert_allclose(last.tip, solver.solve(high).tip, atol=1e-12)
    ways = [high + part * (low - high) for part in (0.5, 1.0)]
    backs = [low + part * (high - low) for part in (0.5, 1.0)]
    for found in loops:
        for tensions in ways + backs:
            last = solver.follow(tensions, last)
            found.append(last)
    # The first may be on fewer nodes, where a tendon begins to stick a little elsewhere.
    for one, other, part in ((loops[0], loops[1], 5e-6), (loops[1], loops[2], 1e-7)):
        for before, after in zip(one, other):
            assert_allclose(before.position, after.position, rtol=0.0, atol=part * arm.length)
            assert_allclose(
                before.tendon_tensions, after.tendon_tensions, rtol=0.0, atol=100.0 * part
            )
    assert_allclose(loops[-1][-1].tip, first.tip, atol=1e-7 * arm.length)
    # On the way down and on the way up the same tensions give another shape.
    assert np.linalg.norm(loops[-1][0].tip - loops[-1][2].tip) > 2e-3 * arm.length


def test_a_single_solution_knows_of_no_history():
    solver = Solver(uniform(), 'exact')
    fresh = solver.solve([[0.6]])
    released = solver.follow([[0.6]], solver.solve([[1.0]]))
    assert_allclose(solver.solve([[0.6]]).position, fresh.position, rtol=0, atol=1e-12)
    assert np.linalg.norm(released.tip - fresh.tip) > 0.01
    started = solver.solve([[0.6]], start=solver.solve([[1.0]]))
    assert_allclose(started.position, fresh.position, rtol=0.0, atol=1e-12)


def test_the_same_tensions_again_change_nothing():
    section = Section(1.0, 0.0635, 0.014)
    arm = Arm(Material(1e4, 0.0), Body(1.0, 0.078, 0.056), (section,), friction=(0.25,))
    solver = Solver(arm, 'exact', material='linear')
    pulled = solver.solve([[0.0, 0.0, 21.7, 8.7]])
    assert_allclose(solver.follow(pulled.tensions, pulled).position, pulled.position, atol=1e-12)


@pytest.mark.parametrize('loads', [Loads(), Loads(tip_force=(0.01, 0.0, 0.0))])
def test_a_history_of_another_arm_is_refused(loads):
    """Whose points are others, so that it says nothing of the tendons here."""
    solver = Solver(uniform(), 'exact', loads=loads)
    last = solver.solve([[1.0]])
    other = dataclasses.replace(last, point_tensions=np.ones((1, 7)))
    with pytest.raises(ConfigError, match='by another solver'):
        solver.follow([[0.9]], other)


def test_a_batch_is_its_arms_one_by_one():
    for model, loads in (('closed_form', Loads()), ('exact', GRAVITY)):
        solver = Solver(helical_arm(friction=(MU,)), model, loads=loads)
        several = np.stack([PULL, 0.1 * PULL, 0.0 * PULL])
        batch = solver.solve(several)
        last = solver.solve(1.2 * PULL)
        followed = solver.follow(several, last)
        assert batch.tendon_tensions.shape == (3, batch.s.size, 6)
        for number, tensions in enumerate(several):
            for found, one in (
                (batch, solver.solve(tensions)),
                (followed, solver.follow(tensions, last)),
            ):
                assert_allclose(found.position[number], one.position, atol=1e-10)
                assert_allclose(found.tendon_tensions[number], one.tendon_tensions, atol=1e-9)


# Derivatives ------------------------------------------------------------------------------------


def test_derivatives_of_the_closed_form():
    friction, young = np.linspace(0.05, 0.4, 6), float(rods.RUBBER.youngs_modulus)
    solver = Solver(helical_arm(friction=tuple(friction)), 'closed_form', 41)
    by = solver.sensitivity(solver.solve(PULL))
    # Of all inputs at once, each by another part.
    more, rougher = 5e-3 * np.arange(-2.0, 4.0), 5e-3 * np.array([1.0, -0.5, 0.3, -1.0, 0.8, 0.2])
    parts = ((by.by_tension, more), (by.by_youngs_modulus, [1e-3]), (by.by_friction, rougher))

    def outcome(part):
        arm = helical_arm(friction=tuple(friction + part * rougher))
        material = dataclasses.replace(arm.material, youngs_modulus=young * (1 + 1e-3 * part[0]))
        own = Solver(dataclasses.replace(arm, material=material), 'closed_form', 41)
        shape = own.solve(PULL + (part * more).reshape(2, 3))
        strains = np.stack([shape.tau, shape.xi, shape.k, shape.q], axis=1)
        lengths = own.tendon_lengths(shape).ravel()
        return np.concatenate([shape.position.ravel(), strains.ravel(), lengths])

    expected = along(outcome, np.zeros(1), np.ones(1))
    position = sum(change.pose[:, :3] @ way for change, way in parts)
    strain = sum(change.strain @ way for change, way in parts)
    length = sum(change.tendon_length @ way for change, way in parts)
    for got, want in zip((position, strain, length), np.split(expected, [123, 287])):
        assert_allclose(np.ravel(got), want, atol=1e-5 * np.abs(want).max())


@pytest.mark.parametrize('model', MODELS)
def test_derivatives_where_every_tendon_is_let_out(model):
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
def test_where_there_is_no_derivative_it_is_refused(model):
    solver = Solver(uniform(), model)
    part = solver.follow([[0.9]], solver.solve([[1.0]]))
    with pytest.raises(SolveError, match=r'friction, tendon_1_1 of 0\.9 N sticks'):
        solver.sensitivity(part)
    both = Solver(uniform((0.0, math.pi)), model)
    # Of equal tension on opposite sides, parallel tendons stay straight and lose nothing.
    straight = both.solve([[2.0, 2.0]])
    assert_allclose(straight.position[:, 1:], 0.0, atol=1e-12)
    assert_allclose(straight.tendon_tensions, 2.0, rtol=1e-12)
    with pytest.raises(SolveError, match='tendon_1_1 of 2 N is straight'):
        both.sensitivity(straight)
    # Slack ones do not matter.
    assert np.isfinite(both.sensitivity(both.solve([[0.0, 0.0]])).by_tension.tip).all()


@pytest.mark.parametrize('model', MODELS)
def test_the_inverse_finds_tensions_with_friction(model):
    solver = Solver(uniform((0.0, 2.0, 4.0), 0.2), model, 31)
    goal = solver.solve([[0.5, 0.3, 0.0]]).tip
    found = find_tensions(solver, TipPosition(tuple(goal)), 2.0)
    assert_allclose(solver.solve(found.backbone.tensions).tip, goal, atol=1e-6)


# In sheaths --------------------------------------------------------------------------------------


SHEATH = 1.5e5
SHEATHED = dataclasses.replace(uniform(), sheath_stiffness=(SHEATH,))
# One slides freely and one keeps its place.
IN_SHEATHS = helical_arm(
    Material(1.1e5, 0.5, 1080.0),
    friction=(0.1, 0.2, 0.3, 0.1, 0.0, 0.2),
    sheath_stiffness=(3e5, 5e5, 0.0, 4e5, 2e5, 6e5),
)


@pytest.mark.parametrize('pull', [0.1, 1.0, 4.0])
def test_in_a_sheath_it_is_that_of_another_closed_form(pull):
    # It stands off its path by T kappa / k, so that E J kappa = T (y + T kappa / k), and
    # T' = -mu T kappa is separable.
    def passed(tension):
        """Where the tension has fallen to this [m]."""
        bent = BENDING * (1.0 / tension - 1.0 / pull) - (pull - tension) / SHEATH
        return bent / (MU * OFFSET)

    backbone = Solver(SHEATHED, 'exact', material='linear').solve([[pull]])
    expected = np.array([brentq(lambda t: passed(t) - s, 1e-3, pull) for s in backbone.s])
    assert_allclose(backbone.tendon_tensions[:, 0], expected, rtol=1e-7)
    bent = expected * OFFSET / (BENDING - expected**2 / SHEATH)
    assert_allclose(backbone.k * (1.0 + backbone.q), bent, rtol=1e-6)


@pytest.mark.parametrize('loads', [Loads(), GRAVITY], ids=['free', 'under gravity'])
def test_limits_are_friction_alone_and_sheaths_alone(loads):
    def tip(**changes):
        arm = dataclasses.replace(IN_SHEATHS, **changes)
        return Solver(arm, 'exact', loads=loads).solve(PULL).tip

    both = tip()
    rough, soft = tip(sheath_stiffness=()), tip(friction=())
    assert min(np.linalg.norm(both - rough), np.linalg.norm(both - soft)) > 1e-4
    assert_allclose(tip(sheath_stiffness=(1e14,)), rough, atol=1e-8)
    assert_allclose(tip(friction=(1e-10,)), soft, atol=1e-8)


# Sheaths -----------------------------------------------------------------------------------------


RUBBER = Material(1.1e5, 0.5, 1080.0)
SHEAR_MODULUS = 1.1e5 / 3.0


@pytest.mark.parametrize('s', [0.1, 0.3])
def test_strains_are_those_of_least_energy_over_strains_and_places(s):
    """A general optimiser of all unknowns at once finds no less."""
    # Sheaths of equal stiffness: the optimiser moves none that is rigid.
    arm = helical_arm(RUBBER, sheath_stiffness=(3e5,))
    backbone = Solver(arm, 'exact', 41).solve(PULL)
    i = int(np.argmin(np.abs(backbone.s - s)))
    stretch = 1.0 + backbone.q[i]
    found = np.array([backbone.tau[i], backbone.xi[i], backbone.k[i]]) * stretch
    cut = reference_exact.Cut(
        arm, backbone.s[i], reference_exact.active_at(arm, backbone.s[i]), PULL, 'neo_hookean'
    )
    places, units = cut.r, np.concatenate([[10.0, 10.0, 10.0, 0.1], np.full(12, 1e-3)])

    def scaled(x):
        # The energy at rest is some 1e-1 N, its changes by rounding far less.
        moved = (units * x)[4:].reshape(6, 2).T[:, : places.shape[1]]
        cut.r = places + np.pad(moved, [(1, 0), (0, 0)])[..., np.newaxis]
        own = cut.energy((units * x)[:4, np.newaxis]).item()
        return own + 0.5 * 3e5 * float((moved**2).sum())

    start = np.zeros(16)
    start[3] = 10.0
    best = minimize(scaled, start, method='BFGS', options={'gtol': 1e-9, 'maxiter': 2000})
    reached = (units * best.x)[:4]
    assert_allclose(reached[:3], found, atol=2e-4 * np.abs(found).max())
    assert reached[3] == pytest.approx(stretch, abs=2e-5)
    assert np.abs(best.x[4:]).max() > 0.01  # and tendons moved by more than 10 micrometres


@settings(max_examples=15, deadline=None)
@given(loaded=strategies.loaded_arms(2), scale=st.floats(0.2, 5.0))
def test_lengths_and_tensions_in_proportion_scale_the_shape(loaded, scale):
    """As k is a modulus: lengths times c, tensions times c^2, the same k."""
    arm, tensions = loaded
    soft = {'sheath_stiffness': (20.0 * float(arm.material.youngs_modulus),)}
    small, large = (
        dataclasses.replace(one, **soft) for one in (arm, strategies.scaled(arm, scale))
    )
    before = Solver(small, 'exact', 31).solve(0.5 * tensions)
    after = Solver(large, 'exact', 31).solve(0.5 * scale**2 * tensions)
    assert_allclose(after.position, scale * before.position, atol=1e-8 * scale * arm.length)


def test_what_sheaths_cannot_hold_with_friction_is_refused(table4):
    arm = table4.arm.with_density(1080.0)
    arm = dataclasses.replace(arm, friction=(0.1,), sheath_stiffness=(2e4,))
    solver = Solver(arm, 'exact', loads=Loads((0.0, 0.0, -9.81), 1000.0))
    with pytest.raises(SolveError, match='did not converge'):
        solver.solve([[0.0, 0.0, 0.5, 0.0], [4.0, 0.0, 0.0, 0.0], [0.0, 8.0, 0.0, 0.0]])


def test_the_estimate_is_that_of_plane_elasticity():
    """Kelvin's line force in a disc, its displacements averaged by quadrature."""
    radius, thread = 0.011, 0.001
    angle = 2.0 * np.pi * (np.arange(400) + 0.5) / 400

    def along_force(at, sources):
        """Displacement along a force of 1 N/m spread over ``sources``, times 4 pi G."""
        away = at[:, :, np.newaxis] - sources[:, np.newaxis]
        square = np.sum(away**2, axis=0)
        return np.mean(-0.5 * np.log(square) + away[0] ** 2 / square, axis=-1)

    ring = thread * np.stack([np.cos(angle), np.sin(angle)])
    between = thread * np.stack([np.cos(angle + np.pi / 400), np.sin(angle + np.pi / 400)])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r = radius * np.sqrt(0.5 * (nodes + 1.0))
    whole = sum(
        0.5 * w * along_force(size * np.stack([np.cos(angle), np.sin(angle)]), ring).mean()
        for w, size in zip(weights, r)
    )
    gives = (along_force(between, ring).mean() - whole) / (4.0 * np.pi * SHEAR_MODULUS)
    estimate = estimate_sheath_stiffness(thread, radius, SHEAR_MODULUS)
    assert estimate == pytest.approx(1.0 / gives, rel=5e-3)


@pytest.mark.parametrize(
    ('given', 'problem'),
    [
        ((0.0, 0.01, 1e5), 'thread_radius is 0.0, expected a finite number > 0'),
        ((0.006, 0.01, 1e5), 'thread_radius is 0.006, expected at most 0.5 of the radius'),
    ],
)
def test_an_estimate_out_of_range_is_refused(given, problem):
    with pytest.raises(ArmDefinitionError, match=problem):
        estimate_sheath_stiffness(*given)
