"""Controllers of ros2_control: how they are configured, and what they send, over real DDS."""

from functools import partial
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from checkout import ROOT
from live_nodes import MOVING, RosClient, hosting
from numpy.testing import assert_allclose
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from octo_arm_model import ConfigError, load_config, solve_displacements
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.simulation.movements import JOINTS
from octo_arm_model.simulation.simulator import STATES, robot_description

FILE = preset_path('renda2012_prototype')
CONFIG = load_config(FILE)
NAMES = list(CONFIG.arm.tendon_names)
THRESHOLD = 1e-5  # trigger_joint_command_threshold, by default


class TopicSystem(RosClient):
    """Reads and writes as `JointStateTopicSystem` does, with the interface of its joints."""

    def __init__(self, domain, node='octo_arm_sim'):
        super().__init__(domain, node)
        self.tell = self.teller(JointState, JOINTS, QoSProfile(depth=1))
        self.states = self.hear(JointState, STATES, qos_profile_sensor_data)
        self.sent = 0

    def write(self, interface, command):
        """Publish the ``command`` of all joints, unless the states equal it."""
        state = np.array(getattr(self.states[-1], interface))
        # As C++ compares: a sum that is no number is not below the threshold.
        if not np.abs(state - command).sum() <= THRESHOLD:
            message = JointState(name=NAMES, **{interface: command.tolist()})
            message.header.stamp = self.node.get_clock().now().to_msg()
            self.tell(message)
            self.sent += 1

    def reach(self, interface, command, tolerance=THRESHOLD):
        """Write until the states are the ``command``."""

        def is_there():
            state = getattr(self.states[-1], interface)
            return np.abs(np.array(state) - command).sum() <= tolerance

        self.wait(lambda: self.states, 'states')
        write = partial(self.write, interface, command)
        self.wait(is_there, f'{interface} {command}', write)


@pytest.fixture(scope='module')
def system():
    with hosting(SimulatorNode, files=[FILE], client=TopicSystem, **MOVING) as found:
        yield found


def test_the_description_names_the_tendons_and_the_topics_of_the_simulator():
    robot = ElementTree.fromstring(robot_description(CONFIG, 'effort', 'left'))
    (control,) = robot.findall('ros2_control')
    hardware = control.find('hardware')
    assert hardware.findtext('plugin') == (
        'joint_state_topic_hardware_interface/JointStateTopicSystem'
    )
    topics = {param.get('name'): param.text for param in hardware.findall('param')}
    assert topics == {
        'joint_commands_topic': '/left/tendon_commands/joint_state',
        'joint_states_topic': '/left/tendon_states',
    }
    assert [joint.get('name') for joint in control.findall('joint')] == NAMES
    for joint in control.findall('joint'):
        assert [one.get('name') for one in joint.findall('command_interface')] == ['effort']
        states = [one.get('name') for one in joint.findall('state_interface')]
        assert states == ['position', 'velocity', 'effort']
    # Every joint that is controlled is one of the robot, between links that are there.
    assert [joint.get('name') for joint in robot.findall('joint')] == NAMES
    links = {link.get('name') for link in robot.findall('link')}
    ends = {
        joint.find(end).get('link')
        for joint in robot.findall('joint')
        for end in ('parent', 'child')
    }
    assert ends == links
    with pytest.raises(ConfigError, match="interface is 'velocity', expected effort or position"):
        robot_description(CONFIG, 'velocity')


def test_the_controllers_are_of_the_tendons_and_of_interfaces_that_are_described():
    path = ROOT / 'config' / 'ros2_control' / 'controllers.yaml'
    # rcl takes no aliases.
    assert '&' not in path.read_text() and ' *' not in path.read_text()
    given = {
        name.removeprefix('/**/'): part['ros__parameters']
        for name, part in yaml.safe_load(path.read_text()).items()
    }
    manager = given.pop('controller_manager')
    assert {name for name, value in manager.items() if isinstance(value, dict)} == {
        'joint_state_broadcaster',
        *given,
    }
    for controller in given.values():
        assert controller['joints'] == list(load_config('renda2012_table4').arm.tendon_names)
    assert given['tendon_effort_controller']['interface_name'] == 'effort'
    assert given['tendon_position_controller']['interface_name'] == 'position'


def test_commands_by_effort_and_by_position_reach_their_states_and_then_end(system):
    system.reach('effort', np.array([0.5, 0.0, 0.2, 0.0]))
    sent = system.sent
    system.write('effort', np.array([0.5, 0.0, 0.2, 0.0]))
    assert system.sent == sent
    lengths = dict(zip(NAMES, (0.006, 0.0, 0.0, 0.003)))
    expected = solve_displacements(CONFIG.solver('exact'), lengths, {})
    # Slack tendons are not taut at any length: those that pull come to theirs.
    pulled = expected.backbone.tensions.ravel() > 0.0

    wanted = np.array(list(lengths.values()))

    def is_there():
        last = system.states[-1]
        return np.allclose(last.effort, expected.backbone.tensions.ravel(), atol=1e-6) and (
            np.allclose(np.array(last.position)[pulled], wanted[pulled], atol=1e-5)
        )

    system.wait(is_there, 'lengths', lambda: system.write('position', wanted))
    # The newest command of a tendon counts, whatever its interface; others stay as they are.
    held = {name: length for name, length in lengths.items() if name != NAMES[0]}
    mixed = solve_displacements(CONFIG.solver('exact'), held, {NAMES[0]: 0.25}).backbone
    system.wait(
        lambda: np.allclose(system.states[-1].effort, mixed.tensions.ravel(), atol=1e-6),
        'a tension beside lengths',
        lambda: system.tell(name=NAMES[:1], effort=[0.25]),
    )
    system.reach('effort', np.zeros(4))


REFUSED = {
    'of both': (
        NAMES,
        {'position': [0.0] * 4, 'effort': [0.1] * 4},
        'a command of position and effort, expected either effort [N] or position [m]',
    ),
    'by velocity': (NAMES, {'velocity': [0.0] * 4}, 'a command of velocity, expected either'),
    'of nothing': (NAMES, {}, 'a command of nothing, expected either'),
    'short effort': (NAMES, {'effort': [0.1] * 3}, 'name has 4 entries but effort has 3'),
    'short position': (NAMES, {'position': [0.0]}, 'name has 4 entries but position has 1'),
    'no position': (
        NAMES,
        {'position': [float('nan')] * 4},
        'displacement of tendon_1_1 is nan m',
    ),
    'an unknown position': (['elbow'], {'position': [0.1]}, 'unknown tendon elbow'),
    'too long': (
        NAMES[:1],
        {'position': [2.0]},
        'displacement of tendon_1_1 is 2 m, expected less than there is',
    ),
}


@pytest.mark.parametrize('case', REFUSED)
def test_other_commands_are_refused_counted_and_the_one_before_is_kept(system, case):
    names, arrays, reason = REFUSED[case]
    before = np.array([0.3, 0.0, 0.0, 0.1])
    system.reach('effort', before)
    system.diagnostics.clear()

    bad = partial(system.tell, name=names, **arrays)
    system.log(f'/{JOINTS} refused: ', reason, again=bad)
    system.wait(lambda: reason in system.status('simulator')[1]['last refusal'], 'its count', bad)
    assert int(system.status('simulator')[1]['refused'])
    assert_allclose(system.states[-1].effort, before, atol=1e-12)
