"""Geometry to draw: bodies, tubes and arrows with probabilities, and self-intersection."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from octo_arm_model import Arm, Discs, Material, RectangularBody, Section, Solver, load_config
from octo_arm_model.analysis.drawing import (
    ARROW_TRIANGLES,
    CONE_TRIANGLES,
    CORNERS,
    INSIDE,
    Drawing,
    UncertaintyDrawing,
    deepest_overlap,
)
from octo_arm_model.rod.rotations import axes_of

CONFIG = load_config('renda2012_prototype')
SOLVER = CONFIG.solver('exact', 21)
SHAPE = SOLVER.solve([[1.0, 0.4, 0.3, 0.5]])
DRAWING = UncertaintyDrawing(CONFIG.arm, SHAPE.s)
FORCE = np.array([0.002, -0.004, 0.008])
COUNT = 40_000


def covariance(seed: int, scale: float) -> np.ndarray:
    root = scale * np.random.default_rng(seed).normal(size=(3, 3))
    return root @ root.T


def test_tendons_are_straight_between_discs():
    arm = dataclasses.replace(CONFIG.arm, discs=Discs.evenly(4, CONFIG.arm.length))
    shape = Solver(arm, 'exact', 21).solve([[0.3, 0.1, 0.0, 0.1]])
    drawn = Drawing(arm, shape.s).draw(shape.position, shape.quaternion, shape.q)
    for path in drawn.tendons:
        steps = np.diff(path, axis=0).reshape(4, 5, 3)
        assert_allclose(steps, np.repeat(steps[:, :1], 5, axis=1), atol=1e-12)
        assert np.linalg.norm(np.cross(steps[0, 0], steps[1, 0])) > 1e-6 * arm.length**2


def test_tube_contains_the_body_with_the_stated_probability():
    cov = np.stack([covariance(number, 1e-3) for number in range(21)])
    tube = DRAWING.tube(SHAPE.position, SHAPE.quaternion, cov)
    rings = tube[:-2].reshape(-1, 21, 3)
    for station in (0, 7, 20):
        samples = np.random.default_rng(1).multivariate_normal(np.zeros(3), cov[station], COUNT)
        for corner in rings[::4, station] - SHAPE.position[station]:
            distance = np.linalg.norm(corner)
            radius = 1.03 * float(CONFIG.arm.body.radius(SHAPE.s[station]))
            inside = np.abs(samples @ corner / distance) <= distance - radius
            # Four standard errors of the share.
            assert inside.mean() == pytest.approx(
                INSIDE, abs=4.0 * np.sqrt(INSIDE * (1.0 - INSIDE) / COUNT)
            )


def test_cone_contains_the_directions_with_the_stated_probability():
    cov = covariance(3, 1e-3)
    arrow = DRAWING.arrow(np.zeros(3), FORCE, cov)
    # The cone ends in the section of the plane at the arrow's end with the probable forces.
    scale = np.linalg.norm(arrow.end) / np.linalg.norm(FORCE)
    assert_allclose(arrow.end, scale * FORCE, rtol=1e-12)
    axis = FORCE / np.linalg.norm(FORCE)
    rim = arrow.cone[:CORNERS] - arrow.end
    assert_allclose(rim @ axis, 0.0, atol=1e-12)
    samples = np.random.default_rng(2).multivariate_normal(np.zeros(3), scale**2 * cov, COUNT)
    axes = np.linalg.svd(axis[np.newaxis])[2][1:]
    # A linear map takes the ellipse to the unit circle.
    ellipse = rim @ axes.T
    basis = np.stack([ellipse[0], ellipse[CORNERS // 4]], axis=1)
    inside = np.linalg.norm(np.linalg.solve(basis, axes @ samples.T), axis=0) <= 1.0
    assert inside.mean() == pytest.approx(
        INSIDE, abs=4.0 * np.sqrt(INSIDE * (1.0 - INSIDE) / COUNT)
    )


def test_triangles_of_arrow_and_cone_face_outwards_for_forces_in_all_directions():
    for force in np.random.default_rng(3).normal(size=(20, 3)):
        arrow = DRAWING.arrow(np.zeros(3), force, covariance(4, 1e-3))
        assert np.linalg.det(arrow.shaft[ARROW_TRIANGLES]).sum() > 0.0  # six times the volume
        assert np.linalg.det(arrow.cone[CONE_TRIANGLES]).sum() > 0.0


def test_insignificant_force_has_no_arrow():
    cov = np.diag([0.01, 0.002, 0.004]) ** 2
    assert DRAWING.arrow(np.zeros(3), 0.5 * FORCE, cov) is None
    assert DRAWING.arrow(np.zeros(3), 2.0 * FORCE, cov) is not None


def test_arrow_grows_with_the_force_to_a_limit_and_rotates_with_it():
    cov = 1e-12 * np.eye(3)
    lengths = [
        np.linalg.norm(DRAWING.arrow(np.zeros(3), factor * FORCE, cov).end)
        for factor in (1.0, 2.0, 1e6)
    ]
    assert lengths[1] == pytest.approx(2.0 * lengths[0])
    assert lengths[2] == pytest.approx(0.6 * CONFIG.arm.length)
    rotation = Rotation.from_rotvec([0.3, 1.0, -0.5])
    start = np.array([0.1, 0.2, 0.3])
    arrow = DRAWING.arrow(start, FORCE, cov)
    rotated = DRAWING.arrow(start, rotation.apply(FORCE), cov)
    assert_allclose(rotation.apply(arrow.end - start), rotated.end - start, atol=1e-12)
    assert ARROW_TRIANGLES.max() == len(arrow.shaft) - 1
    assert CONE_TRIANGLES.max() == len(arrow.cone) - 1


def test_strip_has_corners_and_the_volume_of_its_body():
    body = RectangularBody(0.3, 0.02, 0.006)
    solver = Solver(Arm(Material(1e5), body, (Section(0.3, 0.002, 0.002),)), 'exact', 2)
    shape = solver.solve(np.zeros((1, 4)))
    drawing = Drawing(solver.arm, solver.grid.s)
    drawn = drawing.draw(shape.position, shape.quaternion, shape.q)
    corners = drawn.vertices[:-2].reshape(-1, 2, 3)[::3, 1]
    assert_allclose(
        corners[:, 1:], [[0.01, 0.003], [-0.01, 0.003], [-0.01, -0.003], [0.01, -0.003]]
    )
    a, b, c = drawn.vertices[drawing.triangles].swapaxes(0, 1)
    # Triangles that are anticlockwise from outside enclose the volume of the body.
    volume = np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0
    assert_allclose(volume, 0.3 * 0.02 * 0.006)


# Self-intersection -------------------------------------------------------------------------------


RADIUS = 0.01


def overlap_of(position, radius=RADIUS):
    position = np.asarray(position, dtype=float)
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    s = np.append(0.0, np.cumsum(steps))
    return deepest_overlap(s, position, np.broadcast_to(radius, s.shape)), s


def arc(bend_radius, angle, stations=201):
    t = np.linspace(0.0, angle, stations)
    return bend_radius * np.stack([np.sin(t), 1.0 - np.cos(t), 0.0 * t], axis=1)


@pytest.mark.parametrize(
    ('wide', 'angle', 'does'),
    [
        (1.01, 0.5, False),
        (1.01, np.pi, False),
        (3.0, 1.5 * np.pi, False),
        (0.8, 1.4 * np.pi, True),
    ],
)
def test_bend_tighter_than_the_body_overlaps(wide, angle, does):
    assert (overlap_of(arc(wide * RADIUS, angle))[0] is not None) == does


def test_ring_overlaps_unless_its_gap_exceeds_its_thickness():
    gap = 2.0 * np.arcsin(1.05 * RADIUS / 0.05)
    assert overlap_of(arc(0.05, 2.0 * np.pi - gap))[0] is None
    assert overlap_of(arc(0.05, 2.0 * np.pi - 0.9 * gap))[0] is not None
    overlap, s = overlap_of(arc(0.05, 2.0 * np.pi))
    assert overlap.depth == pytest.approx(2.0 * RADIUS, rel=1e-6)
    assert_allclose(overlap.s, [0.0, s[-1]], atol=1e-9)
    cone, _ = overlap_of(arc(0.05, 2.0 * np.pi), np.linspace(0.02, 0.004, len(s)))
    assert cone.depth == pytest.approx(0.024, rel=1e-6)
    for position in ([[0, 0, 0]], [[0, 0, 0], [1, 0, 0]], np.linspace([0, 0, 0], [0.4, 0, 0], 9)):
        assert overlap_of(position)[0] is None


@given(st.floats(0.0, 0.03), st.floats(0.3, 2.8), st.integers(0, 2**32 - 1))
def test_depth_of_overlap_of_crossing_parts(distance, angle, seed):
    # Two straight parts that cross at their middles, joined far away.
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    first = np.linspace([-0.2, 0, 0], [0.2, 0, 0], 41)
    second = np.linspace(-0.2 * along, 0.2 * along, 38) + [0.0, 0.0, distance]
    behind = -3.0 * along
    far = [[2, 0, 0], [2, 0, 3], behind + [0, 0, 3], behind + [0, 0, distance]]
    position = np.concatenate([first, far, second])
    quaternion = np.random.default_rng(seed).normal(size=4)
    turn = axes_of(quaternion / np.linalg.norm(quaternion))
    overlap, s = overlap_of(position @ turn.T + 0.1)
    depth = 2.0 * RADIUS - distance
    if depth <= 1e-9:
        assert overlap is None or overlap.depth < 1e-9
        return
    assert overlap.depth == pytest.approx(depth, abs=1e-9)
    ends = 0.2, s[-1] - 0.2
    assert_allclose(overlap.s, ends, atol=1e-6)
