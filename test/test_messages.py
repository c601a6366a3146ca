"""Conversion between messages and the core, without a node."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from builtin_interfaces.msg import Time
from octo_arm_msgs.msg import TendonTensions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from octo_arm_model import Solver, TensionError, load_config
from octo_arm_model.paper import FETCHING_IN_SPACE, preset_path
from octo_arm_model.ros.messages import (
    backbone_messages,
    tensions_from_array,
    tensions_from_joint_state,
    tensions_from_tendon_tensions,
)

CONFIG = load_config(preset_path('renda2012_table4'))
ARM = CONFIG.arm
NAMES = list(ARM.tendon_names)
VALUES = np.arange(12.0)


def layout(*sizes, offset=0):
    return MultiArrayLayout(
        dim=[MultiArrayDimension(size=size) for size in sizes], data_offset=offset
    )


def test_names_decide_the_order_not_the_position_in_the_message():
    shuffled = np.random.default_rng(1).permutation(12)
    names = [NAMES[i] for i in shuffled]
    joint_state = JointState(name=names, effort=VALUES[shuffled])
    tendon_tensions = TendonTensions(name=names, tension=VALUES[shuffled])
    expected = VALUES.reshape(3, 4)
    np.testing.assert_array_equal(tensions_from_joint_state(joint_state, ARM), expected)
    np.testing.assert_array_equal(tensions_from_tendon_tensions(tendon_tensions, ARM), expected)


@pytest.mark.parametrize('sizes', [(), (12,), (3, 4)])
def test_array_is_row_major_from_the_tip(sizes):
    message = Float64MultiArray(layout=layout(*sizes), data=VALUES)
    np.testing.assert_array_equal(tensions_from_array(message, ARM), VALUES.reshape(3, 4))


@pytest.mark.parametrize(
    ('sizes', 'offset', 'count', 'complaint'),
    [
        ((), 0, 11, r'data has 11 values, expected 12'),
        ((), 0, 0, r'data has 0 values, expected 12'),
        ((4, 3), 0, 12, r'layout is \(4, 3\)'),
        ((3, 4), 1, 12, r'data_offset 1'),
    ],
)
def test_array_of_another_shape_is_refused(sizes, offset, count, complaint):
    message = Float64MultiArray(layout=layout(*sizes, offset=offset), data=np.zeros(count))
    with pytest.raises(TensionError, match=complaint):
        tensions_from_array(message, ARM)


@pytest.mark.parametrize(
    ('names', 'values', 'complaint'),
    [
        (NAMES, VALUES[:-1], 'name has 12 entries but tension has 11'),
        (NAMES[:-1], VALUES[:-1], 'no tension for tendon tendon_3_4'),
        ([*NAMES, 'spare'], np.zeros(13), 'unknown tendon spare'),
        ([*NAMES, NAMES[0]], np.zeros(13), 'more than once: tendon_1_1'),
        ([], [], 'no tension for tendon tendon_1_1'),
    ],
)
def test_names_that_do_not_fit_are_refused(names, values, complaint):
    with pytest.raises(TensionError, match=complaint):
        tensions_from_tendon_tensions(TendonTensions(name=names, tension=values), ARM)


def test_messages_carry_the_backbone_unchanged():
    backbone = Solver(ARM, base=CONFIG.base).solve(FETCHING_IN_SPACE)
    stamp = Time(sec=7, nanosec=8)
    path, poses, strains = backbone_messages(backbone, stamp, 'somewhere')
    headers = [message.header for message in (path, poses, strains, *path.poses)]
    assert all(header.stamp == stamp and header.frame_id == 'somewhere' for header in headers)
    assert poses.poses == [pose.pose for pose in path.poses]
    position = [[p.position.x, p.position.y, p.position.z] for p in poses.poses]
    orientation = [
        [p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w] for p in poses.poses
    ]
    np.testing.assert_array_equal(position, backbone.position)
    np.testing.assert_array_equal(orientation, backbone.quaternion)
    assert strains.model == 'renda2012'
    for name in ('s', 'section', 'tau', 'xi', 'k', 'q'):
        np.testing.assert_array_equal(getattr(strains, name), getattr(backbone, name))
