"""Tensions and wrenches answered with the backbone of the core, over DDS."""

import itertools
import time

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import WrenchStamped
from live_nodes import INPUTS, NAMES, OUTPUTS, RELIABLE, assert_is_backbone, hosting, running
from octo_arm_msgs.msg import TendonTensions
from rosgraph_msgs.msg import Clock

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.ros.node.main import OctoArmNode
from octo_arm_model.wire.tensions import TENSION_TOPICS


@pytest.fixture(scope='module')
def client():
    """Client of a node that is a process of its own."""
    with running('ros.node.main', *RELIABLE) as client:
        client.connect()
        yield client


@pytest.mark.parametrize('topic', INPUTS)
def test_every_input_is_answered_with_the_backbone_of_its_tensions(client, topic):
    for given in (FETCHING_IN_PLANE, FETCHING_IN_SPACE, np.zeros((3, 4))):
        tensions = np.float64(np.float32(given))  # which every type can hold
        assert_is_backbone(client.ask(topic, tensions), tensions)


def test_input_without_a_stamp_gets_the_time_of_receipt(client):
    before = time.time()
    answers = client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    stamp = answers[0].header.stamp
    assert before - 1.0 <= stamp.sec + stamp.nanosec * 1e-9 <= time.time() + 1.0
    assert all(answer.header.stamp == stamp for answer in answers)


@pytest.mark.parametrize('stamp', [(-5, 0), (1, 4 * 10**9)])
def test_a_stamp_that_is_no_time_is_not_passed_on(client, stamp):
    message = TendonTensions(name=list(NAMES), tension=np.ravel(FETCHING_IN_SPACE))
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    client.forget()
    client.publishers['tendon_tensions'].publish(message)
    client.ask('tendon_tensions/array', FETCHING_IN_SPACE)
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    assert {name: len(got) for name, got in client.answers.items()} == dict.fromkeys(OUTPUTS, 2)


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
    seen = len(client.logs)

    def refusals():
        return [log.msg for log in client.logs[seen:] if 'refused' in log.msg]

    def is_told():  # the throttle of an earlier test may still hold
        client.send('tendon_tensions', tensions_with(-0.5))
        client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
        return refusals()

    client.wait(is_told, 'a refusal in the log')
    assert 'tension of tendon_2_3 is -0.5 N' in refusals()[0]
    for _ in range(20):
        client.send('tendon_tensions', tensions_with(-0.5))
        client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    assert len(refusals()) < 20


def test_what_is_said_of_a_refusal_is_short_whatever_was_sent(client):
    client.diagnostics.clear()
    names = ['x' * 500_000, *NAMES[1:]]

    def told():
        client.send('tendon_tensions', FETCHING_IN_PLANE, names)
        client.spin(0.1)
        words = 'unknown tendon x'  # the log may be throttled since the test before
        return any(words in s.message for m in client.diagnostics for s in m.status) and any(
            words in log.msg for log in client.logs
        )

    client.wait(told, 'a warning and a log line')
    said = [s.message for m in client.diagnostics for s in m.status]
    said += [value.value for m in client.diagnostics for s in m.status for value in s.values]
    said += [log.msg for log in client.logs]
    assert max(map(len, said)) < 1000


def test_a_refusal_names_the_topics_as_they_are_remapped():
    remapped = ('-r', 'tendon_tensions:=winch/tension', '-r', 'tip_wrench:=/hand/wrench')
    with hosting(OctoArmNode, *remapped) as client:
        winch = client.node.create_publisher(TendonTensions, 'winch/tension', 10)
        hand = client.node.create_publisher(WrenchStamped, '/hand/wrench', 10)
        pulling = WrenchStamped()
        pulling.wrench.force.x = 1.0

        def told(*beginnings):
            # What is refused often does not hide what is refused seldom.
            for _ in range(5):
                winch.publish(TendonTensions())
            hand.publish(pulling)
            said = [log.msg for log in client.logs]
            return all(any(line.startswith(words) for line in said) for words in beginnings)

        client.wait(lambda: told('/winch/tension refused', '/hand/wrench refused'), 'a refusal')
        refusal = client.status('input')[1]['last refusal']
        assert '/winch/tension' in refusal or '/hand/wrench' in refusal


def test_under_simulated_time_everything_is_on_that_clock_even_when_it_jumps_back():
    with hosting(OctoArmNode, '-p', 'use_sim_time:=true') as client:
        clock = client.node.create_publisher(Clock, '/clock', 10)
        client.connect()

        def stamped_with(second):
            message = Clock()
            message.clock.sec = second
            clock.publish(message)
            client.send('tendon_tensions/array', FETCHING_IN_PLANE)
            client.spin()
            got = client.answers['backbone/path']
            return bool(got) and got[-1].header.stamp.sec == second

        # A bag that begins anew plays an earlier clock.
        for second in (5000, 5001, 4000):
            client.wait(lambda second=second: stamped_with(second), f'an answer at {second} s')
        client.diagnostics.clear()
        client.wait(lambda: client.diagnostics, 'a diagnosis, though simulated time stands still')
        assert client.diagnostics[-1].header.stamp.sec == 4000
        client.stamps = itertools.count(3999)
        path, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
        assert path.header.stamp.sec == 3999
