"""Markers of the arm as serialised messages, read by ROS."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('visualization_msgs', reason='needs visualization_msgs')

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model import load_config
from octo_arm_model.analysis.drawing import MOST_RINGS, anchorage_stations, tension_colours
from octo_arm_model.arm.material import LINEAR, NEO_HOOKEAN
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.wire.markers import MarkersWriter

STAMP = Time(sec=12, nanosec=34)
CONFIG = load_config(preset_path('renda2012_table4'))
ARM = CONFIG.arm
SOLVER = CONFIG.solver('exact')
S = SOLVER.grid.s
SHAPE = SOLVER.solve(FETCHING_IN_SPACE)


def draw(backbone=SHAPE, arm=ARM, largest=None, **options):
    writer = MarkersWriter(arm, backbone.s, 'arm_base', **options)
    return read(writer.write(backbone, STAMP.sec, STAMP.nanosec, largest))


def read(data):
    return deserialize_message(data, MarkerArray)


def named(message, namespace):
    return [marker for marker in message.markers if marker.ns == namespace]


def coordinates(points):
    return np.array([[point.x, point.y, point.z] for point in points])


FRAMES = Rotation.from_quat(SHAPE.quaternion).as_matrix()


@pytest.mark.parametrize('law', [LINEAR, NEO_HOOKEAN])
def test_vertices_of_the_body_lie_on_its_surface(law):
    (body,) = named(draw(law=law), 'body')
    vertices = np.unique(coordinates(body.points), axis=0)
    # In the plane of the nearest cross section that they are in at all.
    local = np.einsum('nji,vnj->vni', FRAMES, vertices[:, np.newaxis] - SHAPE.position)
    distance = np.linalg.norm(local[..., 1:], axis=-1)
    radius = ARM.body.radius(S) * ((1.0 + SHAPE.q) ** -0.5 if law == NEO_HOOKEAN else 1.0)
    on_surface = (np.abs(local[..., 0]) < 1e-12) & (np.abs(distance - radius) < 1e-12)
    centres = (np.linalg.norm(local, axis=-1) < 1e-12).any(axis=1)
    assert (on_surface.any(axis=1) | centres).all()
    assert on_surface.any(axis=0).all()  # every station has its ring
    assert on_surface.sum() == 12 * S.size
    assert centres.sum() == 2


def test_the_body_is_closed_and_its_triangles_wind_outwards():
    (body,) = named(draw(), 'body')
    triangles = coordinates(body.points).reshape(-1, 3, 3)
    first, second, third = triangles.transpose(1, 0, 2)
    normal = np.cross(second - first, third - first)
    assert (np.linalg.norm(normal, axis=1) > 0.0).all()
    # Every edge is shared by two triangles that run along it in opposite directions.
    edges = {}
    for corners in triangles.tolist():
        corners = [tuple(corner) for corner in corners]
        for a, b in zip(corners, corners[1:] + corners[:1]):
            edges[a, b] = edges.get((a, b), 0) + 1
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    # Away from the midline, but for the two ends, which face along it.
    middle = triangles.mean(axis=1)
    nearest = np.linalg.norm(middle[:, np.newaxis] - SHAPE.position, axis=-1).argmin(axis=1)
    outward = np.einsum('ti,ti->t', normal, middle - SHAPE.position[nearest])
    side = slice(0, -24)
    assert (outward[side] > 0.0).all()
    assert (normal[-24:-12] @ FRAMES[0, :, 0] < 0.0).all()
    assert (normal[-12:] @ FRAMES[-1, :, 0] > 0.0).all()
    # The volume enclosed is that of a cone with polygons of twelve sides for circles. Bending
    # does not change it (Pappus), stretching does.
    volume = np.einsum('ti,ti->', first, np.cross(second, third)) / 6.0
    area = 6.0 * np.sin(np.pi / 6.0) * ARM.body.radius(S) ** 2
    slices = area * (1.0 + SHAPE.q)
    expected = 0.5 * np.diff(S) @ (slices[1:] + slices[:-1])
    assert volume == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize('law', [LINEAR, NEO_HOOKEAN])
def test_tendons_follow_their_offsets_up_to_their_anchorage(law):
    tendons = named(draw(law=law), 'tendons')
    assert len(tendons) == len(ARM.tendons)
    along_n, along_b = ARM.tendon_offsets(S)
    width = (1.0 + SHAPE.q) ** -0.5 if law == NEO_HOOKEAN else np.ones(S.size)
    for index, marker in enumerate(tendons):
        end = ARM.sections[ARM.tendon_section[index] - 1].anchorage
        inside = end + 1e-12 >= S
        points = coordinates(marker.points)
        assert marker.type == Marker.LINE_STRIP
        assert len(points) == inside.sum()
        local = np.einsum('nji,nj->ni', FRAMES[inside], points - SHAPE.position[inside])
        expected = np.array([0.0 * S, along_n[index] * width, along_b[index] * width]).T
        assert_allclose(local, expected[inside], atol=1e-12)
        assert S[inside][-1] == pytest.approx(end, abs=1e-12)


def test_discs_lie_across_the_arm_at_the_anchorages():
    discs = named(draw(), 'anchorages')
    stations = anchorage_stations(ARM, S)
    assert [S[i] for i in stations] == [section.anchorage for section in ARM.sections]
    for station, marker in zip(stations, discs, strict=True):
        pose = marker.pose
        assert marker.type == Marker.CYLINDER
        assert_array_equal(coordinates([pose.position])[0], SHAPE.position[station])
        turned = Rotation.from_quat(
            [getattr(pose.orientation, name) for name in 'xyzw']
        ).as_matrix()
        assert_allclose(turned[:, 2], FRAMES[station, :, 0], atol=1e-12)
        assert_allclose(turned[:, 1], FRAMES[station, :, 1], atol=1e-12)
        assert marker.scale.x == marker.scale.y
        assert 1.0 < marker.scale.x / (2.0 * ARM.body.radius(S[station])) < 1.1


@pytest.mark.parametrize('largest', [None, 40.0])
def test_tendons_have_the_colour_of_their_tension(largest):
    tendons = named(draw(largest=largest), 'tendons')
    drawn = [[m.color.r, m.color.g, m.color.b, m.color.a] for m in tendons]
    expected = tension_colours(SHAPE.tensions.ravel(), largest)
    assert_allclose(drawn, expected, atol=1e-6)
    reddest = np.argmax([m.color.r for m in tendons])
    assert reddest == SHAPE.tensions.argmax()


@pytest.mark.parametrize('stations', [5, 1001])
def test_any_number_of_stations_can_be_drawn(stations):
    solver = CONFIG.solver('closed_form', stations)
    message = draw(solver.solve(FETCHING_IN_SPACE))
    (body,) = named(message, 'body')
    vertices = np.unique(coordinates(body.points), axis=0)
    assert len(vertices) <= 12 * (MOST_RINGS + 3) + 2
    tip = coordinates(named(message, 'tendons')[0].points)[-1]
    shape = solver.solve(FETCHING_IN_SPACE)
    offset = ARM.sections[0].offset_anchorage
    assert np.linalg.norm(tip - shape.tip) == pytest.approx(offset, abs=1e-12)
