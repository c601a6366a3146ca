"""Clients of nodes: what is made of messages, and the command load."""

import contextlib
from types import SimpleNamespace

import live_nodes
import numpy as np
import pytest
import rclpy
from backbone_messages import messages_of
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_nodes import CONFIG_FILE, RosClient, new_domain, setting
from std_msgs.msg import String

from octo_arm_model import load_config
from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client import client as client_module
from octo_arm_model.ros.client.client import COMMANDS, DETAILS, POSES, ArmClient
from octo_arm_model.ros.estimator.main import EstimatorNode
from octo_arm_model.ros.node.inputs import MOST_BYTES
from octo_arm_model.ros.node.outputs import LATCHED_QOS, OUTPUT_QOS
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.simulation.movements import TOPIC
from octo_arm_model.wire.estimate import CONTACT, COVARIANCE

TOPICS = {**POSES, 'strains': DETAILS['strains']}


class Reading(RosClient):
    """A node of the arm of table 4, and a ``reader`` of its topics in the same domain."""

    def __init__(self, topics):
        super().__init__(new_domain())
        self.reader = ArmClient(rclpy.create_node('reading', context=self.context))
        self.reader.listen(topics)

    def publisher(self, kind, name):
        """A publisher that is heard, once the reader knows the arm."""
        description = self.node.create_publisher(String, 'arm_description', LATCHED_QOS)
        description.publish(String(data=CONFIG_FILE.read_text()))
        made = self.node.create_publisher(kind, name, OUTPUT_QOS)
        self.read(lambda: self.reader.config and made.get_subscription_count(), 'a subscription')
        return made

    def read(self, condition, what):
        self.wait(lambda: self.reader.poll() or condition(), what)


@pytest.mark.parametrize('name', TOPICS)
@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 40], ids=len)
def test_bytes_that_are_no_message_are_a_problem_until_the_next_one(name, data):
    with contextlib.closing(Reading(TOPICS)) as ros:
        client, publisher = ros.reader, ros.publisher(TOPICS[name], name)
        publisher.publish(data)
        ros.read(lambda: client.problem, 'a problem')
        kind = TOPICS[name].__name__
        assert client.problem == f'{name}: {len(data)} bytes that are no {kind}'
        solver = client.config.solver()
        backbone = solver.solve(0.0 * solver.rest_lengths)
        stamp, frame = ros.node.get_clock().now().to_msg(), client.config.base_frame
        _, poses, strains = messages_of(backbone, stamp, frame)
        publisher.publish(poses if name in POSES else strains)
        ros.read(lambda: not client.problem, 'a message')
        assert (client.shape if name in POSES else client.strains) is not None


def test_a_command_of_too_many_bytes_is_not_decoded():
    data = bytes(MOST_BYTES + 1)
    with contextlib.closing(Reading(COMMANDS)) as ros:
        publisher = ros.publisher(COMMANDS[TOPIC], TOPIC)
        ros.read(lambda: publisher.publish(data) or ros.reader.problem, 'a problem')
        problem = f'{TOPIC}: {len(data)} bytes, expected at most {MOST_BYTES}'
        assert ros.reader.problem == problem


def test_a_command_that_came_before_one_of_the_client_is_out_of_date():
    with contextlib.closing(Reading(COMMANDS)) as ros:
        client, tell = ros.reader, ros.publisher(COMMANDS[TOPIC], TOPIC).publish
        names, heard = list(client.config.arm.tendon_names), ros.hear(COMMANDS[TOPIC], TOPIC)
        message = COMMANDS[TOPIC](name=names, tension=[0.1] * len(names))
        ros.wait(lambda: heard or tell(message), 'the message')
        client.command(np.zeros(len(names)))
        client.poll()
        assert not client.take_command()
        ros.read(lambda: tell(message) or client.take_command(), 'a newer one')


