"""Loads that change with the shape, and derivatives by the magnitudes of dead ones."""

import dataclasses

import numpy as np
import pytest
from differences import along, jacobian
from numpy.testing import assert_allclose
from rods import CASES, EVERYTHING, TENSIONS, WRENCH

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    Config,
    ConfigError,
    DistributedLoad,
    LoadError,
    Loads,
    Material,
    PointLoad,
    Section,
    Solver,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import DeformedRod, FollowingWrench, Resultants, Tangent
from octo_arm_model.rod.equilibrium import Equilibrium
from octo_arm_model.rod.rod import Rod, Setting
from octo_arm_model.rod.rotations import rotation_matrices
from octo_arm_model.rod.sensitivity import Derivatives
from octo_arm_model.rod.statics import strains_of

NOTHING = np.zeros(6)
PULL = np.array([0.0, 0.1, 0.1, 0.0, 0.5, 0.0, 0.0, 0.2, 0.0, 1.0, 0.0, 0.0])
WEIGHT = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0)


@dataclasses.dataclass
class FollowingForce(FollowingWrench):
    """One that perhaps does not say how it changes."""

    has_tangent: bool = True

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...] | None:  # type: ignore[override]
        """None where it is to be found without."""
        return super().tangents(rod) if self.has_tangent else None


class Heavy:
    """Weight of 1 N/m, as a load of another kind that is dead all the same."""

    breaks = knots = ()

    def resultants(self, rod: DeformedRod) -> Resultants:
        """What is beyond each point."""
        weight = np.zeros((3, rod.s.size))
        weight[2] = -1.0
        return Resultants(rod.integrate_from_tip(weight), np.zeros_like(weight))

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """None, as it is fixed in base_frame."""
        return ()


def made(arm: Arm, loads: Loads, base: FloatArray | None = None, **setting: bool) -> Rod:
    return Rod(arm, loads, base, Setting(**setting))


def arm_of(table4: Config) -> Arm:
    return table4.arm.with_density(1080.0)


