"""Loads that follow the shape, and derivatives by the magnitudes of dead loads."""

import dataclasses

import numpy as np
import pytest
from differences import along, jacobian
from numpy.testing import assert_allclose
from rods import EVERYTHING, HELICAL, WRENCH, scaled
from rods import PULL as HELICAL_PULL
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    ConfigError,
    DistributedLoad,
    LoadError,
    Loads,
    Material,
    PointLoad,
    Pose,
    Section,
    Solver,
)
from octo_arm_model.arm.loads import DeformedRod, FollowingWrench, Resultants, Tangent

PULL = np.array([[0.0, 0.1, 0.1, 0.0], [0.5, 0.0, 0.0, 0.2], [0.0, 1.0, 0.0, 0.0]])
WEIGHT = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0)


@dataclasses.dataclass
class FollowingForce(FollowingWrench):
    """A following force with or without a tangent stiffness."""

    has_tangent: bool = True

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...] | None:  # type: ignore[override]
        """Return None without a tangent stiffness."""
        return super().tangents(rod) if self.has_tangent else None


class Heavy:
    """A dead weight of 1 N/m, as a user's own load."""

    breaks = knots = ()

    def resultants(self, rod: DeformedRod) -> Resultants:
        """Return the weight beyond each point."""
        weight = np.zeros((3, rod.s.size))
        weight[2] = -1.0
        return Resultants(rod.integrate_from_tip(weight), np.zeros_like(weight))

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...]:
        """Return no tangents, because the load is dead."""
        return ()


@pytest.mark.parametrize('part', [1.0, 0.5])
@pytest.mark.parametrize('has_tangent', [True, False])
def test_following_force_equals_a_dead_force_of_its_final_direction(table4, part, has_tangent):
    # Without a tangent the solver iterates, which converges for small forces only.
    size, arm = 1.0 if has_tangent else 0.3, table4.arm.with_density(1080.0)
    force = (0.001 * size, 0.004 * size, -0.003 * size)
    load = FollowingForce(part * arm.length, force, has_tangent=has_tangent)
    solver = Solver(arm, 'exact', loads=dataclasses.replace(WEIGHT, others=(load,)))
    shape = solver.solve(PULL)
    assert shape.residual < 1e-11
    assert np.linalg.norm(shape.tip - solver.solve(0.0 * PULL).tip) > 0.1 * arm.length
    if part == 1.0:
        force_at_tip = Rotation.from_quat(shape.quaternion[-1]).apply(load.force)
        dead = Solver(arm, 'exact', loads=WEIGHT).solve(PULL, [*force_at_tip, 0.0, 0.0, 0.0])
        assert_allclose(shape.tip, dead.tip, rtol=0.0, atol=1e-8 * arm.length)


def test_users_own_weight_equals_gravity(table4):
    uniform = dataclasses.replace(table4.arm.with_density(1080.0), body=Body(0.45, 0.01, 0.01))
    weight = Loads(gravity=(0.0, 0.0, -1.0 / (1080.0 * np.pi * 0.01**2)))
    base = Pose(quaternion=(0.0, 0.6, 0.0, 0.8))
    tips = [
        Solver(uniform, 'exact', base=base, loads=loads).solve(PULL, WRENCH).tip
        for loads in (weight, Loads(others=(Heavy(),)))
    ]
    assert_allclose(tips[1], tips[0], rtol=0.0, atol=1e-11)


def test_derivatives_of_loads_without_a_tangent_are_refused(table4):
    load = FollowingForce(0.45, (0.0, 0.002, 0.0), has_tangent=False)
    solver = Solver(
        table4.arm.with_density(1080.0), 'exact', loads=dataclasses.replace(WEIGHT, others=(load,))
    )
    shape = solver.solve(PULL)
    with pytest.raises(LoadError, match='FollowingForce states no tangent stiffness, which sens'):
        solver.sensitivity(shape)


def test_users_own_loads_are_bounded(table4):
    others = (FollowingForce(0.3, (0.0, 1e9, 0.0)),)
    with pytest.raises(ArmDefinitionError, match='force of all loads along the arm is'):
        Solver(table4.arm.with_density(1080.0), 'exact', loads=Loads(others=others))


