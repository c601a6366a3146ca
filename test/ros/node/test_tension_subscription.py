"""Messages that arrive faster than they are answered, or are no messages."""

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import OUTPUTS, assert_is_backbone, hosting

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.ros.node.main import OctoArmNode


@pytest.mark.parametrize('data', [b'\x00\x01', bytes(range(80)), b'\xff' * 200])
def test_bytes_that_are_no_message_are_refused(client, data):
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    client.forget()
    client.publishers['tendon_tensions'].publish(data)
    client.ask('tendon_tensions/array', FETCHING_IN_SPACE)
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    assert {name: len(got) for name, got in client.answers.items()} == dict.fromkeys(OUTPUTS, 2)


def test_a_message_without_a_byte_is_survived():
    # Not reliable, as by default: a reliable subscription gets nothing more after it.
    with hosting(OctoArmNode) as client:
        client.connect()
        client.publishers['tendon_tensions'].publish(b'')
        assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


def test_a_burst_is_answered_with_its_newest_and_the_rest_is_counted(client):
    before = client.status('output')[1]
    client.forget()
    burst = 60
    stamps = [client.send('tendon_tensions', FETCHING_IN_PLANE) for _ in range(burst)]

    def newest_is_answered():
        got = client.answers['backbone/path']
        return got and got[-1].header.stamp.sec == stamps[-1]

    client.wait(newest_is_answered, 'an answer to the newest')
    after = client.status('output')[1]
    counted = sum(int(after[key]) - int(before[key]) for key in ('answered', 'skipped'))
    assert counted == burst
