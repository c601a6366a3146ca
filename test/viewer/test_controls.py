"""Commanded tensions over time, targets, and the controls of an arm that moves, over real DDS."""

import dataclasses
import queue
import shlex
import threading
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
import viser
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3, Vector3Stamped
from live_nodes import DEADLINE, RosClient, hosting, new_domain, xyz
from numpy.testing import assert_allclose, assert_array_equal
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from octo_arm_model import ConfigError, MotionProperties, load_config
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client.client import ArmClient
from octo_arm_model.ros.client.commands import SimulatorClient
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.simulation.movements import highest_tensions
from octo_arm_model.simulation.profiles import CommandProfile
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.commander import Commander, TargetSearch, as_shell_line, as_yaml
from octo_arm_model.viewer.controls import MotionControls
from octo_arm_model.viewer.page import Page as ArmPage
from octo_arm_model.viewer.scene import Cameras
from octo_arm_model.wire.tensions import TENDON_TENSIONS

CONFIG = load_config('renda2012_table4')
SOLVER = CONFIG.solver()
RAMP = CommandProfile([0.0, 2.0, 3.0], [[1.0, 0.0], [3.0, 1.0], [1.0, 0.0]], 'linear')


def test_a_posture_is_reached_smoothly_and_exactly():
    commander = Commander([2.0, 0.0])
    assert commander.advance(0.0) is None and not commander.is_moving
    commander.move([0.0, 1.0], 10.0)
    way = [commander.advance(10.0 + t) for t in np.linspace(0.0, 1.0, 21)]
    seen = np.array([tensions for tensions in way if tensions is not None])
    assert (np.diff(seen[:, 0]) < 0.0).all() and (np.diff(seen[:, 1]) > 0.0).all()
    assert np.abs(np.diff(seen, axis=0)).max() < 0.2  # no jump
    assert_array_equal(seen[-1], [0.0, 1.0])
    assert not commander.is_moving and commander.advance(12.0) is None


def test_a_profile_is_played_after_a_smooth_way_to_its_beginning_and_at_any_speed():
    commander = Commander([0.0, 0.0])
    commander.play(RAMP, 5.0, speed=2.0)
    assert_array_equal(commander.advance(6.0), RAMP.at(0.0))
    for time in (6.4, 7.1, 7.5, 8.9):
        assert_allclose(commander.advance(time), RAMP.at(2.0 * (time - 6.0), loop=True))
    commander.change_speed(0.5, 8.9)  # from the same place on
    assert_allclose(commander.advance(9.1), RAMP.at(2.0 * 2.9 + 0.1, loop=True))
    commander.stop()
    assert commander.advance(10.0) is None
    commander = Commander([1.0, 0.0])
    commander.play(RAMP, 0.0, loop=False)
    commander.advance(1.0)
    assert commander.advance(2.5) is not None
    assert_array_equal(commander.advance(9.0), RAMP.at(3.0))
    assert commander.profile is None and commander.advance(10.0) is None


