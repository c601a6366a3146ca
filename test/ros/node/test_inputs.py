"""Other inputs of the node than tensions as the arm names them, and what is said of inputs."""

import itertools
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live_nodes import AFFORDED, CONFIG, NAMES, hosting, tip_of, xyz
from numpy.testing import assert_allclose
from octo_arm_msgs.msg import TendonTensions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan

from octo_arm_model import Config, displacements_of, solve_displacements, wound_sensitivity
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.ros.node.main import OctoArmNode

PLANE = np.array(FETCHING_IN_PLANE)
EXPECTED = CONFIG.solver().solve(PLANE)
CELLS = [f'LC {number}' for number in range(12)]


def scan():
    """Readings of more cells than the arm has, without names, in single precision."""
    message = LaserScan(ranges=[99.0, *PLANE.ravel().tolist(), 99.0])
    message.header.stamp.sec = 77
    return message


def joints(*more):
    """Readings by name, not where a JointState has forces."""
    message = JointState(name=CELLS[::-1], velocity=[*PLANE.ravel()[::-1].tolist(), *more])
    message.header.stamp.sec = 78
    return message


def wait_for_answer(client, publisher, message, expected=EXPECTED.tip, atol=1e-9):
    """Publish until it is answered with its stamp and the ``expected`` tip, that of `PLANE`."""
    poses = client.answers['backbone/poses']

    def answered():
        return (
            poses
            and poses[-1].header.stamp == message.header.stamp
            and np.allclose(xyz(poses[-1].poses[-1].position), expected, atol=atol)
        )

    client.wait(answered, 'an answer', partial(publisher.publish, message))


def test_any_field_of_any_type_is_taken_and_may_change_while_the_node_runs():
    given = {
        'tension_type': 'sensor_msgs/msg/LaserScan',
        'tension_field': 'ranges',
        'tension_names': [str(number) for number in range(1, 13)],
    }
    remap = '-r', 'tendon_tensions/field:=/daq'
    with hosting(OctoArmNode, *remap, node='daq', **given) as client:
        scans = client.node.create_publisher(LaserScan, '/daq', 10)
        wait_for_answer(client, scans, scan())
        client.node.destroy_publisher(scans)
        other = {'tension_type': 'sensor_msgs/msg/JointState', 'tension_field': 'velocity'}
        assert client.change(**other, tension_names=CELLS) == (True, '')
        states = client.node.create_publisher(JointState, '/daq', 10)
        wait_for_answer(client, states, joints())

        def is_refused(words, message):
            client.logs.clear()
            client.log('/daq refused', words, again=partial(states.publish, message))

        # Numbers there are none in such a field, and none there are without a load cell.
        is_refused('no value', JointState(velocity=[1.0]))
        is_refused('12 names but 13 values', joints(0.0))
        alone = {'tension_field': 'velocity[9]', 'tension_names': ['0', *11 * '-']}
        assert client.change(**alone) == (True, '')
        one = CONFIG.solver().solve(PLANE.ravel()[2] * np.eye(12)[0].reshape(PLANE.shape))
        wait_for_answer(client, states, joints(), one.tip)
        assert client.change(tension_field='speed') == (True, '')
        is_refused("no field 'speed'", joints())
        # Not taken for the time of the node.
        client.node.destroy_publisher(states)
        assert client.change(tension_type='rosgraph_msgs/msg/Clock') == (True, '')
        states = client.node.create_publisher(Clock, '/daq', 10)
        is_refused("no field 'speed'", Clock())
        assert client.change(tension_type='', tension_field='') == (True, '')
        client.wait(lambda: not states.get_subscription_count(), 'the end of the subscription')


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'tension_type': 'sensor_msgs/msg/LaserScan'}, 'or no value without tension_field'),
        ({'tension_type': 'no_msgs/msg/No', 'tension_field': 'a'}, "type 'no_msgs/msg/No' are"),
        ({'tension_type': 'sensor_msgs/msg/Nothing', 'tension_field': 'a'}, 'are installed'),
        ({'tension_type': 'os.path', 'tension_field': 'a'}, "no messages of type 'os.path'"),
    ],
)
def test_a_type_that_is_not_there_is_refused(client, values, reason):
    is_taken, why = client.change(**values)
    assert not is_taken
    assert reason in why


