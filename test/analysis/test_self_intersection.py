"""Self-intersection of shapes, and its threshold."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from octo_arm_model import load_config
from octo_arm_model.analysis.self_intersection import deepest_overlap
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.rotations import axes_of

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
    config = load_config(preset_path('renda2012_table4'))
    solver = config.solver()
    radius = config.arm.body.radius(solver.grid.s)
    coiled = np.zeros((3, 4))
    coiled[2, 2] = 13.0
    coiled[1, 2] = 4.0
    coiled[0, 2] = 0.42
    shapes = [solver.solve(tensions) for tensions in (np.zeros((3, 4)), coiled)]
    straight, curled = (deepest_overlap(b.s, b.position, radius) for b in shapes)
    assert straight is None
    assert curled is not None
    assert 0.0 < curled.s[0] < curled.s[1] <= config.arm.length
    fetching = solver.solve(FETCHING_IN_PLANE)
    assert deepest_overlap(fetching.s, fetching.position, radius) is None
