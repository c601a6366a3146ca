"""Publishers whose messages are made where somebody receives them, over DDS."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from live_nodes import CONFIG, spin_until
from octo_arm_msgs.msg import SectionStrains
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node.outputs import BackbonePublishers, Output
from octo_arm_model.wire.stamp import Stamp


def test_a_message_is_heard_while_somebody_subscribes(make_node):
    node = make_node('heard')
    output = Output(node, String, 'topic', QoSProfile(depth=5))
    assert not output.is_heard
    subscription = node.create_subscription(String, 'topic', print, 5)
    spin_until(node.executor, lambda: output.is_heard)
    node.destroy_subscription(subscription)
    spin_until(node.executor, lambda: not output.is_heard)


def test_messages_and_their_bytes_are_published(make_node):
    node, found = make_node('bytes'), []
    output = Output(node, String, 'topic', QoSProfile(depth=5))
    node.create_subscription(String, 'topic', found.append, 5)
    spin_until(node.executor, lambda: output.is_heard)
    output.publish(String(data='a message'))
    output.publish(serialize_message(String(data='its bytes')))
    spin_until(node.executor, lambda: len(found) == 2)
    assert [one.data for one in found] == ['a message', 'its bytes']


def test_what_is_kept_for_later_subscribers_is_heard_by_them(make_node):
    durability = Parameter('qos_overrides./topic.publisher.durability', value='transient_local')
    node, found = make_node('kept', parameter_overrides=[durability]), []
    output = Output(node, String, 'topic', QoSProfile(depth=1))
    assert output.is_heard
    output.publish(String(data='before'))
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(String, 'topic', found.append, qos)
    spin_until(node.executor, lambda: found)
    assert found[0].data == 'before'


def test_messages_of_a_backbone_are_made_for_those_who_subscribe(make_node, monkeypatch):
    node, strains, tips = make_node('backbones'), [], []
    publishers, solver = BackbonePublishers(node), CONFIG.solver()
    publishers.describe(solver, CONFIG)
    backbone, written = solver.solve(FETCHING_IN_PLANE), []
    monkeypatch.setattr(publishers._writer, 'path', lambda *_: written.append('path'))
    node.create_subscription(SectionStrains, 'strains', strains.append, 5)
    spin_until(node.executor, lambda: publishers._strains.is_heard)
    assert not publishers.is_tip_heard
    publishers.publish(backbone, None, Stamp(1, 0))
    spin_until(node.executor, lambda: strains)
    node.create_subscription(PoseWithCovarianceStamped, 'tip_pose', tips.append, 5)
    spin_until(node.executor, lambda: publishers.is_tip_heard)
    publishers.publish(backbone, np.diag(np.arange(6.0)), Stamp(2, 0))
    spin_until(node.executor, lambda: tips and len(strains) == 2)
    np.testing.assert_array_equal(tips[0].pose.covariance[::7], np.arange(6.0))
    assert not written
    publishers.close()
