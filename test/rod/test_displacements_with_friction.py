"""Tendons with friction that are driven by length: closed forms, round trips, memory."""

import dataclasses
import math

import numpy as np
import pytest
from differences import jacobian
from helical_arm import PULL, helical_arm
from hypothesis import assume, given, settings
from numpy.testing import assert_allclose
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
    Wound,
    displacements_of,
    solve_displacements,
    wound_sensitivity,
)
from octo_arm_model.arm.hints import FloatArray

# Without a part that is free of friction the tension at the base itself stretches nothing.
HELICAL = helical_arm(
    friction=(0.1, 0.2, 0.3, 0.1, 0.0, 0.2), axial_stiffness=(100.0,), free_length=(0.05,)
)


def reeled_in(solver: Solver, backbone: Backbone) -> dict[str, float]:
    """Displacement of every tendon [m], by name."""
    whole = displacements_of(solver, backbone).ravel().tolist()
    return dict(zip(solver.arm.tendon_names, whole, strict=True))


def test_a_tendon_stretches_by_its_tension_at_every_station():
    young, radius, length, offset, mu, pull = 1e5, 0.01, 0.4, 0.006, 0.3, 3.0
    stretching, free = 200.0, 0.5
    arm = Arm(
        Material(young, 0.5), Body(length, radius, radius),
        (Section(length, offset, offset, angles=(0.0,)),), friction=(mu,),
        axial_stiffness=(stretching,), free_length=(free,),
    )  # fmt: skip
    solver = Solver(arm, 'exact', material='linear')
    backbone = solver.solve([[pull]])
    # T = 1 / (1 / T_0 + rate s), and the arm bends by T y / (E J) and is compressed by T / (E A).
    area, rate = math.pi * radius**2, mu * offset / (young * math.pi * radius**4 / 4)
    integral = math.log1p(rate * pull * length) / rate
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


def by_name(solver: Solver, tensions: FloatArray) -> dict[str, float]:
    return dict(zip(solver.arm.tendon_names, tensions.ravel().tolist(), strict=True))


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


def test_a_tendon_that_is_paid_out_is_slack(table4):
    arm = dataclasses.replace(table4.arm, friction=(0.1,), axial_stiffness=(200.0,))
    solver = Solver(arm, 'exact', 41)
    tensions = np.zeros((3, 4))
    tensions[2, 1], tensions[0, 2] = 3.0, 0.2
    lengths = reeled_in(solver, solver.solve(tensions))
    lengths['tendon_3_3'] -= 0.002
    lengths['tendon_1_1'] -= 0.001
    wound = solve_displacements(solver, lengths)
    assert_allclose(wound.backbone.tensions, tensions, rtol=0.0, atol=1e-8)
    assert {'tendon_3_3', 'tendon_1_1'} <= set(wound.slack)


def test_derivatives_with_displacements_held_are_those_of_differences():
    loads = Loads(gravity=(0.0, 0.0, -9.81))
    arm = dataclasses.replace(HELICAL, sheath_stiffness=(5e5,), free_length=(0.1,))
    solver = Solver(arm, 'exact', 11, loads=loads)
    whole = reeled_in(solver, solver.solve(PULL))
    first = whole.pop('tendon_1_1')
    wound = solve_displacements(solver, whole, {'tendon_1_1': PULL[0, 0]})
    found = wound_sensitivity(solver, wound)
    assert found.held.by_friction is not None and found.held.by_sheath_stiffness is not None
    # Reeled in by what a change of the tensions reels in.
    way = np.array([0.0, 0.1, -0.05, 0.2, 0.1, -0.1])

    def pulled(x):
        backbone = solver.solve(PULL + x * way.reshape(2, 3))
        return np.array([*backbone.tip, *displacements_of(solver, backbone).ravel()])

    tip, reeled = np.split(jacobian(pulled, np.zeros(1), 0.01)[:, 0], [3])
    got = found.by_displacement.tip[:3] @ reeled
    assert_allclose(got, tip, rtol=0.0, atol=1e-6 * np.abs(tip).max())
    assert not found.by_displacement.tip[:, 0].any()
    assert not found.held.by_tension.tip[:, 1:].any() and first > 0.0

    # With lengths held, everything else at once.
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
        return solve_displacements(own, whole, given, start=wound_at_once(wound)).backbone.tip

    got = (
        found.held.by_youngs_modulus.tip[:3, 0]
        + found.held.by_friction.tip[:3] @ arm.friction
        + found.held.by_sheath_stiffness.tip[:3] @ arm.sheath_stiffness
        + found.held.by_tension.tip[:3, 0] * PULL[0, 0]
    )
    expected = jacobian(tip_of, np.zeros(1), 0.01)[:, 0]
    assert_allclose(got, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


def wound_at_once(wound: Wound) -> Wound:
    """The ``wound`` arm without its history."""
    backbone = dataclasses.replace(wound.backbone, point_tensions=None)
    return dataclasses.replace(wound, backbone=backbone)


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
