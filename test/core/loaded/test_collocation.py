"""Collocation: integrals, read-out, orientations and the linearised equilibrium."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from differences import jacobian

from octo_arm_model import Arm, Body, Loads, Material, PointLoad, Pose, Section, Solver
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.loaded.kinematics import frames
from octo_arm_model.core.loaded.rod import CUTS, LoadedRod
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.numerics.gauss import gauss_rule
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.rod.stations import StationGrid
from octo_arm_model.core.rod.kinematics import Frame
from octo_arm_model.core.arm.laws import LAWS

ARM = Arm(
    Material(1.1e5, 0.45, 1080.0),
    Body(0.4, 0.015, 0.006),
    (Section(0.4, 0.01, 0.006), Section(0.25, 0.01, 0.007, angles=(0.3, 2.0, 4.0))),
)
LOADS = Loads(gravity=(1.0, 2.0, -3.0), points=(PointLoad(0.15, (0.0, 0.02, 0.01)),))
GRID = StationGrid.build(ARM, 41, LOADS.breaks)


@pytest.mark.parametrize('count', [3, 8, 18])
def test_a_rule_integrates_and_interpolates_polynomials(count: int) -> None:
    rule, power = gauss_rule(count), count - 1
    values = rule.points**power
    np.testing.assert_allclose(rule.from_start @ values, rule.points**count / count, atol=1e-12)
    np.testing.assert_allclose(rule.to_end @ values, (1 - rule.points**count) / count, atol=1e-12)
    assert rule.weights @ rule.points ** (2 * count - 1) == pytest.approx(1 / (2 * count))
    at = np.array([0.0, 0.3, 1.0])
    np.testing.assert_allclose(rule.interpolate(at) @ values, at**power, atol=1e-12)
    np.testing.assert_allclose(rule.integrate(at) @ values, at**count / count, atol=1e-12)
    # The Legendre coefficients that are the last two: zero for what needs fewer points.
    np.testing.assert_allclose(rule.tail @ rule.points ** (count - 3), 0.0, atol=1e-12)


@pytest.mark.parametrize('cuts', [1, 3])
def test_integrals_go_on_across_elements(cuts: int) -> None:
    own = Collocation(ARM, GRID, (0.05,), cuts)
    assert {0.0, 0.05, 0.15, 0.25} <= set(np.round(own.start, 12))
    np.testing.assert_allclose(own.start[1:], (own.start + own.step)[:-1], atol=1e-12)
    values = np.cos(10.0 * own.s)
    for found, expected in (
        (own.integrate_from_base(values), np.sin(10.0 * own.s) / 10.0),
        (own.integrate_from_tip(values), (np.sin(4.0) - np.sin(10.0 * own.s)) / 10.0),
    ):
        np.testing.assert_allclose(found, expected, atol=1e-12)
    readout = own.readout(GRID.s, GRID.s)
    np.testing.assert_allclose(readout.interpolate(values), np.cos(10.0 * GRID.s), atol=1e-10)
    integral = readout.integrate_from_base(values)
    np.testing.assert_allclose(integral, np.sin(10.0 * GRID.s) / 10.0, atol=1e-12)


def test_elements_are_the_shorter_the_thinner_the_arm_is() -> None:
    own = Collocation(ARM, GRID, (), 2)
    ends = np.append(own.start, own.start[-1] + own.step[-1])
    panels = np.searchsorted(ends, [0.0, 0.15, 0.25, 0.4])
    assert own.step.max() <= 0.41 * 0.4 / 2
    for first, last in itertools.pairwise(panels[panels < ends.size]):
        radius = ARM.body.radius(ends[first : last + 1 : 2])
        ratio = radius[:-1] / radius[1:]
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
        assert 1.0 < ratio[0] <= 1.5
        np.testing.assert_allclose(own.step[first:last:2], own.step[first + 1 : last : 2])


def test_what_jumps_at_a_border_is_read_out_on_either_side() -> None:
    own = Collocation(ARM, GRID, (), 1)
    values = np.where(own.s < 0.25, 1.0, 2.0)
    stops = np.array([panel.stop for panel in GRID.panels])[GRID.node_panel]
    found = own.readout(GRID.nodes, stops).interpolate(values)
    np.testing.assert_allclose(found, np.where(stops <= 0.25, 1.0, 2.0), atol=1e-12)


def test_orientations_under_a_constant_twist_are_its_exponential() -> None:
    own = Collocation(ARM, GRID, (), 1)
    w = np.array([3.0, -20.0, 31.0])
    base = Quaternions.from_xyzw(np.array([0.5, -0.5, 0.5, 0.5]))
    found = frames(np.repeat(w[:, np.newaxis], own.s.size, axis=1), own, base)
    half, axis = 0.5 * np.linalg.norm(w) * own.s, w / np.linalg.norm(w)
    turn = Quaternions(
        np.cos(half) + 1j * axis[0] * np.sin(half), (axis[1] + 1j * axis[2]) * np.sin(half)
    )
    expected = base.times(turn)
    np.testing.assert_allclose(found.a, expected.a, atol=1e-9)
    np.testing.assert_allclose(found.b, expected.b, atol=1e-9)


@pytest.mark.parametrize(('law', 'shear'), [('neo_hookean', False), ('linear', True)])
def test_newtons_step_is_the_inverse_of_what_a_change_of_twist_does(law: str, shear: bool) -> None:
    base = Pose((0.1, 0.2, 0.3), (0.5, -0.5, 0.5, 0.5))
    solver = Solver(ARM, 'exact', 41, base, material=law, shear=shear, loads=LOADS)
    assert isinstance(solver._statics, Exact)
    problem = solver._statics._rod(0).equilibrium
    tensions = np.linspace(0.1, 0.9, 7)
    shape = solver._statics._rod(0).unloaded(tensions)
    condition = Condition(tensions, np.array([0.01, 0.02, -0.01, 0.0, 0.0, 0.0]), 1.0)
    state = problem.state(condition, shape)
    step = problem.linearised(state).solve(state.imbalance[:, np.newaxis])

    def imbalance(part: np.ndarray) -> np.ndarray:
        return problem.state(condition, problem.moved(shape, step, part[0])).imbalance

    slope = jacobian(imbalance, np.zeros(1), 1e-4)[..., 0]
    np.testing.assert_allclose(slope, -state.imbalance, atol=1e-5 * np.abs(state.imbalance).max())


def test_the_finest_elements_are_fine_enough_as_there_are_no_others() -> None:
    base = Frame(np.zeros(3), Quaternions.from_xyzw((0.0, 0.0, 0.0, 1.0)))
    for cuts in CUTS:
        rod = LoadedRod(ARM, GRID, base, LAWS['linear'], False, LOADS, cuts)
        twist = np.random.default_rng(1).normal(size=(4, 2, rod.points))
        assert rod.is_finest == (cuts == max(CUTS))
        assert rod.are_resolved(twist).tolist() == [rod.is_finest] * 2
