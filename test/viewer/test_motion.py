"""The page of an arm that moves pulls, stops and steps a simulator, over real DDS."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3, Vector3Stamped
from live_nodes import RosClient, hosting, new_domain
from numpy.testing import assert_allclose
from std_srvs.srv import SetBool

from octo_arm_model import ConfigError, MotionProperties, load_config
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client.client import ArmClient
from octo_arm_model.ros.client.commands import SimulatorClient
from octo_arm_model.ros.processes import parameter_arguments
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.viewer.controls import MotionControls

FILE = preset_path('renda2012_prototype')
CONFIG = dataclasses.replace(load_config(FILE), motion=MotionProperties(current=(0.0, 0.2, 0.0)))
LENGTH = CONFIG.arm.length
MOVING = {'dynamics': True, 'model': 'exact', 'material.density': 1080.0, 'rate': 20.0,
          'motion.damping_time': 0.3, 'stations': 21}  # fmt: skip


class Page:
    """The controls of a page, whose browser is told from here."""

    def __init__(self, server, simulator):
        self.controls = MotionControls(server, CONFIG, simulator, lambda act: act())
        self._handles = {h.label: h for h in server.gui._gui_input_handle_from_uuid.values()}
        self._handle = self.controls._handle

    def tell(self, label, value=True):
        handle = self._handles[label]
        handle._impl.value = value
        for callback in handle._impl.update_cb:
            callback(SimpleNamespace(target=handle, client=self))

    def drag(self, phase):
        for callback in self._handle._impl_aux.update_cb:
            callback(SimpleNamespace(phase=phase))

    def place(self, position):
        self._handle.position = position


def test_the_mouse_pulls_the_tip_until_it_lets_go_and_buttons_stop_and_step(server):
    with hosting(SimulatorNode, *parameter_arguments(MOVING), files=[FILE], client=RosClient,
                 node='octo_arm_sim', domain=new_domain()) as client:  # fmt: skip
        tips = client.hear(PoseWithCovarianceStamped, 'ground_truth/tip_pose')
        page = Page(server, SimulatorClient(client.node))

        def tip():
            place = tips[-1].pose.pose.position
            return np.array([place.x, place.y, place.z])

        client.wait(lambda: tips, 'the arm')
        page.tell('Pull the tip')
        page.controls.follow(tip())
        assert_allclose(page._handle.position, [LENGTH, 0.0, 0.0], atol=1e-9)
        # The spring and the arm balance where the arm alone would under that force.
        page.drag('start')
        point = np.array([LENGTH, 0.0, 0.15 * LENGTH])
        page.place(point)
        stiffness = bending_force(CONFIG.arm, 0.3) / (0.3 * LENGTH)
        solver = CONFIG.solver('exact')

        def is_balanced():
            page.controls.follow(tip())
            client.spin(0.02)
            force = np.append(stiffness * (point - tip()), np.zeros(3))
            expected = solver.solve(np.zeros((1, 4)), force).tip
            return tip()[2] > 0.03 * LENGTH and np.linalg.norm(tip() - expected) < 1e-4

        client.wait(is_balanced, 'a balance')
        page.drag('end')
        client.wait(lambda: np.linalg.norm(tip() - [LENGTH, 0.0, 0.0]) < 1e-3, 'the arm at rest')

        # Others stop the simulator too, of which its diagnostics tell.
        arm = ArmClient(rclpy.create_node('page', context=client.context))

        def is_paused(value):
            arm.poll()
            page.controls.tell(arm.is_paused)
            return page.controls._paused.value is value is not page.controls._step.disabled

        for value in (True, False):
            assert client.call(SetBool, 'pause', SetBool.Request(data=value)).success
            client.wait(lambda value=value: is_paused(value), f'paused: {value}')
        page.tell('Pause')
        client.spin(0.2)
        tips.clear()
        client.spin(0.2)
        assert not tips
        page.tell('Step')
        client.wait(lambda: len(tips) == 1, 'a step')
        page.tell('Begin anew')
        page.tell('Pause', False)
        client.wait(lambda: len(tips) > 3, 'the arm')
        assert_allclose(tip(), [LENGTH, 0.0, 0.0], atol=1e-9)
        # A force that nobody holds lets go.
        force = client.node.create_publisher(Vector3Stamped, 'push/force', 10)

        def is_pulled():
            force.publish(Vector3Stamped(vector=Vector3(z=0.05)))
            return tip()[2] > 1e-3

        client.wait(is_pulled, 'a push')
        client.wait(lambda: np.linalg.norm(tip() - [LENGTH, 0.0, 0.0]) < 1e-3, 'the arm at rest')
        for vector, frame, reason in (
            (Vector3(x=float('nan')), '', 'the force is [nan, 0.0, 0.0], expected finite'),
            (Vector3(), 'camera', "the force is in frame 'camera', expected 'arm_base'"),
        ):
            message = Vector3Stamped(vector=vector)
            message.header.frame_id = frame

            def is_told(message=message, reason=reason):
                force.publish(message)
                return any(reason in log.msg for log in client.logs)

            client.wait(is_told, reason)


def test_the_current_is_an_arrow_and_a_missing_simulator_a_sentence(server):
    client = RosClient(new_domain())
    page = Page(server, SimulatorClient(client.node, 'left/'))
    arrow = server.scene.get_handle_by_name('/current')
    start, tip = arrow.points[0]
    assert_allclose(tip - start, [0.0, 0.3 * LENGTH, 0.0], atol=1e-6)
    with pytest.raises(ConfigError, match='nobody offers left/pause, expected octo_arm_sim'):
        page.tell('Pause')
    client.close()
