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

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import (
    PoseArray,
    PoseWithCovarianceStamped,
    TransformStamped,
    WrenchStamped,
)
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains, TendonTensions
from octo_arm_msgs.srv import FindTensions, Solve
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from octo_arm_model import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.config.presets import preset_path
from octo_arm_model.ros.node.tension_subscription import message_class
from octo_arm_model.wire.tension_messages import TENSION_TOPICS

pytestmark = pytest.mark.slow

DEADLINE = 30.0  # [s] for anything that takes milliseconds on an idle machine
CONFIG_FILE = preset_path('renda2012_table4')
CONFIG = load_config(CONFIG_FILE)
NAMES = list(CONFIG.arm.tendon_names)
INPUTS = {topic: message_class(kind.type_name) for topic, kind in TENSION_TOPICS.items()}
OUTPUTS = {
    'backbone/path': Path,
    'backbone/poses': PoseArray,
    'strains': SectionStrains,
    'tip_pose': PoseWithCovarianceStamped,
    'tendon_lengths': JointState,
}
# Every node of this file gets a domain of its own.
DOMAINS = itertools.count(1 + os.getpid() % 80)
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def environment(domain):
    return dict(os.environ, ROS_DOMAIN_ID=str(domain), ROS_PYTHON_CHECK_FIELDS='1')


def start(module, *arguments, domain):
    return subprocess.Popen(
        [sys.executable, '-m', f'octo_arm_model.ros.{module}', *arguments],
        env=environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def start_node(domain, config=CONFIG_FILE):
    return start('node.main', '--ros-args', '--params-file', str(config), domain=domain)


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
        self.wrench = self.node.create_publisher(WrenchStamped, 'tip_wrench', 10)
        self.health = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self.health.append, 100)
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
        kind, message = TENSION_TOPICS[topic], INPUTS[topic]()
        setattr(message, kind.tensions, np.ravel(np.asarray(tensions, dtype=float)).tolist())
        if kind.names is not None:
            setattr(message, kind.names, names)
        if kind.has_stamp:
            message.header.stamp.sec = next(self.stamps)
            message.header.frame_id = 'of the load cells'
        self.publishers[topic].publish(message)
        return message.header.stamp.sec if kind.has_stamp else None

    def ask(self, topic, tensions):
        """Publish and wait for the answer on every topic, in the order of OUTPUTS."""
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
    path, poses, strains, tip, lengths = answers
    solver = CONFIG.solver(compiled=None)
    expected = solver.solve(tensions)
    assert tip.pose.pose == poses.poses[-1]
    assert lengths.name == NAMES
    np.testing.assert_array_equal(lengths.position, solver.tendon_lengths(expected).ravel())
    np.testing.assert_array_equal(lengths.effort, np.ravel(tensions))
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
    answers = client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    stamp = answers[0].header.stamp
    assert before - 1.0 <= stamp.sec + stamp.nanosec * 1e-9 <= time.time() + 1.0
    assert all(answer.header.stamp == stamp for answer in answers)


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
    [(t, c) for t in INPUTS for c in BAD if TENSION_TOPICS[t].names or 'name' not in c],
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


def test_parameters_are_described_with_their_unit_and_range(client):
    service = client.node.create_client(DescribeParameters, 'octo_arm/describe_parameters')
    client.wait(service.service_is_ready, 'the parameter service')
    names = [parameter.name for parameter in PARAMETERS]
    answer = service.call_async(DescribeParameters.Request(names=names))
    client.wait(answer.done, 'the description of the parameters')
    for parameter, descriptor in zip(PARAMETERS, answer.result().descriptors):
        assert descriptor.name == parameter.name
        assert descriptor.description == parameter.description
        assert descriptor.additional_constraints == parameter.range
        assert not descriptor.read_only


def test_a_wrench_is_refused_by_a_model_without_loads(client):
    message = WrenchStamped()
    message.wrench.force.z = 0.1
    for _ in range(3):
        client.wrench.publish(message)
        assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


