"""Targets: their Jacobians, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from differences import jacobian as derivative
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    BackboneShape,
    Bending,
    Config,
    Solver,
    Stiffness,
    TargetError,
    TipPose,
    TipPosition,
)
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

TENSIONS = 0.6 * np.array(FETCHING_IN_SPACE)


@pytest.fixture(scope='module')
def solver(table4: Config) -> Solver:
    return table4.solver('exact', 61)


@pytest.mark.parametrize('name', ['position', 'pose', 'bending', 'shape'])
def test_jacobians_of_targets_are_their_derivatives(solver: Solver, name: str) -> None:
    backbone = solver.solve(TENSIONS + 0.05)
    other = solver.solve(0.7 * TENSIONS)
    target = {
        'position': TipPosition(other.tip),
        'pose': TipPose(other.tip, other.quaternion[-1]),
        'bending': Bending(0.4, 0.9),
        'shape': BackboneShape(other.s[::7], other.position[::7]),
    }[name]
    got = target.jacobian(backbone, solver.sensitivity(backbone).by_tension)

    def error(tensions: np.ndarray) -> np.ndarray:
        return target.error(solver.solve(tensions.reshape(3, 4)))

    expected = derivative(error, backbone.tensions.ravel(), step=1e-4)
    np.testing.assert_allclose(got, expected, atol=2e-6 * np.abs(expected).max())


def test_the_error_of_a_bending_angle_is_the_angle_up_to_half_a_turn(solver: Solver) -> None:
    straight = solver.solve(np.zeros((3, 4)))
    for angle in (0.5, 3.0, np.pi - 1.3e-3, np.pi - 1e-4, np.pi - 1e-9, np.pi):
        error = np.linalg.norm(Bending(0.5, angle, 1.0).error(straight))
        assert error == pytest.approx(angle, abs=1e-9)


@pytest.mark.parametrize('short', [1e-3, 4e-4])
def test_the_jacobian_of_a_bending_angle_is_its_derivative_near_half_a_turn(
    solver: Solver, short: float
) -> None:
    backbone = solver.solve(TENSIONS + 0.05)
    base, tip = (Rotation.from_quat(np.array(backbone.quaternion[i])) for i in (0, -1))
    t, n, b = (base.inv() * tip).apply([1.0, 0.0, 0.0])
    # Nearly opposite to where the tip points.
    target = Bending(float(np.arctan2(-b, -n)), float(np.pi - np.arccos(t) - short), 1.0)
    got = target.jacobian(backbone, solver.sensitivity(backbone).by_tension)

    def error(tensions: np.ndarray) -> np.ndarray:
        return target.error(solver.solve(tensions.reshape(3, 4)))

    expected = derivative(error, backbone.tensions.ravel(), step=1e-6)
    np.testing.assert_allclose(got, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: TipPosition([0.0, 0.0]), 'tip position is .*, expected 3 finite'),
        (lambda: TipPosition([0.0, np.nan, 0.0]), 'tip position is .*, expected 3 finite'),
        (lambda: TipPosition([0.0, 1e300, 0.0]), 'tip position is .*, none beyond 1e'),
        (lambda: TipPose([0.0] * 3, [0.0, 0.0, 0.0, 2.0]), 'tip quaternion is .*, expected'),
        (lambda: Bending(0.0, 4.0), 'bending angle is 4.0, expected 0 to pi'),
        (lambda: Bending(np.inf, 1.0), 'bending plane is inf'),
        (lambda: BackboneShape([0.1], [[0.0] * 3] * 2), 'backbone position has 2 points'),
        (lambda: Stiffness([0.0, 0.0, 0.0], 1.0), 'stiffness direction is .*, expected'),
        (lambda: Stiffness([np.inf, 0.0, 0.0], 1.0), 'direction is .*, expected three finite'),
        (lambda: Stiffness([np.nan, 1.0, 0.0], 1.0), 'direction is .*, expected three finite'),
        (lambda: Stiffness([1.0, 0.0, 0.0], 0.0), 'stiffness is 0.0, expected a finite'),
    ],
)  # fmt: skip
def test_what_is_no_target_is_refused(build: object, message: str) -> None:
    with pytest.raises(TargetError, match=message):
        build()  # type: ignore[operator]


@pytest.mark.parametrize('size', [1e-300, 1e200])
def test_the_size_of_a_direction_does_not_matter(size: float) -> None:
    direction = np.array([1.0, 2.0, -2.0])
    found = Stiffness(size * direction, 5.0).direction
    np.testing.assert_allclose(found, direction / 3.0, rtol=1e-12)