def test_readings_around_zero_are_answered_within_the_deadband_and_counted_beyond(client):
    noise = 0.004 * np.random.default_rng(0).standard_normal((3, 4))
    expected = CONFIG.solver().solve(PLANE).tip
    readings = np.where(PLANE > 0.0, PLANE, noise)
    assert (readings < 0.0).any()
    try:
        assert client.change(tension_deadband=0.02) == (True, '')
        assert_allclose(tip_of(client.ask('tendon_tensions', readings)), expected)
        client.send('tendon_tensions', readings - 0.05)
        client.wait(
            lambda: 'tension_deadband' in client.status('input')[1]['refused by reason'],
            'the refusal by its reason',
        )
        scale, offset = np.linspace(0.5, 2.0, 12), np.linspace(-0.3, 0.3, 12)
        raw = (readings.ravel() - offset) / scale
        assert client.change(tension_scale=scale.tolist(), tension_offset=offset.tolist())[0]
        answers = client.ask('tendon_tensions/array', raw.reshape(3, 4))
        assert_allclose(tip_of(answers), expected, atol=1e-9)
    finally:
        none = {'tension_scale': [], 'tension_offset': []}
        assert client.change(tension_deadband=0.0, **none) == (True, '')


WOUND = 0.5 * np.array(FETCHING_IN_SPACE)
STRETCHING = {
    'model': 'exact',
    'tendons.axial_stiffness': [800.0],
    'material.youngs_modulus_stddev': 0.05,
}


@pytest.fixture(scope='module')
def wound():
    """Client of a node with tendons that stretch, and its ``solver``."""
    with hosting(OctoArmNode, node='wound', **AFFORDED, **STRETCHING) as client:
        client.winches = client.node.create_publisher(JointState, 'tendon_displacements', 10)
        client.estimates = client.hear(TendonTensions, 'tendon_tension_estimates')
        client.connect()
        client.wait(client.winches.get_subscription_count, 'a subscription')
        assert list(client.dump()['tendons.axial_stiffness']) == [800.0]
        config = Config.from_parameters(load_parameters('renda2012_table4') | STRETCHING)
        client.solver = config.solver(compiled=None)
        yield client


def reel(client, displacements):
    """Publish displacements by name; returns the answer that carries their stamp."""
    message = JointState(name=list(displacements), position=list(displacements.values()))
    message.header.stamp.sec = next(client.stamps)
    client.winches.publish(message)
    return client.answered(message.header.stamp.sec, 'tendon_displacements')


def test_displacements_of_all_tendons_give_back_shape_and_tensions(wound):
    expected = wound.solver.solve(WOUND)
    # Clearly slack: where one is just taut, the derivatives are those of either side.
    asked = displacements_of(wound.solver, expected).ravel() - 1e-3 * (WOUND.ravel() == 0.0)
    asked = dict(zip(NAMES, asked.tolist(), strict=True))
    answers = reel(wound, asked)
    assert_allclose(tip_of(answers), expected.tip, atol=1e-8)
    wound.wait(lambda: wound.estimates, 'tension estimates')
    estimate = wound.estimates[-1]
    assert list(estimate.name) == NAMES
    assert estimate.header.stamp == answers[0].header.stamp
    assert_allclose(estimate.tension, WOUND.ravel(), atol=1e-8 * WOUND.max())
    covariance = np.reshape(answers[3].pose.covariance, (6, 6))
    held = wound_sensitivity(wound.solver, solve_displacements(wound.solver, asked)).held
    by_young = 0.05 * held.by_youngs_modulus.tip
    assert_allclose(
        covariance, by_young @ by_young.T, rtol=1e-4, atol=1e-6 * np.abs(by_young).max() ** 2
    )


