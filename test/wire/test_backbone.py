"""Messages written as bytes are those the real serialiser makes of message objects."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from backbone_messages import assert_hold
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    PoseArray,
    PoseWithCovarianceStamped,
    Transform,
    TransformStamped,
)
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model import Backbone, ConfigError, load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.messages import backbone_messages, pose_message
from octo_arm_model.wire.backbone import BackboneBatchWriter, BackboneWriter, read_poses
from octo_arm_model.wire.markers import FramesWriter, MarkersWriter

CONFIG = load_config(preset_path('renda2012_table4'))
SOLVER = CONFIG.solver('closed_form', 11)
SIZES = {'double': 8, 'float': 4, 'int32': 4, 'uint32': 4, 'uint8': 1, 'boolean': 1}
# A message ends its strings at a NUL, and UTF-8 has no surrogates: see the tests of their own.
TEXTS = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=40)
SECONDS = st.integers(-(2**31), 2**31 - 1)
NANOSECONDS = st.integers(0, 2**32 - 1)


class Meaning:
    """Which bytes of a serialised message say something, from the type of the message alone.

    The others pad it, and the serialiser leaves in them what the memory held before.
    """

    def __init__(self, message):
        self.bytes = bytearray()
        self.add_message(message)

    def mask(self):
        return np.frombuffer(b'\1' * 4 + self.bytes, np.uint8).astype(bool)

    def add_message(self, message):
        for name, kind in message.get_fields_and_field_types().items():
            self.add_field(kind, getattr(message, name))

    def add_field(self, kind, value):
        if kind.startswith('sequence<'):
            self.add_numbers(4, 1)
            self.add_items(kind[len('sequence<') : -1], value)
        elif kind.endswith(']'):
            self.add_items(kind.split('[')[0], value)
        elif kind == 'string':
            self.add_numbers(4, 1)
            self.add_numbers(1, len(value.encode()) + 1)
        elif kind in SIZES:
            self.add_numbers(SIZES[kind], 1)
        else:
            self.add_message(value)

    def add_items(self, kind, values):
        if kind in SIZES:
            self.add_numbers(SIZES[kind], len(values))
        else:
            for value in values:
                self.add_field(kind, value)

    def add_numbers(self, size, count):
        if count:
            self.bytes += bytes(-len(self.bytes) % size) + b'\1' * (size * count)


def assert_serialised(ours, message, beyond=0):
    """Every byte of ``ours`` is the serialiser's, or pads and is zero.

    The serialiser returns as many bytes as it estimated, which may be up to ``beyond`` too many
    where sequences are empty.
    """
    assert isinstance(ours, bytes)
    real = serialize_message(message)
    meaning = Meaning(message).mask()
    assert len(ours) == len(meaning) and 0 <= len(real) - len(ours) <= beyond
    ours_bytes = np.frombuffer(ours, np.uint8)
    real_bytes = np.frombuffer(real, np.uint8)[: len(ours)]
    np.testing.assert_array_equal(ours_bytes[meaning], real_bytes[meaning])
    assert not ours_bytes[~meaning].any()
    assert deserialize_message(ours, type(message)) == message


def made_up(stations, model='closed_form', seed=0):
    """A backbone of numbers of every size and sign; infinite ones, zeros and subnormals too."""
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


def three(writer, backbone, sec, nanosec):
    return [write(backbone, sec, nanosec) for write in (writer.path, writer.poses, writer.strains)]


def assert_three(writer, backbone, frame, sec, nanosec):
    messages = backbone_messages(backbone, Time(sec=sec, nanosec=nanosec), frame)
    for ours, message in zip(three(writer, backbone, sec, nanosec), messages, strict=True):
        assert_serialised(ours, message)


@settings(max_examples=30)
@given(
    frame=TEXTS,
    model=TEXTS,
    stations=st.integers(2, 200),
    stamps=st.lists(st.tuples(SECONDS, NANOSECONDS), min_size=1, max_size=2),
    seed=st.integers(0, 2**16),
)
@example('', '', 2, [(-(2**31), 2**32 - 1), (2**31 - 1, 0)], 0)
@example('Arm/Basis-Süd', 'renda2012', 101, [(-1, 999_999_999)], 1)
@example('触手😀', 'exact', 200, [(0, 0)], 2)
def test_every_byte_is_the_serialisers(frame, model, stations, stamps, seed):
    backbone = made_up(stations, model, seed)
    writer = writer_for(backbone, frame)
    for number, stamp in enumerate(stamps):
        # The template holds another backbone and stamp by then.
        shaken = made_up(stations, model, seed + number)
        shaken = dataclasses.replace(shaken, s=backbone.s, section=backbone.section)
        assert_three(writer, shaken, frame, *stamp)


@pytest.mark.parametrize('letter', ['a', 'ä', '触'])
def test_every_length_of_names_shifts_what_follows_as_it_should(letter):
    for stations, length in itertools.product((2, 3), range(41)):
        for model in ('abcdefgh'[: length % 9], 'abcdefgh'[: length // 5]):
            backbone = made_up(stations, model, length)
            frame = letter * length
            assert_three(writer_for(backbone, frame), backbone, frame, length, 7)


@given(
    frame=TEXTS,
    names=st.lists(TEXTS, max_size=12),
    sec=SECONDS,
    nanosec=NANOSECONDS,
    seed=st.integers(0, 2**16),
)
@example('abc', [], 1, 2, 0)
@example('', [], 1, 2, 0)
def test_tip_and_tendons_likewise(frame, names, sec, nanosec, seed):
    random = np.random.default_rng(seed)
    backbone = made_up(2, seed=seed)
    writer = writer_for(backbone, frame, names)
    stamp = Time(sec=sec, nanosec=nanosec)
    covariance = random.normal(size=(6, 6))
    tip = PoseWithCovarianceStamped(header=Header(stamp=stamp, frame_id=frame))
    tip.pose.pose = pose_message(backbone.position[-1], backbone.quaternion[-1])
    tip.pose.covariance = covariance.ravel()
    assert_serialised(writer.tip_pose(backbone, covariance, sec, nanosec), tip)
    lengths, tensions = random.normal(size=(2, len(names)))
    joints = JointState(
        header=Header(stamp=stamp, frame_id=frame), name=names, position=lengths, effort=tensions
    )
    assert_serialised(writer.tendon_lengths(lengths, tensions, sec, nanosec), joints, beyond=24)


@settings(max_examples=15)
@given(frame=TEXTS, stations=st.integers(6, 60), seed=st.integers(0, 2**16))
@example('', 6, 0)
@example('触手😀', 61, 1)
@example('Arm/Basis-Süd', 30, 2)
def test_markers_likewise(frame, stations, seed):
    random = np.random.default_rng(seed)
    solver = CONFIG.solver('closed_form', stations)
    writer = MarkersWriter(CONFIG.arm, solver.grid.s, frame, widen=bool(seed % 2))
    for sec in (-(2**31), seed):  # the template holds another shape and stamp by then
        backbone = solver.solve(random.uniform(0.0, 0.3, CONFIG.arm.tension_shape))
        ours = writer.write(backbone, sec, 5, random.choice([None, 0.1]))
        message = deserialize_message(ours, MarkerArray)
        assert {m.header.frame_id for m in message.markers} == {frame}
        assert {(m.header.stamp.sec, m.header.stamp.nanosec) for m in message.markers} == {
            (sec, 5)
        }
        # What a marker does not use is as in a new one.
        for marker in message.markers:
            for name in ('colors', 'texture', 'uv_coordinates', 'text', 'mesh_file', 'lifetime'):
                assert getattr(marker, name) == getattr(Marker(), name)
        assert_serialised(ours, message, beyond=24)


@given(frame=TEXTS, prefix=TEXTS, sec=SECONDS, nanosec=NANOSECONDS, seed=st.integers(0, 2**16))
@example('', '', 1, 2, 0)
@example('arm_base', '触手😀/', 1, 2, 0)
def test_frames_likewise(frame, prefix, sec, nanosec, seed):
    backbone = dataclasses.replace(made_up(11, seed=seed), s=SOLVER.grid.s)
    ours = FramesWriter(CONFIG.arm, backbone.s, frame, prefix).write(backbone, sec, nanosec)
    message = TFMessage()
    at = [SOLVER.grid.s.tolist().index(section.anchorage) for section in CONFIG.arm.sections]
    for name, station in zip(['tip', 'anchorage_1', 'anchorage_2', 'anchorage_3'], [-1, *at]):
        pose = pose_message(backbone.position[station], backbone.quaternion[station])
        transform = Transform(rotation=pose.orientation)
        for axis in 'xyz':
            setattr(transform.translation, axis, getattr(pose.position, axis))
        header = Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame)
        message.transforms.append(
            TransformStamped(header=header, child_frame_id=prefix + name, transform=transform)
        )
    assert_serialised(ours, message)


def test_a_solved_arm_arrives_as_it_was_solved():
    backbone = SOLVER.solve(FETCHING_IN_SPACE)
    grid = SOLVER.grid
    names = CONFIG.arm.tendon_names
    writer = BackboneWriter('here', 'closed_form', grid.s, grid.section, names)
    kinds = Path, PoseArray, SectionStrains
    path, poses, strains = (
        deserialize_message(ours, kind)
        for ours, kind in zip(three(writer, backbone, -3, 4), kinds, strict=True)
    )
    for message in (path, poses, strains, *path.poses):
        assert message.header == Header(stamp=Time(sec=-3, nanosec=4), frame_id='here')
    assert_hold(path, poses, strains, backbone)
    lengths = SOLVER.tendon_lengths(backbone)
    ours = writer.tendon_lengths(lengths, backbone.tensions, -3, 4)
    joints = deserialize_message(ours, JointState)
    assert joints.header == path.header and joints.name == list(names)
    np.testing.assert_array_equal(joints.position, lengths.ravel())
    np.testing.assert_array_equal(joints.effort, backbone.tensions.ravel())
    assert not joints.velocity


def test_bytes_stay_when_the_next_are_written():
    first, second = made_up(5, seed=1), made_up(5, seed=2)
    second = dataclasses.replace(second, section=first.section)
    writer = writer_for(first, names=['a', 'b'])

    def everything(backbone, sec):
        lengths = backbone.tau[:2]
        return [
            *three(writer, backbone, sec, 0),
            writer.tip_pose(backbone, np.full((6, 6), float(sec)), sec, 0),
            writer.tendon_lengths(lengths, lengths, sec, 0),
        ]

    before = everything(first, 1)
    kept = [bytearray(message) for message in before]
    after = everything(second, 2)
    assert before == kept
    assert all(one != other for one, other in zip(before, after, strict=True))
    assert everything(first, 1) == before


@settings(max_examples=30)
@given(
    frame=TEXTS,
    model=TEXTS,
    stations=st.integers(2, 120),
    stamps=st.lists(st.tuples(SECONDS, NANOSECONDS), min_size=1, max_size=4),
    seed=st.integers(0, 2**16),
)
@example('', '', 2, [(-(2**31), 2**32 - 1), (2**31 - 1, 0)], 0)
@example('触手😀', 'exact', 101, [(-1, 999_999_999)] * 3, 2)
def test_a_batch_is_written_like_single_solutions(frame, model, stations, stamps, seed):
    some = [made_up(stations, model, seed + number) for number in range(len(stamps))]
    some = [dataclasses.replace(one, section=some[0].section) for one in some]
    varying = 'position', 'quaternion', 'tau', 'xi', 'k', 'q'
    stacked = {name: np.stack([getattr(one, name) for one in some]) for name in varying}
    batch = dataclasses.replace(some[0], **stacked)
    writer = writer_for(some[0], frame)
    expected = [
        (*three(writer, one, *stamp), writer.tip_pose(one, np.zeros((6, 6)), *stamp))
        for one, stamp in zip(some, stamps, strict=True)
    ]
    together = BackboneBatchWriter(frame, model, batch.s, batch.section)
    together.write(batch, np.array(stamps)[::-1], len(stamps))  # other messages, kept apart
    before = together.write(batch, np.array(stamps), 0)
    together.write(batch, np.array(stamps)[::-1], len(stamps))
    assert before == expected


def test_names_end_at_a_nul_as_those_of_messages_do():
    backbone = made_up(3, 'exact\0x')
    writer = writer_for(backbone, 'ä\0b')
    plain = dataclasses.replace(backbone, model='exact')
    messages = backbone_messages(plain, Time(sec=1, nanosec=2), 'ä')
    cut = backbone_messages(backbone, Time(sec=1, nanosec=2), 'ä\0b')
    for ours, message, with_nul in zip(three(writer, backbone, 1, 2), messages, cut, strict=True):
        assert_serialised(ours, message)
        assert deserialize_message(serialize_message(with_nul), type(message)) == message


@pytest.mark.parametrize('method', ['path', 'poses', 'strains', 'tip_pose'])
def test_another_shape_is_refused(method):
    writer = writer_for(SOLVER.solve(FETCHING_IN_SPACE))
    rest = (np.zeros((6, 6)),) if method == 'tip_pose' else ()
    # A batch of one would broadcast, as would a single station.
    others = {
        r'\(1, 11, 3\)': SOLVER.solve(np.array([FETCHING_IN_SPACE])),
        r'\(2, 11, 3\)': SOLVER.solve(np.zeros((2, 3, 4))),
        r'\(12, 3\)': CONFIG.solver('closed_form', 12).solve(FETCHING_IN_SPACE),
        r'\(1, 3\)': made_up(1),
    }
    for shape, backbone in others.items():
        with pytest.raises(ConfigError, match=rf'of shape {shape}, expected \(11, 3\)'):
            getattr(writer, method)(backbone, *rest, 0, 0)


def test_strains_of_another_arm_or_model_are_refused():
    backbone = made_up(4)
    writer = writer_for(backbone)
    for other in (
        {'model': 'exact'},
        {'s': backbone.s * 1.1},
        {'section': backbone.section + 1},
    ):
        with pytest.raises(ConfigError, match='another model or other stations'):
            writer.strains(dataclasses.replace(backbone, **other), 0, 0)
    # The same stations need not be the same arrays.
    copied = dataclasses.replace(backbone, s=backbone.s.copy(), section=backbone.section.copy())
    assert writer.strains(copied, 0, 0) == writer.strains(backbone, 0, 0)


def test_tip_and_lengths_of_another_shape_are_refused():
    backbone = made_up(4)
    writer = writer_for(backbone, names=['a', 'b'])
    with pytest.raises(ConfigError, match=r'covariance is of shape \(6,\), expected \(6, 6\)'):
        writer.tip_pose(backbone, np.zeros(6), 0, 0)
    for counts in ((1, 2), (2, 1), (3, 3)):
        lengths, tensions = (np.zeros(count) for count in counts)
        with pytest.raises(ConfigError, match='expected 2 of each'):
            writer.tendon_lengths(lengths, tensions, 0, 0)


@pytest.mark.parametrize(('sec', 'nanosec'), [(2**31, 0), (-(2**31) - 1, 0), (0, -1), (0, 2**32)])
def test_stamps_a_message_cannot_hold_are_refused(sec, nanosec):
    backbone = made_up(2)
    with pytest.raises(ConfigError, match=f'stamp is {sec} s, {nanosec} ns'):
        writer_for(backbone).path(backbone, sec, nanosec)


def test_what_cannot_be_laid_out_is_refused():
    for s, section in ((np.zeros(1), np.zeros(1, int)), (np.zeros(3), np.zeros(2, int))):
        with pytest.raises(ConfigError, match='one value for each of two or more stations'):
            BackboneWriter('', '', s, section)
    for names in (('\ud800', '', ()), ('', '\ud800', ()), ('', '', ('\ud800',))):
        frame, model, tendons = names
        with pytest.raises(ConfigError, match='UTF-8 cannot hold'):
            BackboneWriter(frame, model, np.zeros(2), np.zeros(2, int), tendons)


@pytest.mark.parametrize('count', [0, 1, 101])
@given(frame=st.text(st.characters(codec='ascii', exclude_characters='\0'), max_size=20))
def test_poses_are_read_from_bytes_as_ros_reads_them(count, frame):
    header = Header(stamp=Time(sec=-3, nanosec=250_000_000), frame_id=frame)
    expected = np.random.default_rng(count).normal(size=(count, 7))
    message = PoseArray(header=header, poses=[pose_message(p[:3], p[3:]) for p in expected])
    stamp, poses = read_poses(serialize_message(message))
    assert stamp == -2.75
    np.testing.assert_array_equal(poses, expected)
