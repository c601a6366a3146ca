"""Commanded tensions over time, targets, and the controls of an arm that moves, over real DDS."""

import asyncio
import contextlib
import dataclasses
import gc
import shlex
import weakref
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
import viser
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3, Vector3Stamped
from live_nodes import MOVING, RosClient, hosting, new_domain, xyz
from numpy.testing import assert_allclose, assert_array_equal
from octo_arm_msgs.msg import TendonTensions
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from octo_arm_model import ConfigError, MotionProperties, load_config
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client.client import COMMANDS, ArmClient
from octo_arm_model.ros.client.commands import SimulatorClient
from octo_arm_model.ros.node.outputs import LATCHED_QOS
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.simulation.movements import JOINTS
from octo_arm_model.simulation.profiles import CommandProfile
from octo_arm_model.viewer.commander import Commander, as_shell_line, as_yaml
from octo_arm_model.viewer.controls import MotionControls
from octo_arm_model.viewer.page import Page as ArmPage
from octo_arm_model.viewer.page import Viewer
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


@contextlib.contextmanager
def paged(client, server, file):
    """A page of the arm in ``file``, and its client of the nodes there."""
    arm = ArmClient(rclpy.create_node('viewer', context=client.context))
    arm.listen(COMMANDS)
    client.teller(String, 'arm_description', LATCHED_QOS)(data=file.read_text())
    client.wait(lambda: arm.poll() or arm.config, 'an arm')
    with contextlib.closing(
        ArmPage(server, Cameras(server), arm, arm.config, lambda act: act())
    ) as page:
        yield page, arm


@pytest.fixture
def answer_to(server):
    """A function that drags the target of a page to places, and returns tensions and a text."""
    with contextlib.closing(RosClient(new_domain())) as client:
        with paged(client, server, preset_path('renda2012_table4')) as (page, _):
            target = server.scene.get_handle_by_name('/target')

            def answer_to(*targets):
                for target.position in targets:
                    for callback in target._impl_aux.update_cb:
                        callback(SimpleNamespace())
                    page.command()

                def is_over():
                    page.command()
                    text = page._search_text.content
                    return 'searching' not in text and not page.commander.is_moving

                client.wait(is_over, 'an answer')
                return page.commander.tensions.reshape(3, 4), page._search_text.content

            yield answer_to


def test_of_many_targets_the_newest_is_found(answer_to):
    last = SOLVER.solve(0.5 * np.array(FETCHING_IN_SPACE)).tip
    tensions, text = answer_to(*([x, 0.1, -0.1] for x in (0.44, 0.3, 0.2)), last)
    assert_allclose(SOLVER.solve(tensions).tip, last, atol=1e-6)
    assert 'reached: the tip is within' in text


def test_what_cannot_be_reached_or_is_nonsense_is_told(answer_to):
    _, text = answer_to([0.5, 0.0, 0.0])
    assert 'out of reach: the nearest found leaves 50.0 mm' in text
    _, text = answer_to([np.nan, 0.0, 0.0])
    assert 'finite' in text


FILE = preset_path('renda2012_prototype')
IN_CURRENT = dataclasses.replace(
    load_config(FILE), motion=MotionProperties(current=(0.0, 0.2, 0.0))
)
LENGTH = IN_CURRENT.arm.length


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


def test_a_page_that_another_replaces_is_freed(server, monkeypatch):
    client = RosClient(new_domain())
    arm = ArmClient(client.node)
    monkeypatch.setattr(arm, 'poll', lambda: False)
    viewer, pages = Viewer(server, arm), []
    for stations in (21, 31):
        arm.config = dataclasses.replace(CONFIG, stations=stations)
        viewer.step()
        pages.append(weakref.ref(viewer._page))
    gc.collect()
    assert pages[0]() is None and pages[1]() is viewer._page
    client.close()


