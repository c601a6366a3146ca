"""Second derivatives of the tip by geometry: those of a slender arm, whose strains are small."""

from __future__ import annotations

import math

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Material, Section, Solver
from octo_arm_model.estimation.tip_curvature import tip_curvature

ROD = Arm(
    Material.from_moduli(40e9, 15e9),
    Body(0.25, 0.0006, 0.0006, disc_radius=0.01),
    (Section(0.25, 0.01, 0.01, angles=(0.0, 1.5, 3.5), twist=(2.0 * math.pi, 0.0, 0.0)),),
)
TENSIONS = np.array([1.5, 0.5, 1.0])
STEP = 1e-3


def by_all(solver: Solver, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions, and changes of pose by forces on the tip and tensions, at ``x`` of both."""
    shape = solver.solve([x[3:]], np.append(x[:3], np.zeros(3)))
    by = solver.sensitivity(shape)
    assert by.by_tip_wrench is not None
    pose = np.concatenate([by.by_tip_wrench.pose[..., :3], by.by_tension.pose], axis=2)
    return shape.position, pose


@pytest.mark.parametrize('stations', [25, 51, 60])
@pytest.mark.parametrize('force', [(0.0, 0.0, 0.0), (0.05, -0.04, 0.07)])
def test_they_are_the_differences_of_first_derivatives(
    force: tuple[float, float, float], stations: int
) -> None:
    solver = Solver(ROD, 'exact', stations, material='linear')
    x = np.append(force, TENSIONS)
    position, pose = by_all(solver, x)
    found = tip_curvature(position, pose, np.array(force))
    expected = np.stack(
        [
            (by_all(solver, x + step)[1][-1, :3] - by_all(solver, x - step)[1][-1, :3])
            / (2.0 * STEP)
            for step in STEP * np.eye(6)
        ],
        axis=2,
    )
    np.testing.assert_allclose(found, found.transpose(0, 2, 1), atol=1e-9 * np.abs(found).max())
    for part in (slice(0, 3), slice(3, 6)):
        off = np.linalg.norm((found - expected)[:, part, :3])
        assert off < 0.02 * np.linalg.norm(expected[:, part, :3])
    assert np.linalg.norm(found - expected) < 0.01 * np.linalg.norm(expected)
