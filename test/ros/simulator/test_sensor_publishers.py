"""Sensors of the simulator over real DDS, and the estimator that hears them."""

import json

import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, WrenchStamped
from live_nodes import RosClient, hosting, new_domain
from numpy.testing import assert_allclose
from std_srvs.srv import SetBool

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.simulation.pushed_arm import touched

FILE = preset_path('renda2012_prototype')
CONFIG = load_config(FILE)
OF_SIMULATOR, _ = touched(CONFIG)
FORCE = np.array(OF_SIMULATOR['push.force'])
KINDS = {
    'measured/tip_pose': PoseWithCovarianceStamped,
    'measured/markers': PoseArray,
    'measured/base_wrench': WrenchStamped,
    'ground_truth/tip_wrench': WrenchStamped,
}


def arguments(parameters):
    given = {'stations': 21, **parameters}
    return [
        word for name, value in given.items() for word in ('-p', f'{name}:={json.dumps(value)}')
    ]


def simulating(domain, **more):
    """The simulator of an arm that is pushed all the time, and a client."""
    given = {**OF_SIMULATOR, 'push.period': 0.0, 'rate': 20.0, **more}
    return hosting(SimulatorNode, *arguments(given), files=[FILE], client=RosClient,
                   node='octo_arm_sim', domain=domain)  # fmt: skip


def test_sensors_measure_the_arm_that_is_pushed():
    exact = {
        'sensors.tip_position_stddev': 0.0, 'sensors.tip_rotation_stddev': 0.0,
        'sensors.marker_stddev': 0.0, 'sensors.base_wrench_rate': 10.0,
    }  # fmt: skip
    with simulating(new_domain(), **exact) as client:
        heard = {topic: client.hear(kind, topic) for topic, kind in KINDS.items()}
        client.wait(lambda: all(heard.values()), 'measurements')
        solver = CONFIG.solver('exact', 401)
        shape = solver.solve(np.zeros((1, 4)), np.append(FORCE, np.zeros(3)))
        tip = heard['measured/tip_pose'][-1]
        place = tip.pose.pose.position
        assert_allclose([place.x, place.y, place.z], shape.tip, atol=1e-6)
        assert tip.header.frame_id == 'arm_base'
        places = [np.interp(OF_SIMULATOR['sensors.marker_s'], shape.s, one)
                  for one in shape.position.T]  # fmt: skip
        seen = [pose.position for pose in heard['measured/markers'][-1].poses]
        assert_allclose([(p.x, p.y, p.z) for p in seen], np.transpose(places), atol=1e-5)
        wrench = heard['measured/base_wrench'][-1].wrench
        moment = [wrench.torque.x, wrench.torque.y, wrench.torque.z]
        assert_allclose(moment, np.cross(shape.tip, FORCE), atol=1e-6)
        true = heard['ground_truth/tip_wrench'][-1].wrench.force
        assert_allclose([true.x, true.y, true.z], FORCE, rtol=1e-12)
        # Nothing pushes any more, and another place cannot be pushed.
        assert client.change(push__force=[0.0, 0.0, 0.0]) == (True, '')
        heard['measured/tip_pose'].clear()
        client.wait(lambda: heard['measured/tip_pose'], 'the tip')
        place = heard['measured/tip_pose'][-1].pose.pose.position
        assert_allclose([place.x, place.y, place.z], [0.27, 0.0, 0.0], atol=1e-9)
        done, why = client.change(push__s=1.0, push__force=[0.0, 0.0, 0.01])
        assert not done and 'push.s is 1.0' in why


def test_the_arm_is_pushed_and_let_go_when_asked():
    with simulating(new_domain(), **{'push.period': 1e6}) as client:
        heard = client.hear(WrenchStamped, 'ground_truth/tip_wrench')

        def becomes(force):
            def is_so():
                found = heard[-1].wrench.force if heard else None
                return found and np.allclose([found.x, found.y, found.z], force, atol=1e-12)

            client.wait(is_so, f'a push of {force} N')

        becomes(np.zeros(3))  # the first half of the period
        answer = client.call(SetBool, 'push', SetBool.Request(data=True))
        assert answer.success and answer.message.startswith('pushes the tip with [')
        becomes(FORCE)
        answer = client.call(SetBool, 'push', SetBool.Request(data=False))
        assert (answer.success, answer.message) == (True, 'lets go')
        becomes(np.zeros(3))
        assert client.call(SetBool, 'push', SetBool.Request(data=True)).success
        becomes(FORCE)
        # Parameters are as they say again.
        assert client.change(push__period=1e5) == (True, '')
        becomes(np.zeros(3))
        assert client.change(push__force=[0.0, 0.0, 0.0]) == (True, '')
        answer = client.call(SetBool, 'push', SetBool.Request(data=True))
        assert not answer.success and answer.message.startswith('push.force is 0, expected')
