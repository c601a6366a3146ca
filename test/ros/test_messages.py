"""Conversion between messages and the core, without a node."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from builtin_interfaces.msg import Time

from octo_arm_model import Solver, load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.presets import preset_path
from octo_arm_model.ros.messages import backbone_messages

CONFIG = load_config(preset_path('renda2012_table4'))
ARM = CONFIG.arm


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
