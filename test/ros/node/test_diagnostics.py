"""What the node says of its inputs, and the clock that stamps are compared with."""

import itertools

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live_nodes import AFFORDED, NAMES, hosting
from octo_arm_msgs.msg import TendonTensions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node.main import OctoArmNode


def test_stamps_that_run_backwards_and_two_sources_are_diagnosed(client):
    client.stamps = itertools.count(1000)
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    client.stamps = itertools.count(500)
    path, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert path.header.stamp.sec == 500

    def told():
        for topic in ('tendon_tensions', 'tendon_tensions/joint_state'):
            client.ask(topic, FETCHING_IN_PLANE)
        words = ' '.join(s.message for m in client.diagnostics for s in m.status)
        return 'running backwards' in words and 'several sources' in words

    client.wait(told, 'the diagnosis')
    _, values = client.status('input')
    assert int(values['stamps running backwards']) >= 1
    assert float(values['age of the newest stamp [s]']) > 1e6


# Of the inputs where a test waits for it, shorter than the node's own.
SILENCE = 0.5  # [s]


def test_silence_is_diagnosed_and_nobody_claims_to_solve_or_publish(client):
    usual = client.dump()['diagnostics.silence_limit']
    assert client.change(diagnostics__silence_limit=SILENCE) == (True, '')

    def silent():
        status, _ = client.status('input')
        return 'silent for' in status.message and status.level == DiagnosticStatus.WARN

    client.wait(silent, 'a warning')
    for name in ('solver', 'output'):
        status, _ = client.status(name)
        assert (status.level, status.message) == (DiagnosticStatus.OK, 'waiting')
    assert client.change(diagnostics__silence_limit=usual) == (True, '')


def test_winches_and_force_sensors_that_die_are_named():
    options = (*AFFORDED, '-p', 'model:=exact', '-p', f'diagnostics.silence_limit:={SILENCE}')
    with hosting(OctoArmNode, *options, node='wound') as client:
        winches = client.node.create_publisher(JointState, 'tendon_displacements', 10)
        client.connect()
        client.wait(winches.get_subscription_count, 'a subscription to displacements')

        def silent():
            """Those that the next diagnosis calls silent, while tensions go on."""
            client.diagnostics.clear()
            while not client.diagnostics:
                client.send('tendon_tensions', np.zeros(12))
                client.spin(0.1)
            said = ' '.join(s.message for s in client.diagnostics[-1].status)
            return [
                topic
                for topic in ('tendon_displacements', 'tip_wrench')
                if f'/{topic} is silent for' in said
            ]

        winches.publish(JointState(name=['tendon_1_1'], position=[0.01]))
        client.send_wrench(0.001)
        client.wait(lambda: len(silent()) == 2, 'a warning that names both')
        # What has no effect any more may be silent.
        client.send_wrench(0.0)
        winches.publish(JointState())
        client.wait(lambda: not silent(), 'an end of the warning')


def test_old_stamps_are_diagnosed_as_soon_as_they_come(client):
    def told(message):
        client.ask('tendon_tensions', FETCHING_IN_PLANE)  # in the first hours of 1970
        return any(message in s.message for s in client.diagnostics[-1].status)

    client.wait(lambda: told('stamps older than 1 s'), 'a warning')
    assert int(client.status('input')[1]['old stamps']) >= 1
    try:
        assert client.change(diagnostics__age_limit=1e10) == (True, '')
        client.wait(lambda: told('receiving'), 'a diagnosis without a warning')
        status = next(s for s in client.diagnostics[-1].status if s.name == 'octo_arm: input')
        assert status.level == DiagnosticStatus.OK
    finally:
        assert client.change(diagnostics__age_limit=1.0) == (True, '')
    refused = (False, 'diagnostics.age_limit is -1.0, expected a finite time >= 0 [s]')
    assert client.change(diagnostics__age_limit=-1.0) == refused


@pytest.mark.parametrize(
    ('kind', 'topic'), [(TendonTensions, 'tendon_tensions'), (JointState, 'tendon_displacements')]
)
def test_two_publishers_on_one_topic_are_diagnosed(client, kind, topic):
    def told():
        more[0].publish(messages[kind])
        client.ask('tendon_tensions', FETCHING_IN_PLANE)
        said = [status.message for status in client.diagnostics[-1].status]
        return any(f'2 publishers on /{topic}' in message for message in said)

    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert 'publishers on' not in client.status('input')[0].message
    messages = {
        TendonTensions: TendonTensions(name=NAMES, tension=np.zeros(12)),
        JointState: JointState(),  # drives no tendon
    }
    # One of tensions is there already.
    count = 1 if topic == 'tendon_tensions' else 2
    more = [client.node.create_publisher(kind, topic, 10) for _ in range(count)]
    try:
        client.wait(told, 'a warning')
    finally:
        for one in more:
            client.node.destroy_publisher(one)


@pytest.mark.parametrize(('step', 'is_ahead'), [(0.08, False), (0.01, True)])
def test_a_coarse_clock_is_not_mistaken_for_stamps_from_the_future(step, is_ahead):
    with hosting(OctoArmNode, '-p', 'use_sim_time:=true') as client:
        clock = client.node.create_publisher(Clock, '/clock', 10)

        def is_time(nanoseconds):
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(nanoseconds, 10**9)
            clock.publish(message)
            client.spin(0.1)
            return client.diagnostics and client.diagnostics[-1].header.stamp == message.clock

        client.connect()
        assert 'nothing is heard on /clock' in client.status('input')[0].message
        now = 5000 * 10**9
        for _ in range(3):
            now += int(1e9 * step)
            client.wait(lambda: is_time(now), 'that time')
        stamped = TendonTensions(name=NAMES, tension=np.zeros(12))
        before = int(client.status('input')[1]['stamps from the future'])
        # The next of the clock is under way; this one has overtaken it and the one before.
        ahead = now + int(1e9 * 0.15)
        stamped.header.stamp.sec, stamped.header.stamp.nanosec = divmod(ahead, 10**9)
        client.forget()
        client.publishers['tendon_tensions'].publish(stamped)
        client.wait(lambda: client.answers['backbone/path'], 'an answer')
        after = int(client.status('input')[1]['stamps from the future'])
        assert after - before == int(is_ahead)