@pytest.mark.parametrize('s', [0.2, 0.4])
def test_derivatives_with_following_loads_equal_finite_differences(s):
    loads = dataclasses.replace(EVERYTHING, others=(FollowingForce(s, (0.0, 0.03, 0.02)),))
    solver, tensions = Solver(HELICAL, 'exact', 41, loads=loads), 0.5 * HELICAL_PULL
    shape = solver.solve(tensions, WRENCH)
    change = solver.sensitivity(shape).by_tension

    def outcome(step):
        varied = solver.solve(tensions + step.reshape(2, 3), WRENCH, shape)
        return np.concatenate([varied.position[10::10].ravel(), varied.k[10::10]])

    direction = 0.02 * tensions.ravel()
    expected = along(outcome, np.zeros(6), direction)
    position = (change.pose[10::10, :3] @ direction).ravel()
    bend = change.strain[10::10, 2] @ direction
    assert np.abs(position - expected[:12]).max() <= 1e-5 * np.abs(expected[:12]).max()
    assert np.abs(bend - expected[12:]).max() <= 1e-4 * np.abs(expected[12:]).max()


# Derivatives by magnitudes of dead loads ---------------------------------------------------------


CONE = Arm(Material(1.1e5, 0.4, 1080.0), Body(0.4, 0.015, 0.006), (Section(0.4, 0.008, 0.004),))
GIVEN = [[0.4, 0.6, 0.1, 0.2]]
ACTING = Loads(gravity=(0.0, 2.0, -3.0), points=(PointLoad(0.15, (0.0, 0.01, 0.01)),))
# Loads that bend the arm visibly.
EACH = (
    Loads(points=(PointLoad(0.15, (0.01, 0.02, 0.0), (0.0, 1e-3, 0.0)),)),
    Loads(gravity=(0.0, 1.0, 1.0), fluid_density=400.0),
    Loads(distributed=(DistributedLoad((0.15, 0.4), ((0, 0.1, 0), (0, 0, 0.1))),)),
)


def with_magnitudes(magnitudes: np.ndarray) -> Loads:
    point, weight, spread = (scaled(load, part) for load, part in zip(EACH, magnitudes))
    # Buoyancy in a fluid of 400 kg/m^3 reduces the weight.
    gravity = np.array(ACTING.gravity) + np.array(weight.gravity) * (1080.0 - 400.0) / 1080.0
    points = (*ACTING.points, *point.points)
    return Loads(gravity=tuple(gravity), points=points, distributed=spread.distributed)


@pytest.mark.parametrize(('law', 'shear'), [('neo_hookean', False), ('linear', True)])
def test_derivatives_by_load_magnitudes_equal_finite_differences(law, shear):
    def solver(magnitudes):
        return Solver(
            CONE, 'exact', 41, material=law, shear=shear, loads=with_magnitudes(magnitudes)
        )

    def outcome(magnitudes):
        solver_ = solver(magnitudes)
        shape = solver_.solve(GIVEN)
        strain = np.stack([shape.tau, shape.xi, shape.k, shape.q], axis=1)
        lengths = solver_.tendon_lengths(shape)
        return np.concatenate([shape.position.ravel(), strain.ravel(), lengths.ravel()])

    solver_ = solver(np.zeros(3))
    change = solver_.sensitivity_to_loads(solver_.solve(GIVEN), EACH)
    analytic = np.concatenate(
        [change.pose[:, :3].reshape(-1, 3), change.strain.reshape(-1, 3), change.tendon_length]
    )
    expected = jacobian(outcome, np.zeros(3), 0.05)
    positions = 3 * 41
    row_ranges = slice(0, positions), slice(positions, 7 * 41), slice(7 * 41, None)
    for rows, tolerance in zip(row_ranges, (2e-5, 1e-4, 2e-5), strict=True):
        atol = tolerance * np.abs(expected[rows]).max()
        assert_allclose(analytic[rows], expected[rows], atol=atol, rtol=0)


def test_derivatives_by_invalid_loads_are_refused():
    papers = Solver(CONE, 'closed_form', 41)
    with pytest.raises(ConfigError, match='choose exact'):
        papers.sensitivity_to_loads(papers.solve(GIVEN), EACH)
    exact = Solver(CONE, 'exact', 41)
    shape = exact.solve(GIVEN)
    with pytest.raises(ArmDefinitionError, match='loads: s'):
        exact.sensitivity_to_loads(shape, [Loads(points=(PointLoad(0.5, (1.0, 0.0, 0.0)),))])
