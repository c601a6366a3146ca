"""The description of the arm, for late subscribers."""

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from octo_arm_model import load_config


def test_whoever_comes_late_hears_what_the_arm_is(client, tmp_path):
    heard = []
    qos = QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    client.node.create_subscription(String, 'arm_description', heard.append, qos)
    client.wait(lambda: heard, 'the description of the arm')
    path = tmp_path / 'heard.yaml'
    path.write_text(heard[-1].data)
    assert load_config(path).arm == CONFIG.arm
