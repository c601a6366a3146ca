"""Tensions read from bags, one by one and together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('rosbags', reason='needs rosbags')

from recordings import (
    ARM,
    ARRAY,
    CONFIG,
    JOINT_STATE,
    NAMES,
    START,
    STEP,
    TOPICS,
    TYPES,
    bag_of_all,
    random_tensions,
    readings_of,
    samples,
    tensions_data,
    write_bag,
)

from octo_arm_model.bags.reader import BagReader, stamp_of
from octo_arm_model.bags.tensions import TYPES as TENSION_TYPES
from octo_arm_model.bags.tensions import TensionTopic
from octo_arm_model.bags.topics import pick_topic
from octo_arm_model.wire.tensions import TENSION_TOPICS

BAG_OF_ALL = bag_of_all()


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


@st.composite
def messages(draw: st.DrawFn) -> list[tuple[str, bytes]]:
    """Messages of one type, most of them alike but for stamp and numbers."""
    kind = draw(st.sampled_from(list(TOPICS.values())))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    some = []
    for _ in range(draw(st.integers(1, 12))):
        values = rng.uniform(0.0, 1.0, 12)
        order = rng.permutation(12)
        names = [NAMES[i] for i in order] if draw(st.integers(0, 3)) == 0 else list(NAMES)
        change: dict[str, Any] = {}
        what = draw(st.integers(0, 9))
        if what == 0:
            values[draw(st.integers(0, 11))] = draw(st.sampled_from([np.nan, np.inf, -1.0, 1e300]))
        elif what == 1:
            values = values[: draw(st.integers(0, 11))]
        elif what == 2 and kind == JOINT_STATE:
            change = {'position': rng.normal(size=draw(st.sampled_from([3, 12])))}
            change['velocity'] = rng.normal(size=15 - change['position'].size)
        elif what == 3:
            names[0] = draw(st.sampled_from(['elbow', NAMES[1]]))
        data = tensions_data(kind, names, values, draw(st.sampled_from([0, 1, START])), **change)
        if what == 4:
            data = data[: draw(st.integers(0, len(data)))]
        some.append((kind, data))
    return some


@settings(max_examples=30)
@given(messages())
def test_messages_read_together_are_those_read_one_by_one(some: list[tuple[str, bytes]]) -> None:
    kind = some[0][0]
    with BagReader(BAG_OF_ALL) as reader:
        (topic,) = (topic for topic, own in TOPICS.items() if own == kind)
        first = next(reader.messages([topic]))
        records = [first._replace(data=data, received_ns=i) for i, (_, data) in enumerate(some)]
        topic_of_all = TensionTopic(reader, CONFIG)
        found = topic_of_all.read(records) + topic_of_all.read(records)
        expected = [TensionTopic(reader, CONFIG).read([record])[0] for record in records]
    for one, other in zip(found, expected * 2, strict=True):
        assert (one.stamp_ns, one.reason) == (other.stamp_ns, other.reason)
        np.testing.assert_array_equal(one.tensions, other.tensions)


@pytest.mark.parametrize('topic', TOPICS)
def test_every_topic_of_tensions_is_read(tmp_path: Path, topic: str) -> None:
    tensions = random_tensions(ARM, 300).astype(np.float32)  # which every type can hold
    path = write_bag(tmp_path / 'bag', samples(ARM, tensions, topic, TOPICS[topic]))
    with BagReader(path) as reader:
        assert pick_topic(reader, None, TENSION_TYPES, 'tensions') == topic
    found = readings_of(path, topic)
    np.testing.assert_array_equal([one.tensions for one in found], tensions)
    late = 0 if TENSION_TOPICS[topic[1:]].has_stamp else 1000  # by receipt
    assert [one.stamp_ns for one in found] == [START + i * STEP + late for i in range(300)]
