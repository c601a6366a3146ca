"""Frames of sensors from /tf, and messages that wait for them."""

import types

import pytest

tf2 = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')

from geometry_msgs.msg import TransformStamped
from live_nodes import spin_until
from rclpy.parameter import Parameter

from octo_arm_model.arm.errors import ConfigError, MeasurementError
from octo_arm_model.ros.node import inputs
from octo_arm_model.ros.node.inputs import LARGEST, LONGEST, MOST_WAITING, Inputs
from octo_arm_model.ros.node.sensor_frames import SensorFrames


def link(child, w=1.0):
    """A transform from ``child`` to 'base' at 100 ns."""
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id, made.header.stamp.nanosec = 'base', 100
    made.transform.translation.x, made.transform.rotation.w = 0.3, w
    return made


def test_a_policy_of_transforms_that_cannot_be_is_refused_at_once(make_node):
    given = Parameter('qos_overrides./tf.subscription.depth', value=-1)
    node = make_node('overridden', parameter_overrides=[given])
    with pytest.raises(ConfigError, match='depth is -1'):
        SensorFrames(node, lambda: None).open()


def test_few_messages_wait_for_a_short_time(make_node, monkeypatch, capfd):
    node, refused, clock = make_node('listener'), [], types.SimpleNamespace(now=100.0)
    monkeypatch.setattr(inputs, 'time', types.SimpleNamespace(monotonic=lambda: clock.now))
    made = Inputs(node, lambda topic, error: refused.append(str(error)), lambda older: None)
    frames = SensorFrames(node, made.look_again)
    publisher = node.create_publisher(tf2.TFMessage, '/tf', 10)

    def is_heard():
        # One that is none does not hide those behind it.
        publisher.publish(tf2.TFMessage(transforms=[link('twisted', 7.0), link('rail')]))
        try:
            return frames.pose_of('rail', 'base', 100).position == (0.3, 0.0, 0.0)
        except MeasurementError:
            return False

    spin_until(node.executor, is_heard)
    told = "/tf refused: 'twisted': transform.rotation is (0.0, 0.0, 0.0, 7.0) of length 7"
    assert told in capfd.readouterr().err
    for size in [6] * (MOST_WAITING + 2) + [LARGEST + 1]:
        made.attempt('/measured/tip_pose', lambda: frames.pose_of('rail', 'base', 5000), size)
    assert len(refused) == 3
    assert "its frame is 'rail', and the transform from 'rail'" in refused[0]
    clock.now += 1.01 * LONGEST
    spin_until(node.executor, lambda: len(refused) == MOST_WAITING + 3)
    made.close()
    frames.close()
