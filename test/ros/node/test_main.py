"""The node as a process and as a managed node: its start, its end and its states."""

import signal
import subprocess
import sys
import time
from functools import partial
from unittest.mock import Mock

import live_nodes
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from octo_arm_msgs.srv import Solve
from std_msgs.msg import String

from octo_arm_model import Config, OctoArmError, load_config
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.config.parameter_files import parse_parameters
from octo_arm_model.ros.estimator.main import ManagedEstimatorNode
from octo_arm_model.ros.node import arm_server
from octo_arm_model.ros.node import main as node
from octo_arm_model.ros.node.outputs import LATCHED_QOS
from octo_arm_model.ros.simulator import main as simulator


@pytest.mark.parametrize(
    ('first', 'again'),
    [
        (signal.SIGINT, signal.SIGTERM),
        pytest.param(signal.SIGTERM, signal.SIGINT, marks=pytest.mark.endurance),
    ],
)
def test_signals_that_come_while_it_ends_change_nothing(first, again):
    with live_nodes.running('ros.node.main') as client:
        client.wait(lambda: client.diagnostics, 'a diagnosis')
        client.process.send_signal(first)
        # Until the end: also while Python frees its modules, with its handlers gone.
        while client.process.poll() is None:
            client.process.send_signal(again)
            time.sleep(live_nodes.PERIOD)
        live_nodes.check_end(client.process, 0)


def test_a_middleware_that_does_not_let_go_does_not_keep_the_node():
    # Waits in C, as Fast DDS does, where Python's threads and signal handlers get no turn.
    program = """
import ctypes, os, signal
from rclpy.node import Node
from octo_arm_model.ros.node import main as node
class Stuck(Node):
    def __init__(self):
        super().__init__('stuck')
        self.create_timer(0.01, lambda: os.kill(os.getpid(), signal.SIGTERM))
    def destroy_node(self):
        ctypes.PyDLL(None).sleep(1000)
node.LONGEST_END = 0.2
node.run('stuck', Stuck)
"""
    done = subprocess.run(
        [sys.executable, '-c', program],
        env=live_nodes.environment(live_nodes.new_domain()),
        capture_output=True,
        text=True,
        timeout=live_nodes.DEADLINE,
        check=False,
    )
    assert done.returncode == 1 and 'in destroy_node' in done.stderr


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', 'length: -1.0', 'body.length is -1.0, expected a finite number > 0 [m]'),
        ('0.45, 0.315', 'here, 0.315', 'expected a list of values of one type'),
        ('0.45, 0.315', '1, 0.315', 'sections[1].anchorage is 1.0, expected at most the length'),
        ('stations: 101', 'stations: []', 'stations is [], expected integer'),
        ('stations: 101', 'tendon_names: [1, 2]', 'tendon_names is [1, 2], expected string[]'),
        ('stations: 101', 'use_sim_time: 5', 'use_sim_time'),
    ],
)
def test_bad_parameters_end_the_node_with_the_line_of_the_command(
    tmp_path, run_here, old, new, complaint
):
    path = live_nodes.file_with(tmp_path, old, new)
    told = run_here(node.main, 1, '--ros-args', '--params-file', path)
    assert complaint in told
    if 'use_sim_time' not in new:  # which no arm has
        with pytest.raises(OctoArmError) as refusal:
            load_config(path).solver()
        assert str(refusal.value).removeprefix(f'{path}: ') in told


def test_a_process_that_is_given_a_bad_parameter_says_so_and_ends():
    process = live_nodes.start_node('ros.node.main', live_nodes.new_domain(), stations=3)
    assert 'stations is 3, expected at least 4' in live_nodes.check_end(process, 1)


