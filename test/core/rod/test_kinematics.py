"""Kinematics (1): known curves, an ODE solver, the order of the method and orthonormality."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from scipy.special import fresnel

from octo_arm_model import Arm, Body, ConfigError, Material, Pose, Section
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod import grid
from octo_arm_model.rod.stations import StationGrid
from octo_arm_model.core.rod.kinematics import Frame, backbone_frames

ARM = Arm(Material(1e5), Body(1.0, 0.1, 0.1), (Section(1.0, 0.0, 0.0),))
CURVATURE = st.floats(-40.0, 40.0, allow_subnormal=False)
AXIAL = st.floats(-0.9, 0.5, allow_subnormal=False)


def curve(
    strains: Callable[[np.ndarray], tuple], stations: int = 101, base: Pose = Pose()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stations, positions and rotation matrices of an arm of length 1 with these strains."""
    stations_and_nodes = StationGrid.build(ARM, stations)
    nodes, count = stations_and_nodes.nodes, stations_and_nodes.s.size
    values = np.stack([np.broadcast_to(part, nodes.shape) for part in strains(nodes)])
    position, quaternion = np.empty((1, count, 3)), np.empty((1, count, 4))
    frame = Frame(np.array(base.position), Quaternions.from_xyzw(base.quaternion))
    tau, xi, k, q = values
    twist = np.stack([(1 + q) * tau, (1 + q) * xi, (1 + q) * k, 1 + q])[:, np.newaxis]
    backbone_frames(twist, stations_and_nodes, frame, position, quaternion)
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=-1), 1.0, rtol=0.0, atol=1e-12)
    return stations_and_nodes.s, position[0], Rotation.from_quat(quaternion[0]).as_matrix()


