"""Poses from raw bytes, and rates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from rclpy.serialization import serialize_message

from octo_arm_model.ros.client.topic import Meter, read_poses


@pytest.mark.parametrize('count', [0, 1, 101])
@given(frame=st.text(st.characters(codec='ascii', exclude_characters='\0'), max_size=20))
def test_poses_are_read_from_bytes_as_ros_reads_them(count, frame):
    message = PoseArray()
    message.header.stamp.sec, message.header.stamp.nanosec = -3, 250_000_000
    message.header.frame_id = frame
    expected = np.random.default_rng(count).normal(size=(count, 7))
    for x, y, z, qx, qy, qz, qw in expected.tolist():
        pose = Pose(position=Point(x=x, y=y, z=z))
        pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
        message.poses.append(pose)
    stamp, poses = read_poses(serialize_message(message))
    assert stamp == -2.75
    np.testing.assert_array_equal(poses, expected)


def test_rates_count_what_was_passed_over_and_begin_anew_with_the_node():
    meter = Meter()
    assert meter.rate(0.0) == 0.0
    for step in range(31):
        meter.count(step / 30.0, 4 * step)
    assert meter.rate(1.0) == pytest.approx(120.0)
    assert meter.rate(10.0) == 0.0
    meter.count(10.0, 1000)
    meter.count(10.5, 3)  # another publisher, which counts from 1
    meter.count(11.0, 8)
    assert meter.rate(11.0) == pytest.approx(10.0)
