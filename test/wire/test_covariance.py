"""The covariance of an estimate as bytes, against the real serialiser."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from octo_arm_msgs.msg import BackboneCovariance
from rclpy.serialization import deserialize_message, serialize_message

from octo_arm_model import ConfigError
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.wire.estimate import CovarianceWriter, read_covariance

TEXTS = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=40)


@given(
    frame=TEXTS, stations=st.integers(2, 40), sec=st.integers(-(2**31), 2**31 - 1),
    nanosec=st.integers(0, 2**32 - 1), seed=st.integers(0, 2**32 - 1),
)  # fmt: skip
@example('', 2, -1, 2**32 - 1, 0)
@example('触手😀', 3, 7, 0, 1)
def test_the_bytes_are_those_of_the_serialiser_and_are_read_back(
    frame, stations, sec, nanosec, seed
):
    random = np.random.default_rng(seed)
    s = np.linspace(0.0, 0.3, stations)
    pose, contact = random.normal(size=(stations, 6, 6)), random.normal(size=(6, 6))
    writer = CovarianceWriter(frame, s)
    writer.write(np.zeros_like(pose), math.nan, np.zeros((6, 6)), 0, 0)
    ours = writer.write(pose, 0.25, contact, sec, nanosec)
    message = BackboneCovariance(s=s, pose=pose.ravel(), contact_s=0.25, contact=contact.ravel())
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    found = deserialize_message(ours, BackboneCovariance)
    # Padding, which the serialiser leaves as it was, is all that may differ.
    assert found == message and len(ours) == len(serialize_message(message))
    read = read_covariance(found)
    np.testing.assert_array_equal(read.s, s)
    np.testing.assert_array_equal(read.pose, pose)
    np.testing.assert_array_equal(read.contact, contact)
    assert read.contact_s == 0.25


def test_other_sizes_are_refused():
    writer = CovarianceWriter('', np.zeros(3))
    for pose, contact in (
        (np.zeros((2, 6, 6)), np.zeros((6, 6))),
        (np.zeros((3, 6, 6)), np.zeros((3, 3))),
    ):
        with pytest.raises(ConfigError, match='covariances are of shape'):
            writer.write(pose, 0.0, contact, 0, 0)
    with pytest.raises(MessageError, match='pose has 35 numbers, expected 36 for each of 1'):
        read_covariance(BackboneCovariance(s=[0.0], pose=[0.0] * 35))
