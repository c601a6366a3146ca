"""Tensions in a field of messages of any type, over DDS."""

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG, hosting
from sensor_msgs.msg import JointState, LaserScan

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node.main import OctoArmNode

TENSIONS = np.array(FETCHING_IN_PLANE)
EXPECTED = CONFIG.solver().solve(TENSIONS)
CELLS = [f'LC {number}' for number in range(12)]


def scan():
    """Readings of more cells than the arm has, without names, in single precision."""
    message = LaserScan(ranges=[99.0, *TENSIONS.ravel().tolist(), 99.0])
    message.header.stamp.sec = 77
    return message


def joints():
    """Readings by name, not where a JointState has forces."""
    message = JointState(name=CELLS[::-1], velocity=TENSIONS.ravel()[::-1].tolist())
    message.header.stamp.sec = 78
    return message


def wait_for_answer(client, publisher, message):
    """Publish until it is answered with its stamp and the shape of `TENSIONS`."""

    def answered():
        publisher.publish(message)
        client.spin(0.1)
        poses = client.answers['backbone/poses']
        if not poses or poses[-1].header.stamp != message.header.stamp:
            return False
        tip = poses[-1].poses[-1].position
        return np.allclose([tip.x, tip.y, tip.z], EXPECTED.tip, atol=1e-9)

    client.wait(answered, 'an answer')


def test_any_field_of_any_type_is_taken_and_may_change_while_the_node_runs():
    numbers = '[' + ','.join(f'"{n}"' for n in range(1, 13)) + ']'
    given = ('-p', 'tension_type:=sensor_msgs/msg/LaserScan', '-p', 'tension_field:=ranges',
             '-p', f'tension_names:={numbers}', '-r', 'tendon_tensions/field:=/daq')  # fmt: skip
    with hosting(OctoArmNode, *given, node='daq') as client:
        scans = client.node.create_publisher(LaserScan, '/daq', 10)
        wait_for_answer(client, scans, scan())
        client.node.destroy_publisher(scans)
        other = {'tension_type': 'sensor_msgs/msg/JointState', 'tension_field': 'velocity'}
        assert client.change(**other, tension_names=CELLS) == (True, '')
        states = client.node.create_publisher(JointState, '/daq', 10)
        wait_for_answer(client, states, joints())

        def is_told(words, message):
            states.publish(message)
            client.spin(0.1)
            return any('/daq refused' in log.msg and words in log.msg for log in client.logs)

        # Numbers there are none in such a field, and none there are without a load cell.
        client.wait(lambda: is_told('no value', JointState(velocity=[1.0])), 'a refusal')
        assert client.change(tension_field='speed') == (True, '')
        client.wait(lambda: is_told("no field 'speed'", joints()), 'a refusal')
        assert client.change(tension_type='', tension_field='') == (True, '')
        client.wait(lambda: not states.get_subscription_count(), 'the end of the subscription')


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'tension_type': 'sensor_msgs/msg/LaserScan'}, "tension_field is '', expected both"),
        ({'tension_type': 'no_msgs/msg/No', 'tension_field': 'a'}, "type 'no_msgs/msg/No' are"),
        ({'tension_type': 'sensor_msgs/msg/Nothing', 'tension_field': 'a'}, 'are installed'),
        ({'tension_type': 'os.path', 'tension_field': 'a'}, "no messages of type 'os.path'"),
    ],
)
def test_a_type_that_is_not_there_is_refused(client, values, reason):
    is_taken, why = client.change(**values)
    assert not is_taken
    assert reason in why
