"""Messages written as bytes: agreement with the serialiser of ROS, and contents of markers."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('tf2_msgs', reason='needs tf2_msgs')
pytest.importorskip('visualization_msgs', reason='needs visualization_msgs')
from backbone_messages import messages_of
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from octo_arm_msgs.msg import BackboneCovariance
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model import Backbone, ConfigError, Solver, load_config
from octo_arm_model.analysis.drawing import MOST_RINGS, anchorage_stations, tension_colours
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.arm.material import LINEAR, NEO_HOOKEAN
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.ros.topics import pose_message
from octo_arm_model.wire.backbone import BackboneWriter, TensionProfilesWriter, read_poses
from octo_arm_model.wire.estimate import read_covariance
from octo_arm_model.wire.markers import FramesWriter, MarkersWriter, UncertaintyMarkersWriter

CONFIG = load_config('renda2012_table4')
# Without NUL and surrogates, which messages cannot have; other tests cover them.
TEXTS = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=40)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
SEEDS = st.integers(0, 2**16)


def assert_serialised(ours, message, beyond=0):
    """Check that the bytes ``ours`` are ``message`` with the length of the serialiser's.

    The serialiser may append up to ``beyond`` bytes if sequences are empty.
    """
    assert isinstance(ours, bytes)
    assert 0 <= len(serialize_message(message)) - len(ours) <= beyond
    assert deserialize_message(ours, type(message)) == message


def random_backbone(stations, model='closed_form', seed=0):
    """Return a backbone with numbers of all sizes, infinities, zeros and subnormals."""
    random = np.random.default_rng(seed)

    def numbers(*shape):
        values = random.normal(size=shape) * 10.0 ** random.integers(-300, 300, shape)
        values.flat[:: 1 + seed % 5] = random.choice([0.0, -0.0, np.inf, -np.inf, 5e-324])
        return values

    return Backbone(
        model=model,
        s=np.linspace(0.0, 0.45, stations),
        section=random.integers(0, 4, stations),
        position=numbers(stations, 3),
        quaternion=numbers(stations, 4),
        tau=numbers(stations),
        xi=numbers(stations),
        k=numbers(stations),
        q=numbers(stations),
        tensions=numbers(*CONFIG.arm.tension_shape),
        tip_wrench=np.zeros(6),
        residual=np.array(0.0),
        iterations=np.array(0),
    )


def writer_for(backbone, frame='arm_base', names=()):
    return BackboneWriter(frame, backbone.model, backbone.s, backbone.section, names)


def header_of(frame, stamp):
    return Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id=frame)


def messages_with_tip(backbone, frame, stamp, covariance):
    """Return path, poses, strains and pose of the tip as objects."""
    three = messages_of(backbone, header_of(frame, stamp).stamp, frame)
    tip = PoseWithCovarianceStamped(header=header_of(frame, stamp))
    tip.pose.pose, tip.pose.covariance = three[1].poses[-1], covariance.ravel()
    return *three, tip


@settings(max_examples=30)
@given(TEXTS, TEXTS, st.integers(2, 120), st.lists(STAMPS, min_size=1, max_size=3), SEEDS)
@example('', '', 2, [(-(2**31), 2**32 - 1), (2**31 - 1, 0)], 0)
@example('Arm/Basis-Süd', 'renda2012', 101, [(-1, 999_999_999)], 1)
@example('触手😀', 'exact', 120, [(0, 0), (1, 2)], 2)
def test_backbones_are_serialised_as_by_ros(frame, model, stations, stamps, seed):
    backbones = [random_backbone(stations, model, seed + number) for number in range(len(stamps))]
    backbones = [dataclasses.replace(each, section=backbones[0].section) for each in backbones]
    writer, zero = writer_for(backbones[0], frame), np.zeros((6, 6))
    written = [writer.all(each, zero, *stamp).values() for each, stamp in zip(backbones, stamps)]
    # Compared after all are written: a message must not change with the next one.
    for ours, each, stamp in zip(written, backbones, stamps, strict=True):
        for data, message in zip(ours, messages_with_tip(each, frame, stamp, zero), strict=True):
            assert_serialised(data, message)


PROTOTYPE = load_config('renda2012_prototype').arm
BENT = Solver(PROTOTYPE, 'exact', 21).solve([[1.0, 0.4, 0.3, 0.5]])


def other_messages(frame, names, stations, stamp, seed):
    """Yield the type and the bytes of every other message."""
    random = np.random.default_rng(seed)
    solver = CONFIG.solver('closed_form', stations)
    shape, s = solver.solve(random.uniform(0.0, 0.3, (3, 4))), solver.grid.s
    writer, covariance = writer_for(shape, frame, names), random.normal(size=(6, 6))
    lengths, tensions = random.normal(size=(2, 12))
    yield PoseWithCovarianceStamped, writer.tip_pose(shape, covariance, *stamp)
    yield JointState, writer.tendon_lengths(lengths, tensions, *stamp)
    yield TFMessage, FramesWriter(CONFIG.arm, s, frame, names[0]).write(shape, *stamp)
    yield PointCloud2, TensionProfilesWriter(frame, s, names).write(shape, *stamp)
    markers = MarkersWriter(CONFIG.arm, s, frame, seed % 2)
    for largest in (None, 0.1):  # the second one reuses the template
        yield MarkerArray, markers.write(shape, *stamp, largest)
    noise, of_force = np.tile(1e-6 * np.eye(3), (21, 1, 1)), 1e-6 * np.eye(3)
    for force in (np.array([0.0, -0.006, 0.01]), np.zeros(3)):
        yield (
            MarkerArray,
            UncertaintyMarkersWriter(PROTOTYPE, BENT.s, frame).write(
                BENT.position, BENT.quaternion, noise, (PROTOTYPE.length, force, of_force), *stamp
            ),
        )


@settings(max_examples=15)
@given(TEXTS, st.lists(TEXTS, min_size=12, max_size=12), st.integers(6, 60), STAMPS, SEEDS)
@example('', [''] * 12, 6, (-1, 2**32 - 1), 0)
@example('触手😀', ['x', 'y', 'z', 's', *map(str, range(8))], 61, (7, 0), 1)
def test_other_messages_are_serialised_as_by_ros(frame, names, stations, stamp, seed):
    for kind, ours in other_messages(frame, names, stations, stamp, seed):
        message = deserialize_message(ours, kind)
        assert_serialised(ours, message, beyond=24)
        for part in getattr(message, 'markers', getattr(message, 'transforms', [message])):
            assert part.header == header_of(frame, stamp)


@pytest.mark.parametrize('given', [('m', '\ud800'), ('m', 'a', ['\ud800']), ('\ud800',)])
def test_names_that_are_not_utf8_are_refused(given):
    model, *others = given
    with pytest.raises(ConfigError, match='UTF-8 cannot hold'):
        writer_for(random_backbone(2, model), *others)


def test_covariance_of_wrong_size_is_refused():
    with pytest.raises(MessageError, match='pose has 35 numbers, expected 36 for each of 1'):
        read_covariance(BackboneCovariance(s=[0.0], pose=[0.0] * 35))


@pytest.mark.parametrize(('sec', 'nanosec'), [(2**31, 0), (-(2**31) - 1, 0), (0, -1), (0, 2**32)])
def test_stamps_out_of_range_are_refused(sec, nanosec):
    backbone = random_backbone(2)
    with pytest.raises(ConfigError, match=f'stamp is {sec} s, {nanosec} ns'):
        writer_for(backbone).path(backbone, sec, nanosec)


@pytest.mark.parametrize('count', [0, 1, 101])
@given(frame=st.text(st.characters(codec='ascii', exclude_characters='\0'), max_size=20))
def test_poses_are_read_as_by_ros(count, frame):
    expected = np.random.default_rng(count).normal(size=(count, 7))
    poses = [pose_message(p[:3], p[3:]) for p in expected]
    message = PoseArray(header=header_of(frame, (-3, 250_000_000)), poses=poses)
    stamp, read = read_poses(serialize_message(message))
    assert stamp == -2.75
    assert_array_equal(read, expected)


@given(SEEDS)
def test_bytes_that_are_no_poses_are_refused(seed):
    random = np.random.default_rng(seed)
    count = int(random.integers(0, 9))
    poses = [pose_message(p[:3], p[3:]) for p in random.normal(size=(count, 7))]
    data = serialize_message(PoseArray(header=header_of('x' * (seed % 9), (1, 2)), poses=poses))
    # Cut, too long, in another encoding, of another number of poses.
    cut, place = data[: random.integers(0, 20 + 56 * count)], 16 + -(-(seed % 9 + 1) // 4) * 4
    others = [data[:place] + bytes([n]) + data[place + 1 :] for n in range(9) if n != count]
    for wrong in (cut, data + bytes(16), b'\0\7' + data[2:], b'\1' + data[1:], *others):
        with pytest.raises(MessageError, match='bytes that are no PoseArray'):
            read_poses(wrong)


# Markers -----------------------------------------------------------------------------------------


STAMP = Time(sec=12, nanosec=34)
ARM = CONFIG.arm
SOLVER = CONFIG.solver('exact')
S = SOLVER.grid.s
SHAPE = SOLVER.solve(FETCHING_IN_SPACE)


def draw(backbone=SHAPE, arm=ARM, largest=None, **options):
    writer = MarkersWriter(arm, backbone.s, 'arm_base', **options)
    data = writer.write(backbone, STAMP.sec, STAMP.nanosec, largest)
    return deserialize_message(data, MarkerArray)


def markers_of(message, namespace):
    return [marker for marker in message.markers if marker.ns == namespace]


def coordinates(points):
    return np.array([[point.x, point.y, point.z] for point in points])


FRAMES = Rotation.from_quat(SHAPE.quaternion).as_matrix()


@pytest.mark.parametrize('law', [LINEAR, NEO_HOOKEAN])
def test_vertices_of_the_body_lie_on_its_surface(law):
    (body,) = markers_of(draw(law=law), 'body')
    vertices = np.unique(coordinates(body.points), axis=0)
    # In the plane of one of the cross sections.
    local = np.einsum('nji,vnj->vni', FRAMES, vertices[:, np.newaxis] - SHAPE.position)
    distance = np.linalg.norm(local[..., 1:], axis=-1)
    radius = ARM.body.radius(S) * ((1.0 + SHAPE.q) ** -0.5 if law == NEO_HOOKEAN else 1.0)
    on_surface = (np.abs(local[..., 0]) < 1e-12) & (np.abs(distance - radius) < 1e-12)
    centres = (np.linalg.norm(local, axis=-1) < 1e-12).any(axis=1)
    assert (on_surface.any(axis=1) | centres).all()
    assert on_surface.any(axis=0).all()  # every station has its ring
    assert on_surface.sum() == 12 * S.size
    assert centres.sum() == 2


def test_body_is_closed_with_outward_triangles():
    (body,) = markers_of(draw(), 'body')
    triangles = coordinates(body.points).reshape(-1, 3, 3)
    first, second, third = triangles.transpose(1, 0, 2)
    # Two triangles share every edge in opposite directions.
    edges = {}
    for corners in triangles.tolist():
        corners = [tuple(corner) for corner in corners]
        for a, b in zip(corners, corners[1:] + corners[:1]):
            edges[a, b] = edges.get((a, b), 0) + 1
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    # The volume is that of a cone with twelve-sided polygons as sections. Bending does not change
    # it (Pappus), stretching does.
    volume = np.einsum('ti,ti->', first, np.cross(second, third)) / 6.0
    area = 6.0 * np.sin(np.pi / 6.0) * ARM.body.radius(S) ** 2
    slices = area * (1.0 + SHAPE.q)
    expected = 0.5 * np.diff(S) @ (slices[1:] + slices[:-1])
    assert volume == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize('law', [LINEAR, NEO_HOOKEAN])
def test_tendons_follow_their_offsets_to_the_anchorage(law):
    tendons = markers_of(draw(law=law), 'tendons')
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


def test_discs_are_perpendicular_to_the_arm_at_the_anchorages():
    discs = markers_of(draw(), 'anchorages')
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
    tendons = markers_of(draw(largest=largest), 'tendons')
    drawn = np.array([[m.color.r, m.color.g, m.color.b, m.color.a] for m in tendons])
    expected = tension_colours(SHAPE.tensions.ravel(), largest)
    assert_allclose(drawn, expected, atol=1e-6)
    assert drawn[:, 0].argmax() == SHAPE.tensions.argmax()


@pytest.mark.parametrize('stations', [5, 1001])
def test_any_number_of_stations_can_be_drawn(stations):
    shape = CONFIG.solver('closed_form', stations).solve(FETCHING_IN_SPACE)
    message = draw(shape)
    (body,) = markers_of(message, 'body')
    vertices = np.unique(coordinates(body.points), axis=0)
    assert len(vertices) <= 12 * (MOST_RINGS + 3) + 2
    tip = coordinates(markers_of(message, 'tendons')[0].points)[-1]
    offset = ARM.sections[0].offset_anchorage
    assert np.linalg.norm(tip - shape.tip) == pytest.approx(offset, abs=1e-12)