def test_of_two_nodes_no_rate_is_told_but_that_they_are_two():
    with contextlib.closing(Reading(TOPICS)) as ros:
        client = ros.reader
        kind, nodes = POSES['backbone/poses'], []
        for count, rate in ((1, 0.0), (2, np.nan)):
            nodes.append(ros.node.create_publisher(kind, 'backbone/poses', OUTPUT_QOS))
            ros.wait(lambda rate=rate: np.array_equal(client.rate(), rate, True), 'a rate')
            expected = '' if count == 1 else '2 nodes publish shapes on backbone/poses'
            assert client.problem == expected
        ros.node.destroy_publisher(nodes[0])
        ros.wait(lambda: client.rate() == 0.0, 'one node')
        assert client.problem == ''


def _spoiled(part, change):
    """A message of a ``part`` of what the node publishes, with a ``change`` to it."""
    config = load_config(CONFIG_FILE)
    backbone = config.solver().solve(np.zeros((3, 4)))
    _, poses, strains = messages_of(backbone, Time(), config.base_frame)
    stations = len(backbone.s)
    covariance = DETAILS[COVARIANCE](s=backbone.s, pose=np.zeros(36 * stations))
    messages = {
        'backbone/poses': poses,
        'strains': strains,
        'tip_pose': DETAILS['tip_pose'](),
        COVARIANCE: covariance,
        CONTACT: DETAILS[CONTACT](),
    }
    change(messages[part])
    return messages[part]


SPOILED = {
    ('backbone/poses', 'poses.3.position.x', np.nan): 'poses holds numbers that are not finite',
    ('backbone/poses', 'poses.3.orientation.w', 2.0): 'quaternions that are not of length 1',
    ('strains', 'q', (0.0,)): 'q has 1 numbers, expected 101',
    ('strains', 'xi.5', np.inf): 'xi holds numbers that are not finite',
    ('strains', 'q.5', -1.0): 'q compresses the arm to nothing',
    ('strains', 'tau.5', 1e300): 'tau holds numbers that are not finite, or beyond',
    ('tip_pose', 'pose.covariance.7', -1.0): 'covariance has variances below zero',
    ('tip_pose', 'pose.covariance.0', np.nan): 'covariance holds numbers that are not finite',
    (COVARIANCE, 'pose.5', np.nan): 'pose holds numbers that are not finite',
    (COVARIANCE, 'contact.5', np.nan): 'contact holds numbers that are not finite',
    (COVARIANCE, 'contact.7', -1.0): 'contact has variances below zero',
    (COVARIANCE, 'contact_s', np.inf): 'contact_s is infinite',
    (COVARIANCE, 'pose', (0.0,)): 'pose has 1 numbers, expected 36 for each of 101 stations',
    (CONTACT, 'wrench.force.y', np.inf): 'force holds numbers that are not finite',
}


@pytest.mark.parametrize('case', SPOILED, ids=lambda case: f'{case[0]}: {case[1]}')
def test_numbers_that_nothing_can_be_drawn_of_are_a_problem(case):
    name, path, value = case
    with contextlib.closing(Reading({**POSES, **DETAILS})) as ros:
        client, publisher = ros.reader, ros.publisher({**POSES, **DETAILS}[name], name)
        publisher.publish(_spoiled(name, setting(path, value)))
        ros.read(lambda: client.problem, 'a problem')
        assert client.problem.startswith(f'{name}: ') and SPOILED[case] in client.problem
        assert client.shape is client.strains is client.covariance is client.force is None
        assert not client.tip_deviation.any()


def test_problems_are_bounded_and_forgotten_with_the_node_that_had_them(monkeypatch):
    with contextlib.closing(Reading({})) as ros:
        client = ros.reader
        publisher = ros.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        bad = {'level': b'\x02', 'message': 'x' * 2000, 'hardware_id': '/arm'}
        status = [DiagnosticStatus(name=f'a: {number}', **bad) for number in range(1000)]
        ros.wait(publisher.get_subscription_count, 'a subscription')
        publisher.publish(DiagnosticArray(status=status))
        ros.wait(lambda: client.poll() or client.problem, 'problems')
        assert len(client.problem) < 70_000
        monkeypatch.setattr(client_module, 'time', SimpleNamespace(monotonic=lambda: 1e9))
        assert not client.poll() and not client.problem
        publisher.publish(DiagnosticArray(status=[DiagnosticStatus(name='b: new', **bad)]))
        ros.wait(lambda: client.poll() or client.problem.startswith('new: x'), 'another node')
        publisher.publish(b'')
        no_message = '/diagnostics: 0 bytes that are no DiagnosticArray'
        ros.wait(lambda: client.poll() or no_message in client.problem, 'no message')