def call(client, kind, name, request):
    service = client.node.create_client(kind, name)
    client.wait(service.service_is_ready, f'the service {name}')
    answer = service.call_async(request)
    client.wait(answer.done, f'an answer of {name}')
    return answer.result()


def change(client, **values):
    """Set parameters of the node together; returns whether it took them, and why not."""
    parameters = [
        Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
    request = SetParametersAtomically.Request(parameters=parameters)
    answer = call(client, SetParametersAtomically, 'octo_arm/set_parameters_atomically', request)
    return answer.result.successful, answer.result.reason


def test_parameters_change_the_arm_between_two_messages(client):
    try:
        assert change(client, stations=31, model='closed_form') == (True, '')
        path, _, strains, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
        assert (len(path.poses), strains.model) == (31, 'closed_form')
        assert change(client, material__youngs_modulus=2.2e5)[0]
        stiffer = client.ask('tendon_tensions', FETCHING_IN_PLANE)[2]
        assert np.abs(stiffer.q).max() < 0.6 * np.abs(strains.q).max()
    finally:
        restored = change(client, stations=101, model='renda2012', material__youngs_modulus=1.1e5)
    assert restored == (True, '')
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'stations': 3}, 'stations is 3, expected at least 4'),
        ({'model': 'octopus'}, "model is 'octopus', expected one of renda2012"),
        ({'body__length': 0.2}, 'sections[1].anchorage is 0.45, expected at most the length'),
        ({'sections__anchorage': [0.45, 0.315]}, 'sections.offset_base has 3 values, expected 2'),
        ({'loads__gravity': [0.0, 0.0, -9.81]}, "model is 'renda2012', which has no loads"),
        ({'stations': 51, 'body__length': -1.0}, 'body.length is -1.0, expected a finite number'),
        ({'stations': 10**12}, 'stations is 1000000000000, expected at most 10000'),
        (
            {'body__radius_tip': 1e-12, 'sections__offset_anchorage': [0.0, 0.0035, 0.006]},
            'this arm takes more than 20000 intervals of integration',
        ),
        ({'body__length': 1e9}, 'this arm takes more than 20000 intervals of integration'),
        ({'sections__tendons': [10**12, 4, 4]}, 'number of tendons is 1000000000008, expected'),
        ({'base_frame': 'x' * 256}, 'expected string of at most 255 characters'),
    ],
)
def test_a_change_that_makes_no_arm_is_refused_as_a_whole(client, values, reason):
    is_taken, why = change(client, **values)
    assert not is_taken
    assert reason in why
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


@pytest.mark.parametrize('data', [b'', b'\x00\x01', bytes(range(80)), b'\xff' * 200])
def test_bytes_that_are_no_message_are_refused(client, data):
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    client.forget()
    client.publishers['tendon_tensions'].publish(data)
    client.ask('tendon_tensions/array', FETCHING_IN_SPACE)
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    assert {name: len(got) for name, got in client.answers.items()} == dict.fromkeys(OUTPUTS, 2)


def test_whoever_comes_late_hears_what_the_arm_is(client, tmp_path):
    heard = []
    qos = QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )
    client.node.create_subscription(String, 'arm_description', heard.append, qos)
    client.wait(lambda: heard, 'the description of the arm')
    path = tmp_path / 'heard.yaml'
    path.write_text(heard[-1].data)
    assert load_config(path).arm == CONFIG.arm


def test_the_arm_is_drawn_for_whoever_looks(client):
    drawn = []
    looking = client.node.create_subscription(MarkerArray, 'markers', drawn.append, 10)

    def seen():
        client.ask('tendon_tensions', FETCHING_IN_PLANE)
        return drawn and len(drawn[-1].markers) > 1

    client.wait(seen, 'a drawing')
    client.node.destroy_subscription(looking)
    kinds = {marker.ns for marker in drawn[-1].markers}
    assert kinds == {'body', 'anchorages', 'tendons'}
    assert {marker.header.frame_id for marker in drawn[-1].markers} == {'arm_base'}


