"""The node as a process of its own, asked over real DDS."""

import itertools
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains, TendonTensions
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import DescribeParameters
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from octo_arm_model import load_config
from octo_arm_model.paper import FETCHING_IN_PLANE, FETCHING_IN_SPACE, preset_path
from octo_arm_model.parameters import PARAMETERS

DEADLINE = 30.0  # [s] for anything that takes milliseconds on an idle machine
CONFIG_FILE = preset_path('renda2012_table4')
CONFIG = load_config(CONFIG_FILE)
NAMES = list(CONFIG.arm.tendon_names)
INPUTS = {
    'tendon_tensions': TendonTensions,
    'tendon_tensions/array': Float64MultiArray,
    'tendon_tensions/joint_state': JointState,
}
OUTPUTS = {'backbone/path': Path, 'backbone/poses': PoseArray, 'strains': SectionStrains}
# Every node of this file gets a domain of its own.
DOMAINS = itertools.count(1 + os.getpid() % 80)
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def start(module, *arguments, domain):
    return subprocess.Popen(
        [sys.executable, '-m', f'octo_arm_model.ros.{module}', *arguments],
        env=dict(os.environ, ROS_DOMAIN_ID=str(domain), ROS_PYTHON_CHECK_FIELDS='1'),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def start_node(domain, config=CONFIG_FILE):
    return start('node', '--ros-args', '--params-file', str(config), domain=domain)


def stop(process, how=signal.SIGINT):
    process.send_signal(how)
    _, complaints = process.communicate(timeout=DEADLINE)
    return process.returncode, complaints


class Client:
    """Publishes tensions and keeps what the node answers."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('client', context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, 10) for topic, kind in INPUTS.items()
        }
        self.answers = {topic: [] for topic in OUTPUTS}
        for topic, kind in OUTPUTS.items():
            qos = QoSProfile(depth=100)
            self.node.create_subscription(kind, topic, self.answers[topic].append, qos)
        self.logs = []
        self.node.create_subscription(Log, '/rosout', self.logs.append, 100)
        self.stamps = itertools.count(1)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def wait(self, condition, what):
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end, f'{what} did not happen in {DEADLINE} s'
            self.executor.spin_once(timeout_sec=0.1)

    def connect(self):
        """Ask until each input reaches the node and each output comes back."""
        for topic in INPUTS:
            self.forget()

            def answered(topic=topic):
                self.send(topic, np.zeros((3, 4)))
                self.executor.spin_once(timeout_sec=0.1)
                return all(self.answers.values())

            self.wait(answered, f'an answer to {topic}')
        # Leave nothing under way that a test could take for its answer.
        counts = None
        while counts != (counts := [len(got) for got in self.answers.values()]):
            for _ in range(10):
                self.executor.spin_once(timeout_sec=0.05)

    def forget(self):
        for got in self.answers.values():
            got.clear()

    def send(self, topic, tensions, names=NAMES):
        """Publish tensions; returns the seconds of the stamp, None where there is none."""
        values = np.ravel(np.asarray(tensions, dtype=float))
        if topic == 'tendon_tensions/array':
            self.publishers[topic].publish(Float64MultiArray(data=values))
            return None
        if topic == 'tendon_tensions':
            message = TendonTensions(name=names, tension=values)
        else:
            message = JointState(name=names, effort=values)
        message.header.stamp.sec = next(self.stamps)
        message.header.frame_id = 'of the load cells'
        self.publishers[topic].publish(message)
        return message.header.stamp.sec

    def ask(self, topic, tensions):
        """Publish and wait for the answer on every topic: path, poses, strains."""
        before = {name: len(got) for name, got in self.answers.items()}
        stamp = self.send(topic, tensions)

        def answered():
            return all(len(got) > before[name] for name, got in self.answers.items())

        self.wait(answered, f'an answer to {topic}')
        newest = [self.answers[name][-1] for name in OUTPUTS]
        if stamp is not None:
            assert {answer.header.stamp.sec for answer in newest} == {stamp}
        return newest


@pytest.fixture(scope='module')
def client():
    domain = next(DOMAINS)
    process = start_node(domain)
    client = Client(domain)
    try:
        client.connect()
        yield client
        assert process.poll() is None, 'the node died'
    finally:
        client.close()
        stop(process)


def assert_is_backbone(answers, tensions):
    path, poses, strains = answers
    expected = CONFIG.solver().solve(tensions)
    points = [pose.pose.position for pose in path.poses]
    np.testing.assert_array_equal([[p.x, p.y, p.z] for p in points], expected.position)
    turns = [pose.orientation for pose in poses.poses]
    np.testing.assert_array_equal([[r.x, r.y, r.z, r.w] for r in turns], expected.quaternion)
    np.testing.assert_array_equal(strains.k, expected.k)
    np.testing.assert_array_equal(strains.section, expected.section)
    assert {answer.header.frame_id for answer in answers} == {'arm_base'}


@pytest.mark.parametrize('topic', INPUTS)
def test_every_input_is_answered_with_the_backbone_of_its_tensions(client, topic):
    for tensions in (FETCHING_IN_PLANE, FETCHING_IN_SPACE, np.zeros((3, 4))):
        assert_is_backbone(client.ask(topic, tensions), tensions)


def test_input_without_a_stamp_gets_the_time_of_receipt(client):
    before = time.time()
    path, poses, strains = client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    stamp = path.header.stamp
    assert before - 1.0 <= stamp.sec + stamp.nanosec * 1e-9 <= time.time() + 1.0
    assert poses.header.stamp == strains.header.stamp == stamp


def tensions_with(value):
    tensions = np.array(FETCHING_IN_PLANE)
    tensions[1, 2] = value
    return tensions


BAD = {
    'negative': (tensions_with(-0.5), NAMES),
    'nan': (tensions_with(np.nan), NAMES),
    'infinite': (tensions_with(np.inf), NAMES),
    'enormous': (tensions_with(1e300), NAMES),
    'too few': (np.zeros(11), NAMES[:11]),
    'too many': (np.zeros(13), [*NAMES, 'tendon_4_1']),
    'none': (np.zeros(0), []),
    'unknown name': (np.zeros(12), [*NAMES[:11], 'elbow']),
    'duplicate name': (np.zeros(12), [*NAMES[:11], NAMES[0]]),
    'names and values of different length': (np.zeros(5), NAMES),
}


@pytest.mark.parametrize(
    ('topic', 'case'),
    [(t, c) for t in INPUTS for c in BAD if not (t.endswith('array') and 'name' in c)],
)
def test_bad_input_is_not_answered_and_the_next_good_one_is(client, topic, case):
    values, names = BAD[case]
    client.forget()
    client.send(topic, values, names)
    # An answer on another topic says that the bad one has had its turn.
    other = next(name for name in INPUTS if name != topic)
    client.ask(other, FETCHING_IN_SPACE)
    assert_is_backbone(client.ask(topic, FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    assert {name: len(got) for name, got in client.answers.items()} == dict.fromkeys(OUTPUTS, 2)


def test_refusal_is_explained_in_the_log_but_not_for_every_message(client):
    client.wait(lambda: client.node.count_publishers('/rosout') > 1, 'the log of the node')
    seen = len(client.logs)

    def refusals():
        return [log.msg for log in client.logs[seen:] if 'refused' in log.msg]

    sent = 0
    end = time.monotonic() + DEADLINE
    while not refusals():  # the throttle of an earlier test may still hold
        assert time.monotonic() < end, 'no refusal was logged'
        client.send('tendon_tensions', tensions_with(-0.5))
        sent += 1
        client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    assert 'tension of tendon_2_3 is -0.5 N' in refusals()[0]
    for _ in range(20):
        client.send('tendon_tensions', tensions_with(-0.5))
        client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    assert len(refusals()) < 20


def test_parameters_are_described_with_their_unit_and_read_only(client):
    service = client.node.create_client(DescribeParameters, 'octo_arm/describe_parameters')
    client.wait(service.service_is_ready, 'the parameter service')
    names = [parameter.name for parameter in PARAMETERS]
    answer = service.call_async(DescribeParameters.Request(names=names))
    client.wait(answer.done, 'the description of the parameters')
    for parameter, descriptor in zip(PARAMETERS, answer.result().descriptors):
        assert descriptor.name == parameter.name
        assert descriptor.description == parameter.description
        assert descriptor.read_only


@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGTERM])
def test_node_ends_cleanly(how):
    domain = next(DOMAINS)
    process = start_node(domain)
    client = Client(domain)
    try:
        client.connect()
    finally:
        client.close()
    status, complaints = stop(process, how)
    assert status == 0, complaints
    assert 'Traceback' not in complaints


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', 'length: 1', 'body.length is an integer, expected double'),
        ('length: 0.45', 'length: -1.0', 'body.length is -1.0, expected a finite number > 0 [m]'),
        ('length: 0.45', 'girth: 0.45', 'body.girth is no parameter of the arm'),
        ('length: 0.45', '', 'body.length is missing'),
        ('length: 0.45', 'length: [0.45', 'parse'),
        ('0.45, 0.315', '1, 0.315', 'Sequence should be of same type'),
        ('model: renda2012', 'model: octopus', "model is 'octopus', expected one of renda2012"),
        ('stations: 101', 'stations: 3', 'stations is 3, expected at least 4'),
    ],
)
def test_bad_parameters_end_the_node_with_one_line_that_says_why(tmp_path, old, new, complaint):
    config = tmp_path / 'bad.yaml'
    text = CONFIG_FILE.read_text()
    assert old in text
    config.write_text(text.replace(old, new))
    process = start_node(next(DOMAINS), config)
    _, complaints = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert complaint in complaints
    assert 'Traceback' not in complaints


def test_demonstration_shows_the_arm_and_ends_with_its_node():
    demo = start('demo', str(CONFIG_FILE), domain=next(DOMAINS))
    line = ''
    while 'to the base' not in line:
        line = demo.stdout.readline()
        assert line, 'the demonstration ended by itself'
    assert 'shapes/s' in line
    demo.send_signal(signal.SIGINT)
    _, complaints = demo.communicate(timeout=DEADLINE)
    assert 'Traceback' not in complaints
    assert demo.returncode == 0, complaints