def test_no_strain_is_a_straight_line_along_the_tangent() -> None:
    s, position, rotation = curve(lambda s: (0.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(position, np.outer(s, [1.0, 0.0, 0.0]), atol=1e-12)
    np.testing.assert_array_equal(rotation, np.broadcast_to(np.eye(3), rotation.shape))


def test_curvature_about_b_is_an_arc_towards_n() -> None:
    s, position, _ = curve(lambda s: (0.0, 0.0, 5.0, 0.0))
    arc = np.stack([np.sin(5 * s), 1 - np.cos(5 * s), 0 * s], axis=1) / 5
    np.testing.assert_allclose(position, arc, atol=1e-12)


def test_curvature_about_n_is_an_arc_away_from_b() -> None:
    s, position, _ = curve(lambda s: (0.0, 5.0, 0.0, 0.0))
    arc = np.stack([np.sin(5 * s), 0 * s, np.cos(5 * s) - 1], axis=1) / 5
    np.testing.assert_allclose(position, arc, atol=1e-12)


def test_compression_shortens_the_arc_and_keeps_its_radius() -> None:
    s, position, _ = curve(lambda s: (0.0, 0.0, 5.0, -0.4))
    arc = np.stack([np.sin(3 * s), 1 - np.cos(3 * s), 0 * s], axis=1) / 5
    np.testing.assert_allclose(position, arc, atol=1e-12)


def test_torsion_alone_turns_n_towards_b_and_moves_nothing_aside() -> None:
    s, position, rotation = curve(lambda s: (2.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(position, np.outer(s, [1.0, 0.0, 0.0]), atol=1e-12)
    n = np.stack([0 * s, np.cos(2 * s), np.sin(2 * s)], axis=1)
    np.testing.assert_allclose(rotation[:, :, 1], n, atol=1e-12)


def test_constant_torsion_and_curvature_are_a_helix() -> None:
    tau, k = 6.0, 8.0
    s, position, _ = curve(lambda s: (tau, 0.0, k, 0.0))
    turn, radius, climb = 10.0 * s, k / 100.0, tau / 10.0
    # Axis along (tau, 0, k) / 10 at a distance of one radius towards n.
    axis, side, normal = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6]), np.eye(3)[1]
    helix = (
        np.outer(climb * s, axis)
        + np.outer(radius * np.sin(turn), side)
        + np.outer(radius * (1 - np.cos(turn)), normal)
    )
    np.testing.assert_allclose(position, helix, atol=1e-12)


def test_linear_curvature_is_the_spiral_of_cornu() -> None:
    s, position, _ = curve(lambda s: (0.0, 0.0, 12.0 * s, 0.0))
    scale = math.sqrt(math.pi / 12.0)
    y, x = fresnel(s / scale)
    np.testing.assert_allclose(position[:, 0], scale * x, atol=1e-8)
    np.testing.assert_allclose(position[:, 1], scale * y, atol=1e-8)


@given(CURVATURE, CURVATURE, CURVATURE, AXIAL)
def test_constant_strains_are_the_exponential_of_one_screw(
    tau: float, xi: float, k: float, q: float
) -> None:
    _, position, rotation = curve(lambda s: (tau, xi, k, q), 2)
    screw = (1 + q) * np.array([[0, -k, xi, 1], [k, 0, -tau, 0], [-xi, tau, 0, 0], [0, 0, 0, 0]])
    motion = expm(screw)
    np.testing.assert_allclose(position[-1], motion[:3, 3], atol=1e-11)
    np.testing.assert_allclose(rotation[-1], motion[:3, :3], atol=1e-11)


@given(st.integers(-320, 0), CURVATURE, CURVATURE, CURVATURE)
def test_strains_near_zero_lose_no_digits(exponent: int, tau: float, xi: float, k: float) -> None:
    tiny = 10.0**exponent / 40.0
    _, position, _ = curve(lambda s: (tau * tiny, xi * tiny, k * tiny, 0.0), 2)
    # Second order in the strains is exact to 1e-12 relative below 1e-6.
    if exponent <= -6:
        bend = 0.5 * tiny * np.array([k, -xi])
        np.testing.assert_allclose(position[-1, 1:], bend, rtol=1e-5, atol=1e-12 * tiny * 40)
    assert position[-1, 0] == pytest.approx(1.0, abs=1.0 if exponent > -6 else 1e-11)


def varying(s: np.ndarray) -> tuple:
    """Strains with all components, far from commuting."""
    return (
        5.0 * np.cos(3.0 * s) + 2.0,
        8.0 * np.sin(4.0 * s) - 3.0,
        6.0 + 9.0 * s**2,
        -0.3 + 0.25 * np.sin(5.0 * s),
    )


def by_ode(stations: np.ndarray, base: Pose = Pose()) -> reference.Shape:
    stretch = (0.0, 1.0, lambda s: np.array([float(part) for part in varying(s)]))
    return reference.integrate_kinematics([stretch], stations, base)


def test_varying_strains_follow_equation_1_from_any_base_pose() -> None:
    turn = Rotation.from_euler('xyz', [0.3, -1.1, 2.0])
    base = Pose((0.1, -0.2, 0.3), tuple(turn.as_quat()))
    s, position, rotation = curve(varying, base=base)
    expected = by_ode(s, base)
    np.testing.assert_allclose(position, expected.position, atol=3e-7)
    np.testing.assert_allclose(rotation, expected.rotation, atol=3e-6)


@pytest.mark.parametrize('what', ['position', 'rotation'])
def test_the_method_is_of_fourth_order(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid, 'MIN_INTERVALS', 1)
    monkeypatch.setattr(grid, 'STEP_PER_RADIUS', 100.0)
    errors = []
    for intervals in (16, 32, 64):
        s, position, rotation = curve(varying, intervals + 1)
        got = {'position': position, 'rotation': rotation}[what]
        errors.append(np.abs(got[-1] - getattr(by_ode(s), what)[-1]).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() > 3.8, (errors, orders)


@given(st.lists(st.tuples(CURVATURE, CURVATURE, CURVATURE, AXIAL), min_size=4, max_size=4))
def test_frames_stay_orthonormal_however_wild_the_strains(rows: list) -> None:
    waves = np.array(rows).T

    def strains(s: np.ndarray) -> np.ndarray:
        # A mean of the rows with varying weights: rough, and q stays above -0.9.
        weights = np.cos(np.outer([1.0, 30.0, 70.0, 200.0], s)) ** 2
        return waves @ (weights / weights.sum(axis=0))

    _, _, rotation = curve(strains)
    np.testing.assert_allclose(
        rotation.transpose(0, 2, 1) @ rotation, np.broadcast_to(np.eye(3), rotation.shape),
        atol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-12)


def test_the_local_x_axis_is_the_tangent_of_the_curve() -> None:
    s, position, rotation = curve(varying, 2001)
    chord = (position[2:] - position[:-2]) / (s[2:] - s[:-2])[:, np.newaxis]
    stretch = 1.0 + varying(s)[3][1:-1, np.newaxis]
    np.testing.assert_allclose(rotation[1:-1, :, 0] * stretch, chord, atol=2e-4)


@pytest.mark.parametrize(
    ('position', 'quaternion', 'message'),
    [
        ((0.0, 0.0), (0, 0, 0, 1), r'base.position is \(0.0, 0.0\), expected 3 finite numbers'),
        ((0.0, 0.0, math.nan), (0, 0, 0, 1), 'base.position is .*nan.*, expected 3 finite'),
        ((0.0, 0.0, 2e9), (0, 0, 0, 1), r'base.position is .*, expected 3 .* at most 1e\+09'),
        ('here', (0, 0, 0, 1), "base.position is 'here', expected 3 finite numbers"),
        ((0, 0, 0), (0, 0, 1), r'base.quaternion is \(0, 0, 1\), expected 4 finite numbers'),
        ((0, 0, 0), (0, 0, math.inf, 1), 'base.quaternion is .*inf.*, expected 4 finite numbers'),
        ((0, 0, 0), (0, 0, 0, 0), 'of length 0, expected x, y, z, w of length 1'),
        ((0, 0, 0), (1, 0, 0, 1), 'of length 1.41421, expected x, y, z, w of length 1'),
    ],
)
def test_impossible_base_poses_are_refused(
    position: tuple, quaternion: tuple, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        Pose(position, quaternion)
    named = message.replace('base.position', 'shift').replace('base.quaternion', 'turn')
    with pytest.raises(ConfigError, match=named):
        Pose.called('shift', 'turn', position, quaternion)


def test_a_rounded_base_quaternion_is_made_unit() -> None:
    assert math.hypot(*Pose(quaternion=(0.7071, 0.0, 0.0, 0.7071)).quaternion) == pytest.approx(
        1.0, abs=1e-12
    )
