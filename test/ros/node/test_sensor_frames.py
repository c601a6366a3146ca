"""Frames of sensors from /tf_static and /tf, and messages that wait for them."""

import functools
import types

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
tf2 = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')

from geometry_msgs.msg import TransformStamped
from live_nodes import spin_until
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from octo_arm_model.arm.errors import ConfigError, MeasurementError
from octo_arm_model.ros.node import inputs
from octo_arm_model.ros.node.inputs import LARGEST, LONGEST, MOST_WAITING, Inputs
from octo_arm_model.ros.node.sensor_frames import SensorFrames

TOPIC = '/measured/tip_pose'


@pytest.fixture
def node(make_node):
    return make_node('listener')


@pytest.fixture
def wait(node):
    """Spins the node until a condition holds."""
    return functools.partial(spin_until, node.executor)


def link(child, x, nanoseconds=0, w=1.0):
    """A transform from ``child`` to 'base' by ``x`` [m]."""
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = 'base'
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(nanoseconds, 10**9)
    made.transform.translation.x, made.transform.rotation.w = x, w
    return made


def asked(frames, frame, stamp_ns=0):
    """The pose of ``frame`` in 'base', or why it is not known."""
    try:
        return frames.pose_of(frame, 'base', stamp_ns)
    except MeasurementError as error:
        return error


def test_a_transform_that_is_none_does_not_hide_those_behind_it(node, wait, capfd):
    frames = SensorFrames(node, lambda: None)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = node.create_publisher(tf2.TFMessage, '/tf_static', latched)
    message = tf2.TFMessage(transforms=[link('twisted', 0.1, w=7.0), link('lens', 0.3)])

    def heard():
        publisher.publish(message)
        return not isinstance(asked(frames, 'lens'), MeasurementError)

    wait(heard)
    assert asked(frames, 'lens').position == (0.3, 0.0, 0.0)
    told = "/tf_static refused: 'twisted': transform.rotation is (0.0, 0.0, 0.0, 7.0) of length 7"
    assert told in capfd.readouterr().err
    frames.close()


def test_a_policy_of_transforms_that_cannot_be_is_refused_at_once(make_node):
    given = Parameter('qos_overrides./tf.subscription.depth', value=-1)
    node = make_node('overridden', parameter_overrides=[given])
    with pytest.raises(ConfigError, match='depth is -1'):
        SensorFrames(node, lambda: None).open()


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until its ``now`` [s] is set."""
    clock = types.SimpleNamespace(now=100.0)
    monkeypatch.setattr(inputs, 'time', types.SimpleNamespace(monotonic=lambda: clock.now))
    return clock


@pytest.fixture
def waiting(node, clock):
    """Messages that wait, and lists of those ``read`` and ``refused``."""
    refused, done = [], []
    made = Inputs(
        node, lambda topic, error: refused.append((topic, str(error))), lambda older: None
    )
    frames = SensorFrames(node, made.look_again)

    def take(stamp_ns, size=6):
        def read():
            frames.pose_of('rail', 'base', stamp_ns)
            done.append(stamp_ns)

        made.attempt(TOPIC, read, size)

    yield types.SimpleNamespace(frames=frames, refused=refused, done=done, take=take)
    made.close()
    frames.close()


@pytest.fixture
def rail(node, wait, waiting):
    """Says where the moving frame 'rail' is at a stamp [ns], and waits until that is known."""
    publisher = node.create_publisher(tf2.TFMessage, '/tf', 10)

    def move(stamp_ns):
        publisher.publish(tf2.TFMessage(transforms=[link('rail', 1e-9 * stamp_ns, stamp_ns)]))
        wait(lambda: not isinstance(asked(waiting.frames, 'rail', stamp_ns), MeasurementError))

    asked(waiting.frames, 'rail')
    wait(publisher.get_subscription_count)
    return move


def test_few_messages_wait_for_a_short_time(waiting, rail, wait, clock):
    rail(100)
    for number in range(MOST_WAITING + 2):
        waiting.take(1000 + number)
    assert [topic for topic, _ in waiting.refused] == [TOPIC] * 2
    assert "its frame is 'rail', and the transform from 'rail'" in waiting.refused[0][1]
    waiting.take(1000, LARGEST + 1)
    assert len(waiting.refused) == 3
    clock.now += 1.01 * LONGEST
    wait(lambda: len(waiting.refused) == MOST_WAITING + 3)
    rail(5000)
    assert not waiting.done
    np.testing.assert_allclose(asked(waiting.frames, 'rail', 5000).position[0], 5e-6)


def test_silence_begins_with_the_last_subscription(node, clock):
    made = Inputs(node, lambda topic, error: None, lambda older: None)
    for _ in range(2):  # as where parameters name another type of messages
        made.unsubscribe('readings')
        made.subscribe(JointState, 'readings', lambda topic, message: None)
        assert made.silent(LONGEST, lambda topic: True) == []
        clock.now += 2.0 * LONGEST
        assert made.silent(LONGEST, lambda topic: True) == [f'silent for {2 * LONGEST:.1f} s']
    made.close()
