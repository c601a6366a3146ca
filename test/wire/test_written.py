"""Messages written as bytes are those the real serialiser makes of message objects."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from backbone_messages import messages_of
from builtin_interfaces.msg import Time
from clouds import profiles_of
from geometry_msgs.msg import (
    PoseArray,
    PoseWithCovarianceStamped,
    Transform,
    TransformStamped,
)
from octo_arm_msgs.msg import BackboneCovariance
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model import Backbone, ConfigError, Solver, load_config
from octo_arm_model.analysis.drawing import ARROW_TRIANGLES, CONE_TRIANGLES, UncertaintyDrawing
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.ros.messages import pose_message
from octo_arm_model.wire.backbone import (
    BackboneWriter,
    TensionProfilesWriter,
    read_poses,
)
from octo_arm_model.wire.estimate import read_covariance
from octo_arm_model.wire.markers import FramesWriter, MarkersWriter, UncertaintyMarkersWriter

CONFIG = load_config('renda2012_table4')
SOLVER = CONFIG.solver('closed_form', 11)
# A message ends its strings at a NUL, and UTF-8 has no surrogates: see the tests of their own.
TEXTS = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=40)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
SEEDS = st.integers(0, 2**16)


def assert_serialised(ours, message, beyond=0):
    """What ``ours`` say is ``message``, in as many bytes as the serialiser takes.

    That returns as many bytes as it estimated, which may be up to ``beyond`` too many where
    sequences are empty.
    """
    assert isinstance(ours, bytes)
    assert 0 <= len(serialize_message(message)) - len(ours) <= beyond
    assert deserialize_message(ours, type(message)) == message


def made_up(stations, model='closed_form', seed=0):
    """A backbone of numbers of every size and sign; infinite ones, zeros and subnormals too."""
    random = np.random.default_rng(seed)

    def numbers(*shape):
        values = random.normal(size=shape) * 10.0 ** random.integers(-300, 300, shape)
        values.flat[:: 1 + seed % 5] = random.choice([0.0, -0.0, np.inf, -np.inf, 5e-324])
        return values

    return Backbone(
        model=model, s=np.linspace(0.0, 0.45, stations), section=random.integers(0, 4, stations),
        position=numbers(stations, 3), quaternion=numbers(stations, 4), tau=numbers(stations),
        xi=numbers(stations), k=numbers(stations), q=numbers(stations),
        tensions=numbers(*CONFIG.arm.tension_shape), tip_wrench=np.zeros(6),
        residual=np.array(0.0), iterations=np.array(0),
    )  # fmt: skip


def writer_for(backbone, frame='arm_base', names=()):
    return BackboneWriter(frame, backbone.model, backbone.s, backbone.section, names)


def header_of(frame, stamp):
    return Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id=frame)


def four(backbone, frame, stamp, covariance):
    """Path, poses, strains and pose of the tip, as objects."""
    three = messages_of(backbone, header_of(frame, stamp).stamp, frame)
    tip = PoseWithCovarianceStamped(header=header_of(frame, stamp))
    tip.pose.pose, tip.pose.covariance = three[1].poses[-1], covariance.ravel()
    return *three, tip


@settings(max_examples=30)
@given(TEXTS, TEXTS, st.integers(2, 120), st.lists(STAMPS, min_size=1, max_size=3), SEEDS)
@example('', '', 2, [(-(2**31), 2**32 - 1), (2**31 - 1, 0)], 0)
@example('Arm/Basis-Süd', 'renda2012', 101, [(-1, 999_999_999)], 1)
@example('触手😀', 'exact', 120, [(0, 0), (1, 2)], 2)
def test_backbones_are_written(frame, model, stations, stamps, seed):
    some = [made_up(stations, model, seed + number) for number in range(len(stamps))]
    some = [dataclasses.replace(one, section=some[0].section) for one in some]
    writer, zero = writer_for(some[0], frame), np.zeros((6, 6))
    alone = [tuple(writer.all(one, zero, *stamp)) for one, stamp in zip(some, stamps)]
    # What was written before stays when the next is.
    for ours, one, stamp in zip(alone, some, stamps, strict=True):
        for data, message in zip(ours, four(one, frame, stamp, zero), strict=True):
            assert_serialised(data, message)


@given(TEXTS, st.lists(TEXTS, max_size=12), STAMPS, SEEDS)
@example('abc', [], (1, 2), 0)
@example('', [], (1, 2), 0)
def test_tip_and_tendons_likewise(frame, names, stamp, seed):
    random, header = np.random.default_rng(seed), header_of(frame, stamp)
    backbone = made_up(2, seed=seed)
    writer, covariance = writer_for(backbone, frame, names), random.normal(size=(6, 6))
    tip = four(backbone, frame, stamp, covariance)[-1]
    assert_serialised(writer.tip_pose(backbone, covariance, *stamp), tip)
    lengths, tensions = random.normal(size=(2, len(names)))
    joints = JointState(header=header, name=names, position=lengths, effort=tensions)
    assert_serialised(writer.tendon_lengths(lengths, tensions, *stamp), joints, beyond=24)


@settings(max_examples=15)
@given(TEXTS, st.integers(6, 60), SEEDS)
@example('', 6, 0)
@example('触手😀', 61, 1)
def test_markers_likewise(frame, stations, seed):
    random = np.random.default_rng(seed)
    solver = CONFIG.solver('closed_form', stations)
    writer = MarkersWriter(CONFIG.arm, solver.grid.s, frame, widen=bool(seed % 2))
    for sec in (-(2**31), seed):  # the template holds another shape and stamp by then
        backbone = solver.solve(random.uniform(0.0, 0.3, CONFIG.arm.tension_shape))
        ours = writer.write(backbone, sec, 5, random.choice([None, 0.1]))
        message = deserialize_message(ours, MarkerArray)
        assert_serialised(ours, message, beyond=24)
        # What a marker does not use is as in a new one.
        for marker in message.markers:
            assert marker.header == header_of(frame, (sec, 5))
            for name in ('colors', 'texture', 'uv_coordinates', 'text', 'mesh_file', 'lifetime'):
                assert getattr(marker, name) == getattr(Marker(), name)


@given(TEXTS, TEXTS, STAMPS, SEEDS)
@example('', '', (1, 2), 0)
@example('arm_base', '触手😀/', (1, 2), 0)
def test_frames_likewise(frame, prefix, stamp, seed):
    backbone = dataclasses.replace(made_up(11, seed=seed), s=SOLVER.grid.s)
    ours = FramesWriter(CONFIG.arm, backbone.s, frame, prefix).write(backbone, *stamp)
    message = TFMessage()
    at = [SOLVER.grid.s.tolist().index(section.anchorage) for section in CONFIG.arm.sections]
    for name, station in zip(['tip', 'anchorage_1', 'anchorage_2', 'anchorage_3'], [-1, *at]):
        pose = pose_message(backbone.position[station], backbone.quaternion[station])
        transform = Transform(rotation=pose.orientation)
        for axis in 'xyz':
            setattr(transform.translation, axis, getattr(pose.position, axis))
        message.transforms.append(TransformStamped(
            header=header_of(frame, stamp), child_frame_id=prefix + name, transform=transform,
        ))  # fmt: skip
    assert_serialised(ours, message)


@given(TEXTS, st.lists(TEXTS, min_size=12, max_size=12), st.integers(4, 60), STAMPS)
@example('', [''] * 12, 4, (-1, 2**32 - 1))
@example('触手😀', ['x', 'y', 'z', 's', *map(str, range(8))], 5, (7, 0))
def test_tensions_along_tendons_are_where_the_fields_say(frame, names, stations, stamp):
    backbone = CONFIG.solver('closed_form', stations).solve(FETCHING_IN_SPACE)
    ours = TensionProfilesWriter(frame, backbone.s, names).write(backbone, *stamp)
    message = deserialize_message(ours, PointCloud2)
    assert_serialised(ours, message)
    assert message.header == header_of(frame, stamp)
    fields = [field.name for field in message.fields]
    assert fields == ['x', 'y', 'z', 's', *(f'tension_{name}' for name in names)]
    found = profiles_of(message)
    np.testing.assert_allclose(found[:, :3], backbone.position, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(found[:, 3], backbone.s)
    np.testing.assert_array_equal(found[:, 4:], backbone.tendon_tensions)


def test_an_estimate_is_drawn_as_a_tube_and_an_arrow_in_its_cone_or_none():
    arm = load_config('renda2012_prototype').arm
    shape = Solver(arm, 'exact', 21).solve([[1.0, 0.4, 0.3, 0.5]])
    covariance, of_force = np.tile(1e-6 * np.eye(3), (21, 1, 1)), 1e-6 * np.eye(3)
    drawing, force = UncertaintyDrawing(arm, shape.s), np.array([0.0, -0.006, 0.01])
    tube = drawing.tube(shape.position, shape.quaternion, covariance)[drawing.triangles]
    arrow = drawing.arrow(shape.tip, force, of_force)
    points = tube, arrow.shaft[ARROW_TRIANGLES], arrow.cone[CONE_TRIANGLES]
    for factor, actions in ((1.0, [Marker.ADD] * 3), (0.1, [0, Marker.DELETE, Marker.DELETE])):
        ours = UncertaintyMarkersWriter(arm, shape.s, '触手').write(
            shape.position, shape.quaternion, covariance, arm.length, factor * force, of_force,
            3, 4,
        )  # fmt: skip
        message = deserialize_message(ours, MarkerArray)
        assert_serialised(ours, message)
        assert [marker.ns for marker in message.markers] == ['covariance', 'contact', 'cone']
        assert [marker.action for marker in message.markers] == actions
        for marker, expected in zip(message.markers, points, strict=True):
            assert marker.header == header_of('触手', (3, 4))
            drawn = [(p.x, p.y, p.z) for p in marker.points]
            if marker.action == Marker.ADD:
                assert marker.pose.orientation.w == marker.scale.x == marker.scale.z == 1.0
                np.testing.assert_array_equal(drawn, expected.reshape(-1, 3))
            else:
                assert not drawn
        assert 0.0 < message.markers[0].color.a < 0.5


@pytest.mark.parametrize('given', [{'frame': '\ud800'}, {'names': ['\ud800']}])
def test_names_that_utf8_cannot_hold_are_refused(given):
    with pytest.raises(ConfigError, match='UTF-8 cannot hold'):
        writer_for(made_up(2), **given)
    with pytest.raises(ConfigError, match='UTF-8 cannot hold'):
        writer_for(made_up(2, '\ud800'))


def test_a_covariance_of_another_size_is_refused():
    with pytest.raises(MessageError, match='pose has 35 numbers, expected 36 for each of 1'):
        read_covariance(BackboneCovariance(s=[0.0], pose=[0.0] * 35))


@pytest.mark.parametrize(('sec', 'nanosec'), [(2**31, 0), (-(2**31) - 1, 0), (0, -1), (0, 2**32)])
def test_stamps_a_message_cannot_hold_are_refused(sec, nanosec):
    backbone = made_up(2)
    with pytest.raises(ConfigError, match=f'stamp is {sec} s, {nanosec} ns'):
        writer_for(backbone).path(backbone, sec, nanosec)


@pytest.mark.parametrize('count', [0, 1, 101])
@given(frame=st.text(st.characters(codec='ascii', exclude_characters='\0'), max_size=20))
def test_poses_are_read_from_bytes_as_ros_reads_them(count, frame):
    expected = np.random.default_rng(count).normal(size=(count, 7))
    poses = [pose_message(p[:3], p[3:]) for p in expected]
    message = PoseArray(header=header_of(frame, (-3, 250_000_000)), poses=poses)
    stamp, found = read_poses(serialize_message(message))
    assert stamp == -2.75
    np.testing.assert_array_equal(found, expected)