def statuses(client, name):
    """Newest diagnosis of one part of the node."""
    seen = len(client.health)
    client.wait(lambda: len(client.health) > seen + 1, 'a diagnosis')
    (status,) = [s for s in client.health[-1].status if s.name == f'octo_arm: {name}']
    return status, {value.key: value.value for value in status.values}


def test_a_burst_is_answered_with_its_newest_and_the_rest_is_counted(client):
    before = statuses(client, 'output')[1]
    client.forget()
    burst = 60
    stamps = [client.send('tendon_tensions', FETCHING_IN_PLANE) for _ in range(burst)]

    def newest_is_answered():
        got = client.answers['backbone/path']
        return got and got[-1].header.stamp.sec == stamps[-1]

    client.wait(newest_is_answered, 'an answer to the newest')
    after = statuses(client, 'output')[1]
    counted = sum(int(after[key]) - int(before[key]) for key in ('answered', 'skipped'))
    assert counted == burst


def test_stamps_that_run_backwards_and_two_sources_are_diagnosed(client):
    client.stamps = itertools.count(1000)
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    client.stamps = itertools.count(500)
    path, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert path.header.stamp.sec == 500
    client.ask('tendon_tensions/joint_state', FETCHING_IN_PLANE)

    def told():
        words = ' '.join(s.message for m in client.health for s in m.status)
        return 'running backwards' in words and 'several sources' in words

    client.wait(told, 'the diagnosis')
    _, values = statuses(client, 'input')
    assert int(values['stamps running backwards']) >= 1
    assert float(values['age of the newest stamp [s]']) > 1e6


def test_silence_is_diagnosed_and_nobody_claims_to_solve_or_publish(client):
    def silent():
        status, _ = statuses(client, 'input')
        return 'silent for' in status.message and status.level == DiagnosticStatus.WARN

    client.wait(silent, 'a warning')
    for name in ('solver', 'output'):
        status, _ = statuses(client, name)
        assert (status.level, status.message) == (DiagnosticStatus.OK, 'waiting')


def test_old_stamps_are_diagnosed_as_soon_as_they_come(client):
    def told(message):
        client.ask('tendon_tensions', FETCHING_IN_PLANE)  # in the first hours of 1970
        return any(message in s.message for s in client.health[-1].status)

    client.wait(lambda: told('stamps older than 1 s'), 'a warning')
    assert int(statuses(client, 'input')[1]['old stamps']) >= 1
    try:
        assert change(client, diagnostics__age_limit=1e10) == (True, '')
        client.wait(lambda: told('receiving'), 'a diagnosis without a warning')
        status = next(s for s in client.health[-1].status if s.name == 'octo_arm: input')
        assert status.level == DiagnosticStatus.OK
    finally:
        assert change(client, diagnostics__age_limit=1.0) == (True, '')
    refused = (False, 'diagnostics.age_limit is -1.0, expected a finite time >= 0 [s]')
    assert change(client, diagnostics__age_limit=-1.0) == refused


def test_two_publishers_on_one_topic_are_diagnosed(client):
    def told():
        client.ask('tendon_tensions', FETCHING_IN_PLANE)
        return [
            s.message
            for s in client.health[-1].status
            if '2 publishers on /tendon_tensions' in s.message
        ]

    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert 'publishers on' not in statuses(client, 'input')[0].message
    second = client.node.create_publisher(TendonTensions, 'tendon_tensions', 10)
    try:
        client.wait(told, 'a warning')
    finally:
        client.node.destroy_publisher(second)


def test_what_is_said_of_a_refusal_is_short_whatever_was_sent(client):
    client.health.clear()
    names = ['x' * 500_000, *NAMES[1:]]

    def told():
        client.send('tendon_tensions', FETCHING_IN_PLANE, names)
        client.executor.spin_once(timeout_sec=0.1)
        return any('unknown tendon x' in s.message for m in client.health for s in m.status)

    client.wait(told, 'a warning')
    client.wait(lambda: any('unknown tendon x' in log.msg for log in client.logs), 'a log line')
    said = [s.message for m in client.health for s in m.status]
    said += [value.value for m in client.health for s in m.status for value in s.values]
    said += [log.msg for log in client.logs]
    assert max(map(len, said)) < 1000


