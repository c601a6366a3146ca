"""Messages read by their likeness to another mean what the real reader says."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from octo_arm_msgs.msg import TendonTensions
from rclpy.serialization import deserialize_message, serialize_message

from octo_arm_model import load_config
from octo_arm_model.config.presets import preset_path
from octo_arm_model.wire.tension_messages import tensions_from_tendon_tensions
from octo_arm_model.wire.tension_template import Familiar

ARM = load_config(preset_path('renda2012_table4')).arm
NAMES = st.permutations(ARM.tendon_names)
FRAMES = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=20)
TENSIONS = st.lists(st.floats(), min_size=12, max_size=12)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))


def message(names, tensions, stamp=(1, 2), frame=''):
    made = TendonTensions(name=list(names), tension=tensions)
    made.header.frame_id = frame
    made.header.stamp.sec, made.header.stamp.nanosec = stamp
    return made


def assert_read_right(familiar, data, must_be_familiar=False):
    """What is read is bit for bit what the full reader reads."""
    found = familiar.read(data)
    if found is None:
        assert not must_be_familiar
        return
    tensions, stamp = found
    full = deserialize_message(data, TendonTensions)
    expected = tensions_from_tendon_tensions(full, ARM)
    assert tensions.shape == expected.shape and tensions.tobytes() == expected.tobytes()
    assert stamp == (full.header.stamp.sec, full.header.stamp.nanosec)


@given(NAMES, FRAMES, TENSIONS, TENSIONS, STAMPS)
def test_a_message_with_other_tensions_and_stamp_is_read(names, frame, before, after, stamp):
    familiar = Familiar(serialize_message(message(names, before, frame=frame)), names, ARM)
    data = serialize_message(message(names, after, stamp, frame))
    # The serialiser leaves what it finds in the bytes that pad, which may make it unfamiliar.
    assert_read_right(familiar, data)


@given(NAMES, FRAMES, TENSIONS, TENSIONS, STAMPS)
def test_messages_of_one_layout_are_familiar(names, frame, before, after, stamp):
    example = serialize_message(message(names, before, frame=frame))
    data = bytearray(example)
    data[4:12] = struct.pack('<iI', *stamp)
    # By the full reader's count the tensions are last.
    data[-8 * 12 :] = np.array(after, '<f8').tobytes()
    assert_read_right(Familiar(example, names, ARM), bytes(data), must_be_familiar=True)


@given(NAMES, NAMES, FRAMES, FRAMES, TENSIONS)
def test_other_names_or_frames_are_never_taken_for_the_same(names, others, frame, other, tensions):
    familiar = Familiar(serialize_message(message(names, tensions, frame=frame)), names, ARM)
    data = serialize_message(message(others, tensions, frame=other))
    if (names, frame) != (others, other):
        assert familiar.read(data) is None


@given(st.data(), TENSIONS)
def test_changed_bytes_are_read_right_or_left_to_the_full_reader(data, tensions):
    example = serialize_message(message(ARM.tendon_names, tensions, frame='arm'))
    changed = bytearray(example)
    for place in data.draw(st.lists(st.integers(0, len(example) - 1), min_size=1, max_size=3)):
        changed[place] = data.draw(st.integers(0, 255))
    assert_read_right(Familiar(example, ARM.tendon_names, ARM), bytes(changed))


@pytest.mark.parametrize('cut', [0, 3, 4, 11, 12, 40, 200, -1])
def test_other_lengths_are_left_to_the_full_reader(cut):
    example = serialize_message(message(ARM.tendon_names, [0.0] * 12))
    familiar = Familiar(example, ARM.tendon_names, ARM)
    assert familiar.read(example[:cut]) is None
    assert familiar.read(example + b'\0') is None


def test_nothing_is_like_an_example_of_another_encoding():
    example = b'\0\0\0\0' + serialize_message(message(ARM.tendon_names, [0.0] * 12))[4:]
    assert Familiar(example, ARM.tendon_names, ARM).read(example) is None
