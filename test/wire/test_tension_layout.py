"""Messages read by the layout of another mean what the full reader says."""

import importlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from octo_arm_msgs.msg import TendonTensions
from rclpy.serialization import deserialize_message, serialize_message

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.wire.tension_layout import TensionLayout
from octo_arm_model.wire.tensions import (
    TENDON_TENSIONS,
    TENSION_TOPICS,
)

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


def layout_like(example):
    full = deserialize_message(example, TendonTensions)
    return TensionLayout(TENDON_TENSIONS, example, full, ARM)


def assert_read_right(layout, data, must_be_alike=False):
    """What is read is bit for bit what the full reader reads."""
    found = layout.read(data)
    if found is None:
        assert not must_be_alike
        return
    tensions, stamp = found
    full = deserialize_message(data, TendonTensions)
    expected = TENDON_TENSIONS.read(full, ARM)
    assert tensions.shape == expected.shape and tensions.tobytes() == expected.tobytes()
    assert stamp == (full.header.stamp.sec, full.header.stamp.nanosec)


@given(NAMES, FRAMES, TENSIONS, TENSIONS, STAMPS)
def test_a_message_with_other_tensions_and_stamp_is_read(names, frame, before, after, stamp):
    layout = layout_like(serialize_message(message(names, before, frame=frame)))
    data = serialize_message(message(names, after, stamp, frame))
    assert_read_right(layout, data, must_be_alike=True)


@given(NAMES, NAMES, FRAMES, FRAMES, TENSIONS)
def test_other_names_or_frames_are_never_taken_for_the_same(names, others, frame, other, tensions):
    layout = layout_like(serialize_message(message(names, tensions, frame=frame)))
    data = serialize_message(message(others, tensions, frame=other))
    if (names, frame) != (others, other):
        assert layout.read(data) is None


@given(st.data(), TENSIONS)
def test_changed_bytes_are_read_right_or_left_to_the_full_reader(data, tensions):
    example = serialize_message(message(ARM.tendon_names, tensions, frame='arm'))
    changed = bytearray(example)
    for place in data.draw(st.lists(st.integers(0, len(example) - 1), min_size=1, max_size=3)):
        changed[place] = data.draw(st.integers(0, 255))
    assert_read_right(layout_like(example), bytes(changed))


def made(kind, random, stamp, is_shaped):
    """A message of any type of tensions, and what the full reader makes of it."""
    package, _, name = kind.type_name.split('/')
    full = getattr(importlib.import_module(f'{package}.msg'), name)()
    for field in kind.fields:
        if field == 'header':
            full.header.stamp.sec, full.header.stamp.nanosec = stamp
            full.header.frame_id = 'arm'
        elif field == kind.names:
            setattr(full, field, list(ARM.tendon_names)[::-1])
        elif field == 'layout' and is_shaped:
            module = importlib.import_module('std_msgs.msg')
            full.layout.dim = [
                module.MultiArrayDimension(label='section', size=3, stride=12),
                module.MultiArrayDimension(label='', size=4, stride=4),
            ]
        elif field == kind.tensions or (is_shaped and field == 'position'):
            values = random.uniform(0.0, 9.0, 12).astype('<f4')
            setattr(full, field, values.tolist())
    data = serialize_message(full)
    return data, deserialize_message(data, type(full))


@pytest.mark.parametrize('is_shaped', [False, True])
@pytest.mark.parametrize('kind', TENSION_TOPICS.values(), ids=lambda kind: kind.type_name)
def test_messages_of_every_type_are_read_alone_and_together(kind, is_shaped):
    random = np.random.default_rng(0)
    stamps = [(number - 2, 7 * number) for number in range(5)]
    some = [made(kind, random, stamp, is_shaped) for stamp in stamps]
    messages = [data for data, _ in some]
    layout = TensionLayout(kind, *some[0], ARM)
    expected = np.array([kind.read(full, ARM) for _, full in some])
    alone = [layout.read(data) for data in messages]
    np.testing.assert_array_equal([tensions for tensions, _ in alone], expected)
    assert [stamp for _, stamp in alone] == (stamps if kind.has_stamp else [None] * 5)
    other_encoding = b'\0\0\0\0' + messages[2][4:]
    together = layout.read_all([b'', messages[0][:-1], *messages, other_encoding])
    assert together.places == [2, 3, 4, 5, 6]
    np.testing.assert_array_equal(together.tensions, expected)
    assert together.tensions.dtype == np.float64
    assert together.stamps == (stamps if kind.has_stamp else None)
