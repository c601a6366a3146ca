"""The simulator of an arm that moves, over real DDS: its shape, its tendons, and its services."""

import json

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import PoseWithCovarianceStamped
from live_nodes import RosClient, hosting, new_domain, tensions_message
from octo_arm_msgs.msg import TendonTensions
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.simulator.main import SimulatorNode

FILE = preset_path('renda2012_prototype')
CONFIG = load_config(FILE)
PULL = np.array([0.5, 0.0, 0.0, 0.0])


def moving(domain):
    """The simulator of an arm that moves, strongly damped, and a client."""
    given = {'dynamics': True, 'material.density': 1080.0, 'motion.damping_time': 0.3,
             'stations': 21, 'rate': 50.0}  # fmt: skip
    words = [w for name, value in given.items() for w in ('-p', f'{name}:={json.dumps(value)}')]
    return hosting(SimulatorNode, *words, files=[FILE], client=RosClient, node='octo_arm_sim',
                   domain=domain)  # fmt: skip


def test_the_moving_arm_is_published_paused_stepped_and_reset():
    with moving(new_domain()) as client:
        tips = client.hear(PoseWithCovarianceStamped, 'ground_truth/tip_pose')
        joints = client.hear(JointState, 'tendon_states')
        commands = client.node.create_publisher(TendonTensions, 'tendon_commands', 10)

        def tip():
            place = tips[-1].pose.pose.position
            return np.array([place.x, place.y, place.z])

        client.wait(lambda: tips and joints, 'the arm')
        straight = tip()
        np.testing.assert_allclose(straight, [0.27, 0.0, 0.0], atol=1e-9)
        assert list(joints[-1].name) == list(CONFIG.arm.tendon_names)

        message = tensions_message('tendon_commands', PULL, list(CONFIG.arm.tendon_names))
        expected = CONFIG.solver('exact').solve(PULL.reshape(1, 4)).tip

        def is_there():
            commands.publish(message)
            return np.linalg.norm(tip() - expected) < 1e-4

        client.wait(is_there, 'the equilibrium')
        np.testing.assert_allclose(joints[-1].effort, PULL, atol=1e-9)
        assert joints[-1].position[0] > 0.0
        # It took its time: shapes in between were published.
        away = [np.linalg.norm([p.x - straight[0], p.y, p.z])
                for p in (one.pose.pose.position for one in tips)]  # fmt: skip
        whole = np.linalg.norm(expected - straight)
        assert any(0.1 * whole < one < 0.9 * whole for one in away)

        assert not client.call(Trigger, 'step', Trigger.Request()).success
        assert client.call(SetBool, 'pause', SetBool.Request(data=True)).success
        client.spin(0.2)
        tips.clear()
        client.spin(0.3)
        assert not tips
        assert client.call(Trigger, 'step', Trigger.Request()).success
        client.wait(lambda: tips, 'a step')
        assert len(tips) == 1
        assert client.call(Trigger, 'reset', Trigger.Request()).success
        assert client.call(SetBool, 'pause', SetBool.Request(data=False)).success
        tips.clear()
        client.wait(lambda: tips and np.linalg.norm(tip() - straight) < 1e-9, 'the arm at rest')
