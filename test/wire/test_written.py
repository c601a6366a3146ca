"""Messages written as bytes are those the real serialiser makes of message objects."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from backbone_messages import messages_of
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from octo_arm_msgs.msg import BackboneCovariance
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from octo_arm_model import Backbone, ConfigError, Solver, load_config
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.ros.topics import pose_message
from octo_arm_model.wire.backbone import BackboneWriter, TensionProfilesWriter, read_poses
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


ARM = load_config('renda2012_prototype').arm
BENT = Solver(ARM, 'exact', 21).solve([[1.0, 0.4, 0.3, 0.5]])


def all_written(frame, names, stations, stamp, seed):
    """Every other message, and its type."""
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
    for largest in (None, 0.1):  # the template holds another message by then
        yield MarkerArray, markers.write(shape, *stamp, largest)
    known, of_force = np.tile(1e-6 * np.eye(3), (21, 1, 1)), 1e-6 * np.eye(3)
    for force in (np.array([0.0, -0.006, 0.01]), np.zeros(3)):
        yield (
            MarkerArray,
            UncertaintyMarkersWriter(ARM, BENT.s, frame).write(
                BENT.position, BENT.quaternion, known, (ARM.length, force, of_force), *stamp
            ),
        )


@settings(max_examples=15)
@given(TEXTS, st.lists(TEXTS, min_size=12, max_size=12), st.integers(6, 60), STAMPS, SEEDS)
@example('', [''] * 12, 6, (-1, 2**32 - 1), 0)
@example('触手😀', ['x', 'y', 'z', 's', *map(str, range(8))], 61, (7, 0), 1)
def test_all_others_likewise(frame, names, stations, stamp, seed):
    """What they hold is tested where nodes publish them."""
    for kind, ours in all_written(frame, names, stations, stamp, seed):
        message = deserialize_message(ours, kind)
        assert_serialised(ours, message, beyond=24)
        for one in getattr(message, 'markers', getattr(message, 'transforms', [message])):
            assert one.header == header_of(frame, stamp)


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
    assert_array_equal(found, expected)