@pytest.mark.parametrize(
    ('program', 'name'),
    [
        (node.main, 'octo_arm_node'),
        (node.managed, 'octo_arm_lifecycle_node'),
        (simulator.main, 'octo_arm_sim'),
    ],
)
def test_a_file_alone_is_not_passed_over(run_here, capfd, program, name):
    with pytest.raises(SystemExit) as left:
        run_here(program, 2, live_nodes.CONFIG_FILE, '--ros-args')
    assert left.value.code == 2
    complaints = capfd.readouterr().err
    assert f'{name}: error: unrecognized arguments: {live_nodes.CONFIG_FILE}' in complaints
    assert complaints.count('\n') == 1


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('--params-file', 'nowhere.yaml'), 'nowhere.yaml: No such file or directory'),
        (('--params-file', '/'), '/: Is a directory'),
        (('--params-file', 'octopus'), "no preset arm 'octopus', expected one of"),
        (('-p', 'half'), 'half'),
        (('-p', 'loads.gravity:=[0, x]'), "[0, 'x'], expected a list of values of one type"),
        (('-p', 'loads.gravity:=[0, 1'), 'loads.gravity:=[0, 1, line 1: not valid YAML'),
    ],
)
def test_arguments_that_cannot_be_read_are_told(run_here, arguments, complaint):
    assert complaint in run_here(node.main, 1, '--ros-args', *arguments)


def test_of_values_given_twice_the_last_counts_whatever_its_type(tmp_path, run_here):
    later = tmp_path / 'later.yaml'
    later.write_text('/**:\n  ros__parameters: {friction_memory: 2.5, loads.fluid_density: 0.5}\n')
    first = live_nodes.file_with(
        tmp_path, 'stations: 101', 'stations: 101\n    friction_memory: 3'
    )
    given = {'files': [first, later], 'loads.fluid_density': 2}
    with live_nodes.running('ros.node.main', **given) as client:
        dumped = client.dump()
        # By SIGINT every other process of `running` ends.
        client.process.send_signal(signal.SIGTERM)
        live_nodes.check_end(client.process, 0)
    assert (dumped['friction_memory'], dumped['loads.fluid_density']) == (2.5, 2.0)
    given = '--ros-args', '--params-file', live_nodes.CONFIG_FILE, '-p', 'stations:=many'
    assert "stations is 'many', expected integer" in run_here(node.main, 1, *given)


ORIGIN = 'position: [0.0, 0.0, 0.0]'


# What rcl refuses or reads as integers, and what the command reads of it.
@pytest.mark.parametrize(
    ('old', 'new', 'name', 'value'),
    [
        ('length: 0.45', 'length: 1', 'body.length', 1.0),
        (ORIGIN, 'position: [1, 2, 3]', 'base.position', [1.0, 2.0, 3.0]),
        (ORIGIN, 'position: [0, 0.5, 1e-2]', 'base.position', [0.0, 0.5, 0.01]),
        (ORIGIN, 'position: [&z 0.25, *z, 1]', 'base.position', [0.25, 0.25, 1.0]),
        ('base_frame: arm_base', "base_frame: 'no'", 'base_frame', 'no'),
    ],
)
def test_the_node_reads_a_file_as_the_command_does(tmp_path, old, new, name, value):
    path = live_nodes.file_with(tmp_path, old, new)
    others = 'camera: {ros__parameters: {rate: 30, gains: [1, 0.5]}}\nversion: 2\n'
    path.write_text(path.read_text() + others)
    given = ('-p', 'loads.fluid_density:=0', '-p', 'octo_arm:loads.gravity:=[0, 0, 0.0]')
    with live_nodes.hosting(node.OctoArmNode, *given, files=[path]) as client:
        dumped = client.dump()
        assert dumped[name] == value
        assert (dumped['loads.fluid_density'], dumped['loads.gravity']) == (0.0, [0.0, 0.0, 0.0])
        heard = client.hear(String, 'arm_description', LATCHED_QOS)
        client.wait(lambda: heard, 'the description of the arm')
    assert Config.from_parameters(parse_parameters(heard[-1].data, 'it')) == load_config(path)


def test_fast_dds_takes_our_profiles_unless_it_is_set_up_otherwise(tmp_path):
    environment = {}
    assert node.bound_memory(environment, tmp_path)
    assert environment['RMW_FASTRTPS_USE_QOS_FROM_XML'] == '1'
    assert environment['FASTDDS_DEFAULT_PROFILES_FILE'] == str(node.PROFILES)
    assert '<historyMemoryPolicy>DYNAMIC<' in node.PROFILES.read_text(encoding='utf-8')
    # A child of such a process finds it done; what the user has set up stays.
    names = (
        'FASTDDS_DEFAULT_PROFILES_FILE',
        'FASTRTPS_DEFAULT_PROFILES_FILE',
        'RMW_FASTRTPS_USE_QOS_FROM_XML',
        'RMW_FASTRTPS_PUBLICATION_MODE',
    )
    for decided in (environment, *({name: 'mine'} for name in names)):
        before = dict(decided)
        assert not node.bound_memory(decided, tmp_path)
        assert decided == before
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<dds/>')
    environment = {}
    assert not node.bound_memory(environment, tmp_path)
    assert not environment