def test_winches_and_load_cells_drive_different_tendons_together(wound):
    asked = {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}
    given = np.zeros((3, 4))
    given[2, 0] = 1.0
    reel(wound, {})
    wound.ask('tendon_tensions', given)
    expected = solve_displacements(wound.solver, asked, {'tendon_3_1': 1.0}).backbone
    assert_allclose(tip_of(reel(wound, asked)), expected.tip, atol=1e-8)
    given[2, 0] = 1.5
    given[0, 0] = 7.0  # its winch is driven by length
    expected = solve_displacements(wound.solver, asked, {'tendon_3_1': 1.5}).backbone
    answers = wound.ask('tendon_tensions', given)
    assert_allclose(tip_of(answers), expected.tip, atol=1e-8)
    lengths = answers[4]
    assert_allclose(lengths.effort, expected.tensions.ravel(), atol=1e-8)
    status, _ = wound.status('input')
    assert 'several sources' not in status.message
    # Without names all tendons are let go, and follow the tensions again.
    reel(wound, {})
    alone = wound.solver.solve(given)
    assert_allclose(tip_of(wound.ask('tendon_tensions', given)), alone.tip, atol=1e-9)


@pytest.mark.parametrize(
    ('name', 'position', 'problem'),
    [
        (['elbow'], [0.01], 'unknown tendon elbow'),
        (['tendon_1_1'], [], 'name has 1 entries but position has 0'),
        (['tendon_1_1'] * 2, [0.01, 0.02], 'tendon named more than once: tendon_1_1'),
        (['tendon_1_1'], [float('nan')], 'displacement of tendon_1_1 is nan m'),
        (['tendon_1_1', 'tendon_2_2'], [0.01, 15.0], 'displacement of tendon_2_2 is 15 m, expect'),
    ],
)
def test_displacements_that_are_none_are_refused_with_a_warning(wound, name, position, problem):
    wound.wait(
        lambda: problem in wound.status('input')[1]['last refusal'],
        'a refusal',
        lambda: wound.winches.publish(JointState(name=name, position=position)),
    )
    given = 0.2 * WOUND
    reel(wound, {})
    expected = wound.solver.solve(given).tip
    assert_allclose(tip_of(wound.ask('tendon_tensions', given)), expected, atol=1e-9)


def test_an_arm_without_the_tendon_lets_go_of_it(wound):
    reel(wound, {'tendon_1_1': 0.02})
    other = [f'cable_{number}' for number in range(12)]
    assert wound.change(tendon_names=other)[0]
    wound.log('displacements dropped: this arm has no tendon tendon_1_1')
    given = 0.2 * WOUND
    expected = wound.solver.solve(given).tip
    answers = wound.ask('tendon_tensions', given, other)
    assert_allclose(tip_of(answers), expected, atol=1e-9)
    assert wound.change(tendon_names=NAMES)[0]


# Of each tendon: its motor, which reels two of them in opposite directions [rad].
MOTORS = [f'm{section}{side}' for section in (1, 2, 3) for side in 'abab']
RADIUS, ZERO = 0.01, 0.5


