"""What is drawn: tubes and arrows of what is probable, colours of tensions, bases of arms."""

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
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
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


def test_the_body_ends_within_the_tube_as_often_as_is_said():
    given = np.stack([covariance(number, 1e-3) for number in range(21)])
    tube = DRAWING.tube(SHAPE.position, SHAPE.quaternion, given)
    rings = tube[:-2].reshape(-1, 21, 3)
    for station in (0, 7, 20):
        moved = np.random.default_rng(1).multivariate_normal(np.zeros(3), given[station], COUNT)
        for corner in rings[::4, station] - SHAPE.position[station]:
            reach = np.linalg.norm(corner)
            radius = 1.03 * float(CONFIG.arm.body.radius(SHAPE.s[station]))
            inside = np.abs(moved @ corner / reach) <= reach - radius
            # Four standard errors of a share.
            assert inside.mean() == pytest.approx(
                INSIDE, abs=4.0 * np.sqrt(INSIDE * (1.0 - INSIDE) / COUNT)
            )


def test_the_cone_holds_as_much_of_the_directions_as_is_said():
    given = covariance(3, 1e-3)
    arrow = DRAWING.arrow(np.zeros(3), FORCE, given)
    # Where the plane through its end cuts the probable forces, which are drawn to its scale.
    scale = np.linalg.norm(arrow.end) / np.linalg.norm(FORCE)
    assert_allclose(arrow.end, scale * FORCE, rtol=1e-12)
    along = FORCE / np.linalg.norm(FORCE)
    rim = arrow.cone[:CORNERS] - arrow.end
    assert_allclose(rim @ along, 0.0, atol=1e-12)
    samples = np.random.default_rng(2).multivariate_normal(np.zeros(3), scale**2 * given, COUNT)
    axes = np.linalg.svd(along[np.newaxis])[2][1:]
    # A point is within an ellipse if it is within the linear image that makes that a circle.
    ellipse = rim @ axes.T
    basis = np.stack([ellipse[0], ellipse[CORNERS // 4]], axis=1)
    inside = np.linalg.norm(np.linalg.solve(basis, axes @ samples.T), axis=0) <= 1.0
    assert inside.mean() == pytest.approx(
        INSIDE, abs=4.0 * np.sqrt(INSIDE * (1.0 - INSIDE) / COUNT)
    )


def test_a_force_that_may_be_none_has_no_arrow():
    given = np.diag([0.01, 0.002, 0.004]) ** 2
    assert DRAWING.arrow(np.zeros(3), 0.5 * FORCE, given) is None
    assert DRAWING.arrow(np.zeros(3), 2.0 * FORCE, given) is not None


def test_arrows_grow_with_the_force_up_to_a_length_and_turn_with_it():
    given = 1e-12 * np.eye(3)
    lengths = [
        np.linalg.norm(DRAWING.arrow(np.zeros(3), part * FORCE, given).end)
        for part in (1.0, 2.0, 1e6)
    ]
    assert lengths[1] == pytest.approx(2.0 * lengths[0])
    assert lengths[2] == pytest.approx(0.6 * CONFIG.arm.length)
    turn = Rotation.from_rotvec([0.3, 1.0, -0.5])
    start = np.array([0.1, 0.2, 0.3])
    one = DRAWING.arrow(start, FORCE, given)
    other = DRAWING.arrow(start, turn.apply(FORCE), given)
    assert_allclose(turn.apply(one.end - start), other.end - start, atol=1e-12)
    assert ARROW_TRIANGLES.max() == len(one.shaft) - 1
    assert CONE_TRIANGLES.max() == len(one.cone) - 1


def test_a_strip_is_drawn_with_its_corners():
    body = RectangularBody(0.3, 0.02, 0.006)
    solver = Solver(Arm(Material(1e5), body, (Section(0.3, 0.002, 0.002),)), 'exact', 2)
    found = solver.solve(np.zeros((1, 4)))
    drawing = Drawing(solver.arm, solver.grid.s)
    drawn = drawing.draw(found.position, found.quaternion, found.q)
    corners = drawn.vertices[:-2].reshape(-1, 2, 3)[::3, 1]
    assert_allclose(
        corners[:, 1:], [[0.01, 0.003], [-0.01, 0.003], [-0.01, -0.003], [0.01, -0.003]]
    )
    a, b, c = drawn.vertices[drawing.triangles].swapaxes(0, 1)
    # Triangles anticlockwise from outside enclose the volume of the body.
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
def test_a_bend_does_that_is_tighter_than_the_body(wide, angle, does):
    assert (overlap_of(arc(wide * RADIUS, angle))[0] is not None) == does


def test_a_ring_does_unless_it_is_open_by_more_than_it_is_thick():
    gap = 2.0 * np.arcsin(1.05 * RADIUS / 0.05)
    assert overlap_of(arc(0.05, 2.0 * np.pi - gap))[0] is None
    assert overlap_of(arc(0.05, 2.0 * np.pi - 0.9 * gap))[0] is not None
    found, s = overlap_of(arc(0.05, 2.0 * np.pi))
    assert found.depth == pytest.approx(2.0 * RADIUS, rel=1e-6)
    assert_allclose(found.s, [0.0, s[-1]], atol=1e-9)
    for position in ([[0, 0, 0]], [[0, 0, 0], [1, 0, 0]], np.linspace([0, 0, 0], [0.4, 0, 0], 9)):
        assert overlap_of(position)[0] is None


@given(st.floats(0.0, 0.03), st.floats(0.3, 2.8), st.integers(0, 2**32 - 1))
def test_crossing_parts_overlap_by_what_they_are_too_near(distance, angle, seed):
    # Two straight parts that cross in their middles, joined far away.
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    first = np.linspace([-0.2, 0, 0], [0.2, 0, 0], 41)
    second = np.linspace(-0.2 * along, 0.2 * along, 38) + [0.0, 0.0, distance]
    behind = -3.0 * along
    far = [[2, 0, 0], [2, 0, 3], behind + [0, 0, 3], behind + [0, 0, distance]]
    position = np.concatenate([first, far, second])
    quaternion = np.random.default_rng(seed).normal(size=4)
    turn = axes_of(quaternion / np.linalg.norm(quaternion))
    found, s = overlap_of(position @ turn.T + 0.1)
    depth = 2.0 * RADIUS - distance
    if depth <= 1e-9:
        assert found is None or found.depth < 1e-9
        return
    assert found.depth == pytest.approx(depth, abs=1e-9)
    ends = 0.2, s[-1] - 0.2
    assert_allclose(found.s, ends, atol=1e-6)


def test_of_a_cone_it_is_the_radius_there_that_counts():
    position = arc(0.05, 2.0 * np.pi)
    radius = np.linspace(0.02, 0.004, len(position))
    found, _ = overlap_of(position, radius)
    assert found.depth == pytest.approx(0.024, rel=1e-6)


def test_the_arm_that_fetches_does_not_and_one_that_coils_up_does():
    config = load_config('renda2012_table4')
    solver = config.solver()
    radius = config.arm.body.radius(solver.grid.s)
    coiled = np.zeros((3, 4))
    coiled[2, 2] = 13.0
    coiled[1, 2] = 4.0
    coiled[0, 2] = 0.42
    shapes = [solver.solve(tensions) for tensions in (np.zeros((3, 4)), coiled)]
    straight, curled = (deepest_overlap(b.s, b.position, radius) for b in shapes)
    assert straight is None
    assert 0.0 < curled.s[0] < curled.s[1] <= config.arm.length
    fetching = solver.solve(FETCHING_IN_PLANE)
    assert deepest_overlap(fetching.s, fetching.position, radius) is None