def test_frames_lead_from_the_base_to_the_tip():
    domain = next(DOMAINS)
    process = start(
        'node.main', '--ros-args', '--params-file', str(CONFIG_FILE),
        '-p', 'base.position:=[0.1, -0.2, 0.3]', '-p', 'base_frame:=robot',
        '-p', 'frame_prefix:=left_', domain=domain,
    )  # fmt: skip
    client = Client(domain)
    heard = []
    client.node.create_subscription(TFMessage, '/tf', heard.append, 100)
    try:
        client.connect()
        client.wait(lambda: heard, 'frames')
        tip = client.ask('tendon_tensions', FETCHING_IN_SPACE)[3]
        client.wait(
            lambda: heard[-1].transforms[0].header.stamp == tip.header.stamp, 'the frames of it'
        )
    finally:
        client.close()
        stop(process)
    parents = {frame.child_frame_id: frame for frame in heard[-1].transforms}
    names = {'left_tip', *(f'left_anchorage_{number}' for number in (1, 2, 3))}
    assert set(parents) == names
    # Somewhere in a room: a frame above that of the base, half a turn about z and a step aside.
    room = TransformStamped()
    room.header.frame_id, room.child_frame_id = 'room', 'robot'
    room.transform.translation.x, room.transform.rotation.z = 2.0, 1.0
    room.transform.rotation.w = 0.0
    parents['robot'] = room
    found = look_up(parents, 'left_tip', 'room')
    place, turn = tip.pose.pose.position, tip.pose.pose.orientation
    expected = np.eye(4)
    expected[:3, :3] = np.diag([-1.0, -1.0, 1.0]) @ rotation([turn.x, turn.y, turn.z, turn.w])
    expected[:3, 3] = [2.0 - place.x, -place.y, place.z]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    base = CONFIG.solver().solve(FETCHING_IN_SPACE)
    in_base = look_up(parents, 'left_tip', 'robot')
    np.testing.assert_allclose(in_base[:3, 3], base.tip + [0.1, -0.2, 0.3], atol=1e-9)


def look_up(parents, frame, target):
    """Matrix (4, 4) from coordinates in ``frame`` to those in ``target``, which is above it."""
    whole = np.eye(4)
    while frame != target:
        step = parents[frame]
        move, turn = step.transform.translation, step.transform.rotation
        matrix = np.eye(4)
        matrix[:3, :3] = rotation([turn.x, turn.y, turn.z, turn.w])
        matrix[:3, 3] = [move.x, move.y, move.z]
        whole = matrix @ whole
        frame = step.header.frame_id
    return whole


def rotation(quaternion):
    """Matrix (3, 3) of a quaternion x, y, z, w."""
    x, y, z, w = quaternion
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew


@pytest.fixture
def drawn(client):
    """Stamps of the markers that come [s]; None for what clears the screen."""
    stamps = []

    def look(message):
        first = message.markers[0]
        stamps.append(first.header.stamp.sec if first.action == first.ADD else None)

    looking = client.node.create_subscription(MarkerArray, 'markers', look, 100)
    yield stamps
    client.node.destroy_subscription(looking)
    assert change(client, markers_rate=30.0) == (True, '')


def ask_until_drawn(client, drawn):
    """Whether somebody has drawn what was asked just now."""
    stamp = client.ask('tendon_tensions', FETCHING_IN_PLANE)[0].header.stamp.sec
    client.executor.spin_once(timeout_sec=0.05)
    return stamp in drawn


def test_markers_come_at_their_rate_and_the_last_shape_is_always_drawn(client, drawn):
    assert change(client, markers_rate=0.0) == (True, '')
    client.wait(lambda: ask_until_drawn(client, drawn), 'a drawing')
    assert change(client, markers_rate=0.5) == (True, '')
    drawn.clear()
    stamps = [
        client.ask('tendon_tensions', FETCHING_IN_PLANE)[0].header.stamp.sec for _ in range(20)
    ]
    client.wait(lambda: stamps[-1] in drawn, 'a drawing of the last shape')
    assert drawn[:2] == [None, stamps[0]]  # another arm may have been there before
    assert len(drawn) < 20


