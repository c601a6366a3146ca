"""The client of an arm's node: what it makes of messages."""

import contextlib

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG_FILE, RosClient, new_domain
from std_msgs.msg import String

from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient
from octo_arm_model.ros.messages import backbone_messages
from octo_arm_model.ros.node.outputs.backbone_publishers import LATCHED_QOS, OUTPUT_QOS

pytestmark = pytest.mark.slow
TOPICS = {**POSES, 'strains': DETAILS['strains']}


@pytest.mark.parametrize('name', TOPICS)
@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 40], ids=len)
def test_bytes_that_are_no_message_are_a_problem_until_the_next_one(name, data):
    with contextlib.closing(RosClient(new_domain())) as ros:
        client = ArmClient(rclpy.create_node('reading', context=ros.context))
        client.listen(TOPICS)

        def wait(condition, what):
            ros.wait(lambda: client.poll() or condition(), what)

        description = ros.node.create_publisher(String, 'arm_description', LATCHED_QOS)
        description.publish(String(data=CONFIG_FILE.read_text()))
        publisher = ros.node.create_publisher(TOPICS[name], name, OUTPUT_QOS)
        wait(lambda: client.config and publisher.get_subscription_count(), 'a subscription')
        publisher.publish(data)
        wait(lambda: client.problem, 'a problem')
        kind = TOPICS[name].__name__
        assert client.problem == f'{name}: {len(data)} bytes that are no {kind}'
        solver = client.config.solver()
        backbone = solver.solve(0.0 * solver.rest_lengths)
        stamp, frame = ros.node.get_clock().now().to_msg(), client.config.base_frame
        _, poses, strains = backbone_messages(backbone, stamp, frame)
        publisher.publish(poses if name in POSES else strains)
        wait(lambda: not client.problem, 'a message')
        assert (client.shape if name in POSES else client.strains) is not None