def test_motors_in_a_field_of_any_message_reel_as_their_spools_say():
    ways = [1.0, 1.0, -1.0, -1.0] * 3
    scale, offset = ([size * way for way in ways] for size in (RADIUS, -ZERO * RADIUS))
    given = {
        'displacement_type': 'sensor_msgs/msg/JointState',
        'displacement_field': 'velocity',
        'displacement_names': MOTORS,
        'displacement_scale': scale,
        'displacement_offset': offset,
    }
    turns = dict(zip(dict.fromkeys(MOTORS), (0.9, 0.5, 0.3, 0.8, 0.5, 0.1), strict=True))
    lengths = {
        name: way * RADIUS * (turns[motor] - ZERO)
        for name, motor, way in zip(NAMES, MOTORS, ways, strict=True)
    }
    solver = Config.from_parameters(
        load_parameters('renda2012_table4') | {'model': 'exact'}
    ).solver()
    expected = solve_displacements(solver, lengths).backbone.tip
    remap = '-r', 'tendon_displacements/field:=/motors'
    with hosting(OctoArmNode, *remap, node='spun', model='exact', **AFFORDED) as client:
        assert client.change(**given) == (True, '')
        motors = client.node.create_publisher(JointState, '/motors', 10)
        message = JointState(name=list(turns), velocity=list(turns.values()))
        message.header.stamp.sec = 79
        wait_for_answer(client, motors, message, expected, 1e-8)
        bad = JointState(name=['m1a'], velocity=[1.0])
        client.log('/motors refused', "'m1b'", again=partial(motors.publish, bad))
        done, why = client.change(displacement_field='')
        assert not done and 'or no value without displacement_field' in why
        assert client.change(displacement_type='', displacement_field='') == (True, '')
        client.log('displacements dropped: displacement_type is not given any more')
        client.wait(lambda: not motors.get_subscription_count(), 'the end of the subscription')
        pulled = solver.solve(np.reshape(FETCHING_IN_PLANE, solver.arm.tension_shape)).tip
        assert_allclose(
            tip_of(client.ask('tendon_tensions', FETCHING_IN_PLANE)), pulled, atol=1e-8
        )


# What is said of inputs --------------------------------------------------------------------------


def test_stamps_that_run_backwards_and_two_sources_are_diagnosed(client):
    client.stamps = itertools.count(1000)
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    client.stamps = itertools.count(500)
    path, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert path.header.stamp.sec == 500

    def ask_both():
        for topic in ('tendon_tensions', 'tendon_tensions/joint_state'):
            client.ask(topic, FETCHING_IN_PLANE)

    for words in ('running backwards', 'several sources'):
        client.wait(lambda words=words: words in ' '.join(client.told()), words, ask_both)
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
    given = {'model': 'exact', 'diagnostics.silence_limit': SILENCE, **AFFORDED}
    with hosting(OctoArmNode, node='wound', **given) as client:
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
    def tell():
        more[0].publish(messages[kind])
        client.ask('tendon_tensions', FETCHING_IN_PLANE)

    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert 'publishers on' not in client.status('input')[0].message
    messages = {
        TendonTensions: TendonTensions(name=NAMES, tension=np.zeros(12)),
        JointState: JointState(),  # drives no tendon
    }
    # One of tensions is there already.
    count = 1 if topic == 'tendon_tensions' else 2
    more = [client.node.create_publisher(kind, topic, 10) for _ in range(count)]
    words = f'2 publishers on /{topic}'
    client.diagnostics.clear()
    try:
        client.wait(lambda: any(words in one for one in client.told()), 'a warning', tell)
    finally:
        for one in more:
            client.node.destroy_publisher(one)


@pytest.mark.parametrize(('step', 'is_ahead'), [(0.08, False), (0.01, True)])
def test_a_coarse_clock_is_not_mistaken_for_stamps_from_the_future(step, is_ahead):
    with hosting(OctoArmNode, use_sim_time=True) as client:
        tell_time = client.clock()

        def is_time():
            stamp = client.diagnostics[-1].header.stamp
            return (stamp.sec, stamp.nanosec) == divmod(now, 10**9)

        client.connect()
        status, values = client.status('input')
        assert 'nothing is heard on /clock' in status.message
        assert values['age of the newest stamp [s]'] == ''
        now = 5000 * 10**9
        for _ in range(3):
            now += int(1e9 * step)
            client.wait(is_time, 'that time', lambda: tell_time(*divmod(now, 10**9)))
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
        client.clock()
        several = 'several sources: several publishers on /clock'
        client.wait(lambda: any(several in one for one in client.told()), several)
        # The steps of a clock that is not used any more are no tolerance.
        tell_time(now // 10**9 + 3000)
        assert client.change(use_sim_time=False) == (True, '')
        stamped.header.stamp = client.node.get_clock().now().to_msg()
        stamped.header.stamp.sec += 1000
        client.forget()
        client.publishers['tendon_tensions'].publish(stamped)
        client.wait(lambda: client.answers['backbone/path'], 'an answer')
        assert int(client.status('input')[1]['stamps from the future']) == after + 1