def test_commands_go_on_from_the_newest_command_of_any_node(server):
    with contextlib.ExitStack() as stack:
        client = stack.enter_context(hosting(SimulatorNode, files=[FILE], rate=50.0))
        heard = client.hear(TendonTensions, 'tendon_commands')
        readings = client.hear(TendonTensions, 'tendon_tensions')
        both = [stack.enter_context(paged(client, server, FILE)) for _ in range(2)]
        pages, arms = zip(*both, strict=True)
        others = {
            topic: client.teller(kind, topic)
            for topic, kind in (('tendon_commands', TendonTensions), (JOINTS, JointState))
        }

        def turn():
            for arm, page in zip(arms, pages, strict=True):
                arm.poll()
                page.command()

        def pull(page, tendon, tension, expected):
            page.commander.pull(tendon, tension)
            turn()
            client.wait(lambda: heard and list(heard[-1].tension) == expected, 'it', turn)
            follow(expected)

        def follow(expected):
            def all_follow():
                return all(page.commander.tensions.tolist() == expected for page in pages)

            client.wait(all_follow, 'both pages', turn)

        names = list(arms[0].config.arm.tendon_names)
        client.wait(lambda: client.node.count_subscribers('/tendon_commands') == 4, 'all')
        pull(pages[0], 0, 1.0, [1.0, 0.0, 0.0, 0.0])
        pull(pages[1], 1, 2.0, [1.0, 2.0, 0.0, 0.0])
        pull(pages[0], 2, 0.5, [1.0, 2.0, 0.5, 0.0])
        others['tendon_commands'](name=names, tension=[0.1, 0.2, 0.3, 0.4])
        follow([0.1, 0.2, 0.3, 0.4])
        pull(pages[0], 2, 0.5, [0.1, 0.2, 0.5, 0.4])
        client.wait(lambda: client.node.count_subscribers(f'/{JOINTS}') == 3, 'all')
        others[JOINTS](name=names[:1], effort=[0.7])
        follow([0.7, 0.2, 0.5, 0.4])
        # What no arm can follow, the simulator refuses too.
        for refused in ([0.1, 0.2, 1e9, 0.4], [np.nan] * 4, [0.1]):
            message = TendonTensions(name=names[: len(refused)], tension=refused)
            client.logs.clear()
            client.log('commands refused', again=partial(others['tendon_commands'], message))
            turn()
        pull(pages[1], 3, 0.6, [0.7, 0.2, 0.5, 0.6])

        # A reset, or another simulator, has no command: pages then follow what is measured.
        assert client.call(Trigger, 'reset', Trigger.Request()).success

        def measured():
            turn()
            for page in pages:
                page.commander.measure(np.array(readings[-1].tension))
            return all(not page.commander.tensions.any() for page in pages)

        client.wait(measured, 'slack tendons')
        pull(pages[0], 1, 0.3, [0.0, 0.3, 0.0, 0.0])


def test_a_viewer_that_is_too_slow_for_its_pictures_obeys(server, monkeypatch):
    for period in ('FRAME', '_IDLE'):
        monkeypatch.setattr(f'octo_arm_model.viewer.page.{period}', 0.0)
    with contextlib.closing(RosClient(new_domain())) as client:
        heard = client.hear(TendonTensions, 'tendon_commands')
        arm = ArmClient(rclpy.create_node('viewer', context=client.context))
        viewer = Viewer(server, arm)
        client.teller(String, 'arm_description', LATCHED_QOS)(data=FILE.read_text())
        client.wait(lambda: viewer._page, 'a page', viewer.step)
        client.wait(lambda: client.node.count_publishers('/tendon_commands'), 'a publisher')
        slider = viewer._page._controls._sliders[1]
        slider._impl.value = 0.5
        event = SimpleNamespace(target=slider, client_id=1)
        for callback in slider._impl.update_cb:
            asyncio.run(callback(event))
        client.wait(lambda: heard, 'a command', viewer.step)
        assert heard[-1].tension.tolist() == [0.0, 0.5, 0.0, 0.0]


def test_a_command_of_another_node_ends_a_profile_but_no_transition():
    commander = Commander([2.0, 0.0])
    commander.play(RAMP, 0.0)
    commander.follow([5.0, 5.0], 0.5)
    assert commander.advance(0.6) is not None and commander.profile is RAMP
    commander.advance(1.0)
    commander.follow([5.0, 4.0], 1.1)
    assert commander.profile is None and commander.advance(1.2) is None
    commander.pull(0, 1.0)
    assert_array_equal(commander.advance(1.3), [1.0, 4.0])
    commander.measure(np.array([0.9, 3.9]))
    assert_array_equal(commander.tensions, [1.0, 4.0])
    commander.forget(2.0)  # may be older than the command
    commander.measure(np.array([0.9, 3.9]))
    assert_array_equal(commander.tensions, [1.0, 4.0])
    commander.forget(4.0)
    commander.measure(np.array([0.9, 3.9]))
    assert_array_equal(commander.tensions, [0.9, 3.9])
