"""A publisher knows whether somebody receives what it publishes, from the first listener on."""

import functools

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from live_nodes import spin_until
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from octo_arm_model.ros.node.outputs.output import Output

QOS = QoSProfile(depth=5)


def test_messages_and_their_bytes_are_heard_while_somebody_listens(make_node):
    node = make_node('speaker')
    wait = functools.partial(spin_until, node.executor)
    output = Output(node, String, 'words', QOS)
    assert not output.is_heard
    for _ in range(2):
        heard = []
        subscription = node.create_subscription(String, 'words', heard.append, QOS)
        wait(lambda: output.is_heard)
        output.publish(String(data='a message'))
        output.publish(serialize_message(String(data='its bytes')))
        wait(lambda heard=heard: len(heard) == 2)
        assert [one.data for one in heard] == ['a message', 'its bytes']
        node.destroy_subscription(subscription)
        wait(lambda: not output.is_heard)


def test_what_is_kept_for_who_comes_later_is_always_heard(make_node):
    node = make_node('keeper')
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    assert Output(node, String, 'kept', qos).is_heard
