"""Loads that change with the shape: a force that follows the tip, by way of example."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octo_arm_model import ArmDefinitionError, Backbone, Config, LoadError, Loads, Solver
from octo_arm_model.core.arm.loads import DeformedRod, Resultants, Tangent
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.stability import stability_of
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.numerics.vectors import skew

TENSIONS = [[0.0, 0.1, 0.1, 0.0], [0.5, 0.0, 0.0, 0.2], [0.0, 1.0, 0.0, 0.0]]


@dataclasses.dataclass(frozen=True)
class FollowingForce:
    """A force on one cross section that turns with it.

    Attributes:
        s: arc coordinate of the cross section [m].
        force: in its axes t, n, b [N].
        has_tangent: whether it says how it changes.
    """

    s: float
    force: tuple[float, float, float]
    has_tangent: bool = True
    knots: tuple[float, ...] = ()

    @property
    def breaks(self) -> tuple[float, ...]:
        """Where it acts."""
        return (self.s,)

    def resultants(self, rod: DeformedRod) -> Resultants:
        """The force in base_frame on all cross sections before it."""
        force = np.where(
            rod.s < self.s, (rod.rotation_at(self.s) @ self.force)[:, np.newaxis], 0.0
        )
        return Resultants(force, np.zeros_like(force))

    def tangents(self, rod: DeformedRod) -> tuple[Tangent, ...] | None:
        """Rotated by phi it changes by phi x force."""
        if not self.has_tangent:
            return None
        by_turn = -skew((rod.rotation_at(self.s) @ self.force)[:, np.newaxis])
        force = np.where(rod.s < self.s, by_turn, 0.0)
        return (Tangent(self.s, force, np.zeros_like(force)),)


def solver_of(table4: Config, *others: FollowingForce) -> Solver:
    weight = Loads(gravity=(0.0, 0.0, -9.81), fluid_density=1000.0, others=others)
    return dataclasses.replace(table4, arm=table4.arm.with_density(1080.0), loads=weight).solver(
        'exact'
    )


def rotation_at(backbone: Backbone, station: int) -> FloatArray:
    return Rotation.from_quat(np.array(backbone.quaternion[station])).as_matrix()


@pytest.mark.parametrize('part', [1.0, 0.5])
@pytest.mark.parametrize('has_tangent', [True, False])
def test_at_balance_it_is_the_dead_force_of_that_direction(
    table4: Config, part: float, has_tangent: bool
) -> None:
    # Without its tangent a force is found by plain iteration, which converges for small ones.
    size = 1.0 if has_tangent else 0.3
    force_in_section = (0.001 * size, 0.004 * size, -0.003 * size)
    load = FollowingForce(part * table4.arm.length, force_in_section, has_tangent)
    solver = solver_of(table4, load)
    backbone = solver.solve(TENSIONS)
    assert backbone.residual < 1e-11
    station = int(np.argmin(np.abs(backbone.s - load.s)))
    force = rotation_at(backbone, station) @ load.force
    straight = solver.solve(0.0 * np.array(TENSIONS)).tip
    assert np.linalg.norm(backbone.tip - straight) > 0.1 * table4.arm.length
    if part == 1.0:
        dead = solver_of(table4).solve(TENSIONS, np.array([*force, 0.0, 0.0, 0.0]))
        np.testing.assert_allclose(
            backbone.position, dead.position, rtol=0, atol=1e-6 * table4.arm.length
        )


def test_sensitivities_hold_what_following_adds(table4: Config) -> None:
    load = FollowingForce(table4.arm.length, (0.0, 0.006, 0.0))
    solver = solver_of(table4, load)
    backbone = solver.solve(TENSIONS)
    derivatives = solver.sensitivity(backbone)
    found = derivatives.by_tension.tip[:3]
    compliance = derivatives.compliance[:3, :3]
    step, expected = 1e-5, []
    for tendon in range(12):
        ends = []
        for sign in (1.0, -1.0):
            moved = backbone.tensions.ravel().copy()
            moved[tendon] += 2 * step + sign * step
            ends.append(solver.solve(moved.reshape(3, 4), start=backbone).tip)
        expected.append((ends[0] - ends[1]) / (2 * step))
    np.testing.assert_allclose(
        found, np.transpose(expected), rtol=0, atol=2e-3 * np.abs(found).max()
    )
    pushed = []
    for axis in range(3):
        ends = []
        for sign in (1.0, -1.0):
            wrench = np.zeros(6)
            wrench[axis] = sign * step
            ends.append(solver.solve(TENSIONS, wrench, backbone).tip)
        pushed.append((ends[0] - ends[1]) / (2 * step))
    np.testing.assert_allclose(
        compliance, np.transpose(pushed), rtol=0, atol=1e-5 * np.abs(compliance).max()
    )
    # A force that follows has no energy: its compliance is not symmetric, a dead one's is.
    assert np.abs(compliance - compliance.T).max() > 1e-3 * np.abs(compliance).max()


def test_without_a_tangent_there_are_shapes_but_neither_derivatives_nor_stability(
    table4: Config,
) -> None:
    load = FollowingForce(table4.arm.length, (0.0, 0.002, 0.0), has_tangent=False)
    solver = solver_of(table4, load)
    backbone = solver.solve(TENSIONS)
    expected = solver_of(table4, dataclasses.replace(load, has_tangent=True)).solve(TENSIONS)
    np.testing.assert_allclose(
        backbone.position, expected.position, rtol=0, atol=1e-8 * table4.arm.length
    )
    says = 'FollowingForce states no tangent stiffness, which {} needs'
    with pytest.raises(LoadError, match=says.format('sensitivity')):
        solver.sensitivity(backbone)
    assert isinstance(solver._statics, Exact)
    problem = solver._statics._rod(0).equilibrium
    assert backbone.shape is not None
    condition = Condition(backbone.tensions.ravel(), np.zeros(6), 1.0)
    with pytest.raises(LoadError, match=says.format('the stability check')):
        stability_of(problem, problem.state(condition, backbone.shape))


def test_they_are_bounded_and_lie_on_the_arm_like_all_loads(table4: Config) -> None:
    with pytest.raises(ArmDefinitionError, match='force of all loads along the arm is'):
        solver_of(table4, FollowingForce(0.3, (0.0, 1e9, 0.0)))
    with pytest.raises(ArmDefinitionError, match='at most the length of the arm'):
        solver_of(table4, FollowingForce(0.6, (0.0, 0.001, 0.0)))