def test_every_shape_is_drawn_if_that_is_wanted(client, drawn):
    assert change(client, markers_rate=0.0) == (True, '')
    client.wait(lambda: ask_until_drawn(client, drawn), 'a drawing')
    stamps = [
        client.ask('tendon_tensions', FETCHING_IN_PLANE)[0].header.stamp.sec for _ in range(5)
    ]
    client.wait(lambda: set(stamps) <= set(drawn), 'drawings of all')


# The model exact, with loads, in a node of its own ----------------------------------------------

LOADED = """\
/**:
  ros__parameters:
    model: exact
    material: {youngs_modulus: 110000.0, density: 1080.0, youngs_modulus_stddev: 0.05}
    body: {length: 0.27, radius_base: 0.015, radius_tip: 0.0074}
    sections: {anchorage: [0.27], offset_base: [0.005], offset_anchorage: [0.0025]}
    loads: {gravity: [0.0, 0.0, -9.81], fluid_density: 1000.0}
    tension_stddev: 0.02
"""
PULL = np.array([[1.0, 0.3, 0.0, 0.0]])


@pytest.fixture(scope='module')
def loaded(tmp_path_factory):
    path = tmp_path_factory.mktemp('loaded') / 'arm.yaml'
    path.write_text(LOADED)
    domain = next(DOMAINS)
    process = start_node(domain, path)
    client = Client(domain)
    client.config = load_config(path)
    client.names = list(client.config.arm.tendon_names)

    def asked():
        client.send('tendon_tensions', PULL, client.names)
        client.executor.spin_once(timeout_sec=0.1)
        return all(client.answers.values())

    try:
        client.wait(asked, 'an answer')
        yield client
        assert process.poll() is None, 'the node died'
    finally:
        client.close()
        stop(process)


def ask_loaded(client, tensions=PULL):
    stamp = client.send('tendon_tensions', tensions, client.names)

    def answered():
        return all(got and got[-1].header.stamp.sec == stamp for got in client.answers.values())

    client.wait(answered, 'an answer')
    return [client.answers[name][-1] for name in OUTPUTS]


def tip_of(answers):
    place = answers[3].pose.pose.position
    return [place.x, place.y, place.z]


def wrench_of(client, z, frame='arm_base'):
    message = WrenchStamped()
    message.header.frame_id = frame
    message.wrench.force.z = z
    client.wrench.publish(message)
    return message


def test_loads_and_uncertainty_are_those_of_the_core(loaded):
    solver = loaded.config.solver()
    expected = solver.solve(PULL)
    answers = ask_loaded(loaded)
    np.testing.assert_allclose(tip_of(answers), expected.tip, atol=1e-9)
    covariance = np.reshape(answers[3].pose.covariance, (6, 6))
    ours = solver.tip_covariance(expected, loaded.config.uncertainty)
    np.testing.assert_allclose(covariance, ours, rtol=1e-5, atol=1e-9 * ours.max())
    assert (np.diag(covariance)[:3] > 0.0).all()


def test_a_wrench_on_the_tip_acts_on_the_tensions_that_follow(loaded):
    expected = loaded.config.solver().solve(PULL, [0, 0, 0.03, 0, 0, 0]).tip

    def is_felt():
        wrench_of(loaded, 0.03)
        return np.allclose(tip_of(ask_loaded(loaded)), expected, atol=1e-8)

    loaded.wait(is_felt, 'the wrench')

    def is_gone():
        wrench_of(loaded, 0.0)
        return np.allclose(
            tip_of(ask_loaded(loaded)), loaded.config.solver().solve(PULL).tip, atol=1e-8
        )

    loaded.wait(is_gone, 'its end')