def test_a_managed_node_answers_while_it_is_active_and_says_what_it_is(monkeypatch):
    copies = []  # a solve that goes on beyond a deactivation keeps its own
    copying = Mock(copy=lambda solver: copies.append(solver) or solver)
    monkeypatch.setattr(arm_server, 'copy', copying)
    with live_nodes.hosting(node.ManagedOctoArmNode) as client:
        assert client.change(diagnostics__silence_limit=1e6) == (True, '')

        def says(words):
            parts = client.diagnostics[-1].status if client.diagnostics else []
            level = DiagnosticStatus.OK if words == 'waiting' else DiagnosticStatus.WARN
            return len(parts) == 3 and all((p.message, p.level) == (words, level) for p in parts)

        def turns(transition, words):
            assert client.transition(transition)
            client.wait(lambda: says(words), f'the diagnosis of one that is {words}')

        client.wait(lambda: says('unconfigured'), 'the diagnosis of an unconfigured node')
        for impossible in (Transition.TRANSITION_ACTIVATE, live_nodes.NO_TRANSITION):
            assert not client.transition(impossible)
        turns(Transition.TRANSITION_CONFIGURE, 'inactive')
        client.wait(lambda: client.node.count_publishers('backbone/path'), 'a configured node')
        assert client.node.count_subscribers('tendon_tensions') == 0
        for _ in range(2):
            turns(Transition.TRANSITION_ACTIVATE, 'waiting')
            client.connect()
            answers = client.ask('tendon_tensions', FETCHING_IN_PLANE)
            live_nodes.assert_is_backbone(answers, FETCHING_IN_PLANE)
            assert not client.call(Solve, 'solve', Solve.Request()).success
            turns(Transition.TRANSITION_DEACTIVATE, 'inactive')
            client.wait(lambda: not client.node.count_subscribers('tendon_tensions'), 'its end')
        assert len(copies) == 2
        assert client.status('solver')[1]['model'] == 'renda2012'
        turns(Transition.TRANSITION_CLEANUP, 'unconfigured')
        client.wait(lambda: not client.node.count_publishers('backbone/path'), 'its end')
        assert client.status('solver')[1]['model'] == ''
        assert client.transition(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        assert client.status('input')[0].message == 'finalized'


def test_a_managed_node_that_cannot_be_configured_says_why_and_stays(tmp_path):
    files = [live_nodes.file_with(tmp_path, 'length: 0.45', 'length: 0.1')]
    with live_nodes.hosting(node.ManagedOctoArmNode, files=files) as client:
        assert not client.transition(Transition.TRANSITION_CONFIGURE)
        assert client.change(body__length=0.45) == (True, '')
        client.log('not configured: sections[1].anchorage is 0.45')
        assert client.transition(Transition.TRANSITION_CONFIGURE)


@pytest.mark.parametrize(
    ('make_node', 'topic', 'heard', 'first'),
    [
        (node.ManagedOctoArmNode, 'markers', 'tendon_tensions/joint_state', 'tendon_tensions'),
        (ManagedEstimatorNode, 'tension_bias', 'measured/markers', 'measured/tip_pose'),
    ],
)
def test_a_managed_node_that_cannot_publish_or_subscribe_leaves_nothing_behind(
    make_node, topic, heard, first
):
    with live_nodes.hosting(
        make_node, **{f'qos_overrides./{topic}.publisher.depth': -5}
    ) as client:
        for _ in range(2):
            assert not client.transition(Transition.TRANSITION_CONFIGURE)
            client.log('not configured: qos_overrides')
            count = partial(client.node.count_publishers, 'backbone/path')
            client.wait(lambda count=count: count() == 0, 'a node without publishers')
    with live_nodes.hosting(
        make_node, **{f'qos_overrides./{heard}.subscription.depth': -5}
    ) as client:
        assert client.transition(Transition.TRANSITION_CONFIGURE)
        for _ in range(2):
            assert not client.transition(Transition.TRANSITION_ACTIVATE)
            count = partial(client.node.count_subscribers, first)
            client.wait(lambda count=count: count() == 0, 'a node without subscriptions')