@pytest.mark.parametrize('names', [(), ("it's", 'b: c', '#d', '"e"')])
def test_copied_tensions_are_the_message_they_stand_for(names, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    arm = load_config('renda2012_prototype').arm
    arm = type(arm)(arm.material, arm.body, arm.sections, names) if names else arm
    tensions = np.array([0.0, 1.0, 2.5, 1e-5])
    expected = {'name': list(arm.tendon_names), 'tension': tensions.tolist()}
    assert yaml.safe_load(as_yaml(arm, tensions)) == expected
    *words, message = shlex.split(as_shell_line(arm, tensions, '/arm/tendon_commands'))
    kind = 'octo_arm_msgs/msg/TendonTensions'
    assert words == ['ros2', 'topic', 'pub', '-1', '/arm/tendon_commands', kind]
    fields = yaml.safe_load(message)
    assert all(isinstance(tension, float) for tension in fields['tension'])
    read = TENDON_TENSIONS.read(SimpleNamespace(**fields), arm)
    assert_array_equal(read.ravel(), tensions)
    # The page of a second arm, which is in a domain of its own, copies a line for that one.
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    line = as_shell_line(arm, tensions, '/arm/tendon_commands')
    assert shlex.split(line) == ['ROS_DOMAIN_ID=7', *words, message]


def answer_to(*targets):
    """That of a search that is asked for all of the ``targets`` at once."""
    answers = queue.SimpleQueue()
    search = TargetSearch(SOLVER, highest_tensions(CONFIG.arm), answers.put)
    for target in targets:
        search.request(target, np.zeros(12))
    found = answers.get(timeout=DEADLINE)
    # The end of a program does not wait for a search.
    assert all(one.daemon for one in threading.enumerate() if one.name.startswith('search'))
    search.close()
    assert answers.empty()
    return found


def test_of_many_targets_the_newest_is_found():
    last = SOLVER.solve(0.5 * np.array(FETCHING_IN_SPACE)).tip
    answer = answer_to(*([x, 0.1, -0.1] for x in (0.44, 0.3, 0.2)), last)
    assert answer.reached
    assert_allclose(answer.backbone.tip, last, atol=1e-6)
    assert 'reached: the tip is within' in numbers.search_result(answer)


def test_what_cannot_be_reached_or_is_nonsense_is_told():
    answer = answer_to([0.5, 0.0, 0.0])
    assert not answer.reached and answer.error == pytest.approx(0.05, rel=1e-3)
    assert 'out of reach: the nearest found leaves 50.0 mm' in numbers.search_result(answer)
    answer = answer_to([np.nan, 0.0, 0.0])
    assert 'finite' in numbers.error_text(answer)


FILE = preset_path('renda2012_prototype')
IN_CURRENT = dataclasses.replace(
    load_config(FILE), motion=MotionProperties(current=(0.0, 0.2, 0.0))
)
LENGTH = IN_CURRENT.arm.length
MOVING = {
    'dynamics': True,
    'model': 'exact',
    'material.density': 1080.0,
    'rate': 20.0,
    'motion.damping_time': 0.3,
    'stations': 21,
}


class Page:
    """The controls of a page, whose browser is told from here."""

    def __init__(self, server, simulator):
        self.controls = MotionControls(server, IN_CURRENT, simulator, lambda act: act())
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
    with hosting(SimulatorNode, files=[FILE], **MOVING) as client:
        tips = client.hear(PoseWithCovarianceStamped, 'ground_truth/tip_pose')
        page = Page(server, SimulatorClient(client.node))

        def tip():
            return xyz(tips[-1].pose.pose.position)

        client.wait(lambda: tips, 'the arm')
        page.tell('Pull the tip')
        page.controls.follow(tip())
        assert_allclose(page._handle.position, [LENGTH, 0.0, 0.0], atol=1e-9)
        # The spring and the arm balance where the arm alone would under that force.
        page.drag('start')
        point = np.array([LENGTH, 0.0, 0.15 * LENGTH])
        page.place(point)
        stiffness = bending_force(IN_CURRENT.arm, 0.3) / (0.3 * LENGTH)
        solver = IN_CURRENT.solver('exact')

        def is_balanced():
            force = np.append(stiffness * (point - tip()), np.zeros(3))
            expected = solver.solve(np.zeros((1, 4)), force).tip
            return tip()[2] > 0.03 * LENGTH and np.linalg.norm(tip() - expected) < 1e-4

        client.wait(is_balanced, 'a balance', lambda: page.controls.follow(tip()))
        page.drag('end')
        client.wait(lambda: np.linalg.norm(tip() - [LENGTH, 0.0, 0.0]) < 1e-3, 'the arm at rest')

        # Others stop the simulator too, of which its diagnostics tell.
        arm = ArmClient(rclpy.create_node('page', context=client.context))

        def is_paused(value):
            arm.poll()
            page.controls.show_pause(arm.is_paused)
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
        page.tell('Reset')
        page.tell('Pause', False)
        client.wait(lambda: len(tips) > 3, 'the arm')
        assert_allclose(tip(), [LENGTH, 0.0, 0.0], atol=1e-9)
        # A force that nobody holds lets go.
        force = client.teller(Vector3Stamped, 'push/force')
        client.wait(lambda: tip()[2] > 1e-3, 'a push', lambda: force(vector=Vector3(z=0.05)))
        client.wait(lambda: np.linalg.norm(tip() - [LENGTH, 0.0, 0.0]) < 1e-3, 'the arm at rest')
        for fields, reason in (
            ({'vector': Vector3(x=np.nan)}, 'the force is [nan, 0.0, 0.0], expected finite'),
            ({'header': Header(frame_id='camera')}, "in frame 'camera', expected 'arm_base'"),
        ):
            client.log(reason, again=partial(force, **fields))


def test_the_current_is_an_arrow_and_a_missing_simulator_a_sentence(server):
    client = RosClient(new_domain())
    page = Page(server, SimulatorClient(client.node, 'left/'))
    arrow = server.scene.get_handle_by_name('/current')
    start, tip = arrow.points[0]
    assert_allclose(tip - start, [0.0, 0.3 * LENGTH, 0.0], atol=1e-6)
    with pytest.raises(ConfigError, match='nobody offers left/pause, expected octo_arm_sim'):
        page.tell('Pause')
    client.close()


def test_a_problem_is_shown_above_the_tabs(server):
    client = RosClient(new_domain())
    arm = ArmClient(client.node)
    page = ArmPage(server, Cameras(server), arm, CONFIG, lambda act: act())
    page.refuse('a profile beyond the limits')
    above = server.gui._container_handle_from_uuid['root']._children.values()
    texts = [handle.content for handle in above if isinstance(handle, viser.GuiHtmlHandle)]
    assert [text for text in texts if 'a profile beyond the limits' in text]
    page.close()
    client.close()