def positions(rod: Rod, found: Equilibrium, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (S, 3) and rotations (3, 3, S) at ``s``."""
    position, quaternion, _, _ = rod.readout(found.level, s).read(found.state)
    return position, rotation_matrices(np.ascontiguousarray(np.roll(quaternion, 1, axis=1).T))


def tip_of(rod: Rod, found: Equilibrium) -> FloatArray:
    return positions(rod, found, np.array([0.0, rod.arm.length]))[0][-1]


@pytest.mark.parametrize('part', [1.0, 0.5])
@pytest.mark.parametrize('has_tangent', [True, False])
def test_at_balance_it_is_the_dead_force_of_that_direction(table4, part, has_tangent):
    # Without its tangent a force is found by plain iteration, which converges for small ones.
    size, arm = 1.0 if has_tangent else 0.3, arm_of(table4)
    force = (0.001 * size, 0.004 * size, -0.003 * size)
    load = FollowingForce(part * arm.length, force, has_tangent=has_tangent)
    rod = made(arm, dataclasses.replace(WEIGHT, others=(load,)))
    found = rod.solve(PULL, NOTHING)
    assert found.state.residual < 1e-11
    s = np.array([0.0, load.s, arm.length])
    position, rotation = positions(rod, found, s)
    straight = tip_of(rod, rod.solve(0.0 * PULL, NOTHING))
    assert np.linalg.norm(position[-1] - straight) > 0.1 * arm.length
    if part == 1.0:
        wrench = np.array([*(rotation[..., -1] @ load.force), 0.0, 0.0, 0.0])
        plain = made(arm, WEIGHT)
        dead = tip_of(plain, plain.solve(PULL, wrench, found))
        assert_allclose(position[-1], dead, rtol=0.0, atol=1e-8 * arm.length)


def test_a_dead_load_of_a_users_own_is_that_load(table4):
    uniform = dataclasses.replace(arm_of(table4), body=Body(0.45, 0.01, 0.01))
    weight = Loads(gravity=(0.0, 0.0, -1.0 / (1080.0 * np.pi * 0.01**2)))
    base = np.array([0.8, 0.0, 0.6, 0.0])
    tips = [
        tip_of(rod, rod.solve(PULL, WRENCH))
        for loads in (weight, Loads(others=(Heavy(),)))
        for rod in (made(uniform, loads, base),)
    ]
    assert_allclose(tips[1], tips[0], rtol=0.0, atol=1e-11)


def test_without_a_tangent_there_are_shapes_but_neither_derivatives_nor_stability(table4):
    arm = arm_of(table4)
    load, rods = FollowingForce(arm.length, (0.0, 0.002, 0.0), has_tangent=False), []
    for one in (load, dataclasses.replace(load, has_tangent=True)):
        rods.append(made(arm, dataclasses.replace(WEIGHT, others=(one,))))
    tips = [tip_of(rod, rod.solve(PULL, NOTHING)) for rod in rods]
    assert_allclose(tips[0], tips[1], rtol=0.0, atol=1e-9 * arm.length)
    others = rods[0].problem(0).others
    with pytest.raises(LoadError, match='FollowingForce states no tangent stiffness, which sens'):
        others.require_tangents('sensitivity')
    rods[1].problem(0).others.require_tangents('sensitivity')


def test_they_are_bounded_like_all_loads(table4):
    for load in (Loads(tip_force=(0.0, 1e9, 0.0)), Loads(tip_moment=(0.0, 1e9, 0.0))):
        with pytest.raises(ArmDefinitionError, match=r'loads\.tip_.* 100 times the'):
            made(arm_of(table4), load)
    others = (FollowingForce(0.3, (0.0, 1e9, 0.0)),)
    with pytest.raises(ArmDefinitionError, match='force of all loads along the arm is'):
        made(arm_of(table4), Loads(others=others))


@pytest.mark.parametrize('s', [0.2, 0.4])
def test_derivatives_are_those_of_loads_that_follow(s):
    arm, setting = CASES['neo_hookean']
    loads = dataclasses.replace(EVERYTHING, others=(FollowingForce(s, (0.0, 0.03, 0.02)),))
    rod = Rod(arm, loads, setting=setting)
    tensions = 0.5 * TENSIONS
    found, stations = rod.solve(tensions, WRENCH), np.array([0.1, 0.2, 0.3, 0.4])
    change = Derivatives(rod, found.level, stations).sensitivity(found).by_tension

    def outcome(step):
        moved = rod.solve(tensions + step, WRENCH, found)
        position, _, twist, _ = rod.readout(moved.level, stations).read(moved.state)
        return np.concatenate([position.ravel(), strains_of(twist)[2]])

    direction = 0.02 * tensions
    expected = along(outcome, np.zeros(6), direction)
    position, bend = (change.pose[:, :3] @ direction).ravel(), change.strain[:, 2] @ direction
    assert np.abs(position - expected[:12]).max() <= 1e-5 * np.abs(expected[:12]).max()
    assert np.abs(bend - expected[12:]).max() <= 1e-4 * np.abs(expected[12:]).max()


# Derivatives by magnitudes of dead loads ---------------------------------------------------------


CONE = Arm(Material(1.1e5, 0.4, 1080.0), Body(0.4, 0.015, 0.006), (Section(0.4, 0.008, 0.004),))
GIVEN = [[0.4, 0.6, 0.1, 0.2]]
ACTING = Loads(gravity=(0.0, 2.0, -3.0), points=(PointLoad(0.15, (0.0, 0.01, 0.01)),))
# Each of a magnitude that bends the arm visibly.
EACH = (
    Loads(points=(PointLoad(0.15, (0.01, 0.02, 0.0), (0.0, 1e-3, 0.0)),)),
    Loads(gravity=(0.0, 1.0, 1.0), fluid_density=400.0),
    Loads(distributed=(DistributedLoad((0.15, 0.4), ((0, 0.1, 0), (0, 0, 0.1))),)),
)


def with_magnitudes(magnitudes: np.ndarray) -> Loads:
    point, weight, distributed = magnitudes
    more = EACH[0].points[0]
    points = PointLoad(
        more.s, tuple(point * np.array(more.force)), tuple(point * np.array(more.moment))
    )
    spread = EACH[2].distributed[0]
    # Weight in a fluid of 400 kg/m^3 is that of a density less by this.
    part = weight * (1080.0 - 400.0) / 1080.0
    gravity = np.array(ACTING.gravity) + part * np.array(EACH[1].gravity)
    return Loads(
        gravity=tuple(gravity),
        points=(*ACTING.points, points),
        distributed=(DistributedLoad(spread.s, tuple(
            tuple(distributed * np.array(force)) for force in spread.force
        )),),
    )  # fmt: skip


@pytest.mark.parametrize(('law', 'shear'), [('neo_hookean', False), ('linear', True)])
def test_by_differences(law, shear):
    def solver(magnitudes):
        return Solver(
            CONE, 'exact', 41, material=law, shear=shear, loads=with_magnitudes(magnitudes)
        )

    def outcome(magnitudes):
        own = solver(magnitudes)
        shape = own.solve(GIVEN)
        strain = np.stack([shape.tau, shape.xi, shape.k, shape.q], axis=1)
        lengths = own.tendon_lengths(shape)
        return np.concatenate([shape.position.ravel(), strain.ravel(), lengths.ravel()])

    own = solver(np.zeros(3))
    change = own.sensitivity_to_loads(own.solve(GIVEN), EACH)
    found = np.concatenate([
        change.pose[:, :3].reshape(-1, 3), change.strain.reshape(-1, 3), change.tendon_length
    ])  # fmt: skip
    expected = jacobian(outcome, np.zeros(3), 0.05)
    positions = 3 * 41
    parts = slice(0, positions), slice(positions, 7 * 41), slice(7 * 41, None)
    for part, rough in zip(parts, (2e-5, 1e-4, 2e-5), strict=True):
        atol = rough * np.abs(expected[part]).max()
        assert_allclose(found[part], expected[part], atol=atol, rtol=0)


def test_what_has_no_such_derivative_is_refused():
    papers = Solver(CONE, 'closed_form', 41)
    with pytest.raises(ConfigError, match='choose exact'):
        papers.sensitivity_to_loads(papers.solve(GIVEN), EACH)
    exact = Solver(CONE, 'exact', 41)
    shape = exact.solve(GIVEN)
    with pytest.raises(ArmDefinitionError, match='loads: s'):
        exact.sensitivity_to_loads(shape, [Loads(points=(PointLoad(0.5, (1.0, 0.0, 0.0)),))])