@pytest.fixture
def load(monkeypatch, capfd):
    """Runs `octo-arm load`; returns its status and what it wrote to stdout and stderr."""

    def run(client, *arguments):
        monkeypatch.setenv('ROS_DOMAIN_ID', str(client.domain))
        capfd.readouterr()
        with live_nodes.spinning(client):
            waiting = () if '--wait' in arguments else ('--wait', live_nodes.DEADLINE)
            status = main(['load', *map(str, (*waiting, *arguments))])
        said, complaints = capfd.readouterr()
        # The node logs here as well.
        own = [line for line in complaints.splitlines(True) if not line.startswith('[')]
        return status, said, ''.join(own)

    return run


def test_the_arm_of_a_running_node_is_exchanged_as_a_whole(client, load):
    before = client.dump()
    loads = {'loads__point_s': [0.1], 'loads__point_force': [0.0, 0.0, 0.01]}
    assert client.change(**loads, model='exact', stations=51) == (True, '')
    status, said, complaints = load(client, 'renda2012_table2')
    assert (status, complaints) == (0, '')
    assert '/octo_arm has the arm of' in said
    after = client.dump()
    # What the file does not name is as if it had never been set.
    assert after['loads.point_s'] == after['loads.point_force'] == []
    wanted = load_config('renda2012_table2')
    assert after['model'] == wanted.model
    assert after['sections.anchorage'] == [section.anchorage for section in wanted.arm.sections]
    status, _, complaints = load(client, live_nodes.CONFIG_FILE)
    assert (status, complaints) == (0, '')
    assert client.dump() == before
    answers = client.ask('tendon_tensions', FETCHING_IN_PLANE)
    live_nodes.assert_is_backbone(answers, FETCHING_IN_PLANE)


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', '', 'body.length is missing, expected double'),
        ('length: 0.45', 'girth: 0.45', 'body.girth is no parameter of arm, simulator or es'),
        ('stations: 101', 'stations: 3', '/octo_arm stays as it is: stations is 3, expected'),
    ],
)
def test_a_file_that_is_no_arm_changes_nothing(client, load, tmp_path, old, new, complaint):
    before = client.dump()
    status, _, complaints = load(client, live_nodes.file_with(tmp_path, old, new))
    assert status == 2 and complaint in complaints and complaints.count('\n') == 1
    assert client.dump() == before


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('--node', '/nobody', '--wait', '0.1'), 'no node /nobody within 0.1 s'),
        (('--node', '/not a name'), "--node is '/not a name', expected the name of a node"),
        (('--wait', 'nan'), '--wait is nan'),
    ],
)
def test_a_node_that_has_no_arm_is_told(client, load, arguments, complaint):
    status, _, complaints = load(client, live_nodes.CONFIG_FILE, *arguments)
    assert status == 2 and complaint in complaints and complaints.count('\n') == 1


@pytest.mark.parametrize('name', ['octo_arm_sim', 'octo_arm_estimator'])
def test_simulator_and_estimator_keep_or_take_what_is_their_own(load, tmp_path, name):
    file, text = tmp_path / 'arm.yaml', preset_path('renda2012_prototype').read_text().rstrip()
    if name == 'octo_arm_sim':
        make_node, before, expected = SimulatorNode, {'winches.lag': 0.5}, {'winches.lag': 0.5}
    else:
        make_node, before, expected = EstimatorNode, {}, {'estimator.force_stddev': 0.5}
        text += '\n    estimator: {force_stddev: 0.5}'
    file.write_text(f'{text}\n')
    with live_nodes.hosting(make_node, **before) as node:
        node.dump()
        status, _, complaints = load(node, file, '--node', f'/{name}')
        assert status == 0, complaints
        expected['sections.anchorage'] = [0.27]
        assert node.dump().items() >= expected.items()