@pytest.mark.parametrize(('force', 'frame'), [(np.nan, 'arm_base'), (0.1, 'somewhere')])
def test_a_bad_wrench_is_ignored(loaded, force, frame):
    expected = tip_of(ask_loaded(loaded))
    wrench_of(loaded, force, frame)
    loaded.wait(
        lambda: any('tip_wrench' in log.msg for log in loaded.logs) or ask_loaded(loaded) is None,
        'a warning',
    )
    np.testing.assert_allclose(tip_of(ask_loaded(loaded)), expected, atol=1e-9)


def test_what_has_no_answer_is_not_published_and_diagnostics_say_why(loaded):
    def reasons():
        return [
            status.message
            for message in loaded.health
            for status in message.status
            if 'compress' in status.message or 'converge' in status.message
        ]

    def asked():
        loaded.send('tendon_tensions', PULL * 1e5, loaded.names)
        loaded.executor.spin_once(timeout_sec=0.1)
        return reasons()

    loaded.wait(asked, 'a diagnosis')
    loaded.forget()
    answers = ask_loaded(loaded)
    np.testing.assert_allclose(tip_of(answers), loaded.config.solver().solve(PULL).tip, atol=1e-8)


def test_the_service_solve_answers_like_the_core_and_explains_refusals(loaded):
    request = Solve.Request()
    request.tensions.name = loaded.names
    request.tensions.tension = [0.5, 0.0, 0.0, 0.2]
    request.tip_wrench.force.y = 0.01
    answer = call(loaded, Solve, 'solve', request)
    solver = loaded.config.solver()
    expected = solver.solve([[0.5, 0.0, 0.0, 0.2]], [0, 0.01, 0, 0, 0, 0])
    assert answer.success, answer.message
    np.testing.assert_array_equal(answer.strains.k, expected.k)
    np.testing.assert_array_equal(answer.tendon_length, solver.tendon_lengths(expected).ravel())
    assert len(answer.path.poses) == 101
    assert answer.residual < 1e-10
    request.tensions.tension = [0.5, 0.0, -1.0, 0.2]
    refused = call(loaded, Solve, 'solve', request)
    assert not refused.success
    assert 'tension of tendon_1_3 is -1.0 N' in refused.message


def test_the_service_find_tensions_reaches_what_can_be_reached(loaded):
    solver = loaded.config.solver()
    request = FindTensions.Request(target=FindTensions.Request.TIP_POSITION)
    wanted = solver.solve(PULL).tip
    place = request.tip.position
    place.x, place.y, place.z = wanted.tolist()
    answer = call(loaded, FindTensions, 'find_tensions', request)
    assert answer.success, answer.message
    assert answer.reached
    found = solver.solve(np.reshape(answer.tensions.tension, (1, 4)))
    np.testing.assert_allclose(found.tip, wanted, atol=1e-6)
    place.x = 9.0
    far = call(loaded, FindTensions, 'find_tensions', request)
    assert far.success
    assert not far.reached
    assert far.error > 8.0
    request.highest = [1.0, 2.0]
    refused = call(loaded, FindTensions, 'find_tensions', request)
    assert not refused.success
    assert 'highest has 2 values' in refused.message


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


