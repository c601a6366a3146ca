"""Tensions read from bags."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recordings import (
    ARM,
    ARRAY,
    JOINT_STATE,
    NAMES,
    START,
    STEP,
    TOPICS,
    TYPES,
    random_tensions,
    readings_of,
    samples,
    tensions_data,
    write_bag,
)

from octo_arm_model.bags.reader import BagReader, stamp_of
from octo_arm_model.bags.tensions import TYPES as TENSION_TYPES
from octo_arm_model.bags.topics import pick_topic


def test_a_stamp_is_that_of_the_header_or_of_receipt() -> None:
    message = TYPES.deserialize_cdr(tensions_data(ARRAY, NAMES, np.ones(12), 7), ARRAY)
    assert stamp_of(message, 5) == (0, 5)
    for stamp, expected in ((7, (0, 7)), (0, (0, 5)), (3 * 10**9 + 4, (3, 4))):
        data = tensions_data(JOINT_STATE, NAMES, np.ones(12), stamp)
        assert stamp_of(TYPES.deserialize_cdr(data, JOINT_STATE), 5) == expected


def test_bytes_that_are_no_message_are_refused_with_the_time_of_receipt(tmp_path: Path) -> None:
    content = samples(ARM, random_tensions(ARM, 3))
    content[1] = content[1]._replace(data=b'\0\1\0\0garbage')
    found = readings_of(write_bag(tmp_path / 'bag', content))
    assert found[1].stamp_ns == content[1].received_ns
    assert 'bytes that are no octo_arm_msgs/msg/TendonTensions' in found[1].reason


@pytest.mark.parametrize('topic', TOPICS)
def test_every_topic_of_tensions_is_read(tmp_path: Path, topic: str) -> None:
    tensions = random_tensions(ARM, 300).astype(np.float32)  # which every type can hold
    path = write_bag(tmp_path / 'bag', samples(ARM, tensions, topic, TOPICS[topic]))
    with BagReader(path) as reader:
        assert pick_topic(reader, None, TENSION_TYPES, 'tensions') == topic
    found = readings_of(path, topic)
    np.testing.assert_array_equal([one.tensions for one in found], tensions)
    late = 0 if topic.endswith(('tendon_tensions', 'joint_state')) else 1000  # by receipt
    assert [one.stamp_ns for one in found] == [START + i * STEP + late for i in range(300)]