def test_a_middleware_that_does_not_let_go_does_not_keep_the_node():
    # Waits in C, as Fast DDS does, where Python's threads and signal handlers get no turn.
    program = """
import ctypes, os, signal
from rclpy.node import Node
from octo_arm_model.ros.node import main as node
class Stuck(Node):
    def __init__(self):
        super().__init__('stuck')
        os.kill(os.getpid(), signal.SIGTERM)
    def destroy_node(self):
        ctypes.PyDLL(None).sleep(1000)
node.LONGEST_END = 0.2
node.run('stuck', Stuck)
"""
    environment = dict(os.environ, ROS_DOMAIN_ID=str(next(DOMAINS)))
    done = subprocess.run(
        [sys.executable, '-c', program],
        env=environment, capture_output=True, text=True, timeout=DEADLINE, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert 'in destroy_node' in done.stderr


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', 'length: 1', 'body.length is an integer, expected double'),
        ('length: 0.45', 'length: -1.0', 'body.length is -1.0, expected a finite number > 0 [m]'),
        ('length: 0.45', 'girth: 0.45', 'body.girth is no parameter of the arm'),
        ('length: 0.45', '', 'body.length is missing'),
        ('length: 0.45', 'length: [0.45', 'parse'),
        ('0.45, 0.315', '1, 0.315', 'a list of doubles needs 1.0, not 1'),
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


@pytest.mark.parametrize(
    'arguments',
    [('--params-file', 'nowhere.yaml'), ('-p', 'half'), ('--params-file', '/')],
)
def test_what_ros_cannot_read_is_told_without_a_wrong_hint(arguments, tmp_path):
    process = start('node.main', '--ros-args', *arguments, domain=next(DOMAINS))
    _, complaints = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert arguments[-1] in complaints
    assert '1.0, not 1' not in complaints
    assert ('seen from' in complaints) == (arguments[-1] == 'nowhere.yaml')


def test_a_refusal_names_the_topics_as_they_are_remapped(monkeypatch):
    domain = next(DOMAINS)
    process = start(
        'node.main', '--ros-args', '--params-file', str(CONFIG_FILE),
        '-r', 'tendon_tensions:=winch/tension', '-r', 'tip_wrench:=/hand/wrench', domain=domain,
    )  # fmt: skip
    client = Client(domain)
    winch = client.node.create_publisher(TendonTensions, 'winch/tension', 10)
    hand = client.node.create_publisher(WrenchStamped, '/hand/wrench', 10)
    pulling = WrenchStamped()
    pulling.wrench.force.x = 1.0

    def told(*beginnings):
        winch.publish(TendonTensions())
        hand.publish(pulling)
        said = [log.msg for log in client.logs]
        return all(any(line.startswith(words) for line in said) for words in beginnings)

    client.wait(lambda: told('/winch/tension refused', '/hand/wrench refused'), 'a refusal')
    _, values = statuses(client, 'input')
    assert '/winch/tension' in values['last refusal'] or '/hand/wrench' in values['last refusal']
    client.close()
    stop(process)


def test_under_simulated_time_everything_is_on_that_clock_even_when_it_jumps_back():
    domain = next(DOMAINS)
    process = start(
        'node.main', '--ros-args', '--params-file', str(CONFIG_FILE), '-p', 'use_sim_time:=true',
        domain=domain,
    )  # fmt: skip
    client = Client(domain)
    clock = client.node.create_publisher(Clock, '/clock', 10)

    def stamped_with(second):
        message = Clock()
        message.clock.sec = second
        clock.publish(message)
        client.send('tendon_tensions/array', FETCHING_IN_PLANE)
        client.executor.spin_once(timeout_sec=0.05)
        got = client.answers['backbone/path']
        return bool(got) and got[-1].header.stamp.sec == second

    try:
        # A bag that begins anew plays an earlier clock.
        for second in (5000, 5001, 4000):
            client.wait(lambda second=second: stamped_with(second), f'an answer at {second} s')
        client.health.clear()
        client.wait(lambda: client.health, 'a diagnosis, though simulated time stands still')
        assert client.health[-1].header.stamp.sec == 4000
        client.stamps = itertools.count(3999)
        path, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
        assert path.header.stamp.sec == 3999
    finally:
        client.close()
        status, complaints = stop(process)
    assert status == 0, complaints


@pytest.mark.parametrize(('step', 'is_ahead'), [(0.08, False), (0.01, True)])
def test_a_coarse_clock_is_not_mistaken_for_stamps_from_the_future(step, is_ahead):
    domain = next(DOMAINS)
    process = start(
        'node.main', '--ros-args', '--params-file', str(CONFIG_FILE), '-p', 'use_sim_time:=true',
        domain=domain,
    )  # fmt: skip
    client = Client(domain)
    clock = client.node.create_publisher(Clock, '/clock', 10)

    def is_time(nanoseconds):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(nanoseconds, 10**9)
        clock.publish(message)
        client.executor.spin_once(timeout_sec=0.1)
        return client.health and client.health[-1].header.stamp == message.clock

    try:
        client.connect()
        assert 'nothing is heard on /clock' in statuses(client, 'input')[0].message
        now = 5000 * 10**9
        for _ in range(3):
            now += int(1e9 * step)
            client.wait(lambda: is_time(now), 'that time')
        stamped = TendonTensions(name=NAMES, tension=np.zeros(12))
        before = int(statuses(client, 'input')[1]['stamps from the future'])
        # The next of the clock is under way; this one has overtaken it and the one before.
        ahead = now + int(1e9 * 0.15)
        stamped.header.stamp.sec, stamped.header.stamp.nanosec = divmod(ahead, 10**9)
        client.forget()
        client.publishers['tendon_tensions'].publish(stamped)
        client.wait(lambda: client.answers['backbone/path'], 'an answer')
        after = int(statuses(client, 'input')[1]['stamps from the future'])
        assert after - before == int(is_ahead)
    finally:
        client.close()
        stop(process)


# The managed node -------------------------------------------------------------------------------


def transition(client, number):
    request = ChangeState.Request()
    request.transition.id = number
    return call(client, ChangeState, 'octo_arm/change_state', request).success


@pytest.fixture
def managed():
    domain = next(DOMAINS)
    process = start(
        'node.lifecycle', '--ros-args', '--params-file', str(CONFIG_FILE), domain=domain
    )
    client = Client(domain)
    try:
        yield client
        assert process.poll() is None, 'the node died'
    finally:
        client.close()
        stop(process)


def test_a_managed_node_answers_while_it_is_active(managed):
    assert transition(managed, Transition.TRANSITION_CONFIGURE)
    managed.wait(lambda: managed.node.count_publishers('backbone/path') == 1, 'a configured node')
    assert managed.node.count_subscribers('tendon_tensions') == 0
    for _ in range(2):
        assert transition(managed, Transition.TRANSITION_ACTIVATE)
        managed.connect()
        assert_is_backbone(managed.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
        assert transition(managed, Transition.TRANSITION_DEACTIVATE)
        managed.wait(
            lambda: managed.node.count_subscribers('tendon_tensions') == 0, 'an inactive node'
        )
    assert transition(managed, Transition.TRANSITION_CLEANUP)
    managed.wait(
        lambda: managed.node.count_publishers('backbone/path') == 0, 'a node without publishers'
    )


def test_a_managed_node_that_does_not_answer_says_so(managed):
    def says(words, level=DiagnosticStatus.WARN):
        parts = managed.health[-1].status if managed.health else []
        return len(parts) == 3 and all((p.message, p.level) == (words, level) for p in parts)

    managed.wait(lambda: says('unconfigured'), 'the diagnosis of an unconfigured node')
    assert transition(managed, Transition.TRANSITION_CONFIGURE)
    managed.wait(lambda: says('inactive'), 'the diagnosis of an inactive node')
    assert transition(managed, Transition.TRANSITION_ACTIVATE)
    managed.wait(lambda: says('waiting', DiagnosticStatus.OK), 'the diagnosis of an active node')
    assert transition(managed, Transition.TRANSITION_DEACTIVATE)
    managed.wait(lambda: says('inactive'), 'the diagnosis of an inactive node')
    assert transition(managed, Transition.TRANSITION_CLEANUP)
    managed.wait(lambda: says('unconfigured'), 'the diagnosis of an unconfigured node')


def test_a_managed_node_that_cannot_be_configured_says_why_and_stays(tmp_path):
    config = tmp_path / 'bad.yaml'
    config.write_text(CONFIG_FILE.read_text().replace('length: 0.45', 'length: 0.1'))
    domain = next(DOMAINS)
    process = start('node.lifecycle', '--ros-args', '--params-file', str(config), domain=domain)
    client = Client(domain)
    try:
        assert not transition(client, Transition.TRANSITION_CONFIGURE)
        assert change(client, body__length=0.45) == (True, '')
        assert transition(client, Transition.TRANSITION_CONFIGURE)
    finally:
        client.close()
        status, complaints = stop(process)
    assert status == 0, complaints
    assert 'not configured: sections[1].anchorage is 0.45' in complaints
