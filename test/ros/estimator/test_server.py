"""The node of the estimator, told over DDS what sensors of a known arm measure."""

import dataclasses
import itertools
import math
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from estimator_nodes import CONFIG, INPUTS, LENGTH, NAMES, STATIONS, TENSIONS, estimating_here
from geometry_msgs.msg import Pose, TransformStamped
from lifecycle_msgs.msg import Transition
from live_nodes import setting, xyz
from numpy.testing import assert_allclose, assert_array_equal
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from octo_arm_model import Loads, PointLoad, SolveError, displacements_of
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.ros.estimator.main import EstimatorNode, ManagedEstimatorNode

FORCE = np.array([0.0, -0.004, 0.008])
PRIOR = 0.01  # standard deviation of each component of the force [N]
BOTH = ('tendon_tensions', 'measured/tip_pose')
GATES = itertools.count(1)  # the first one another than the default


@pytest.fixture(scope='module')
def shared():
    with estimating_here(EstimatorNode) as client:
        client.connect()
        yield client


@pytest.fixture
def client(shared):
    """A client of a node that knows nothing yet, of an arm that nothing touches."""
    shared.tensions, shared.force, shared.scale = TENSIONS, np.zeros(3), 1.0
    # Another gate each time, nearly the same one, makes the estimate begin anew.
    usual = {
        'contact': 'tip',
        'contact_s': [],
        'tension_bias_stddev': 0.0,
        'displacement_stddev': 2e-4,
        'gate': 0.9999 + 1e-9 * next(GATES),
    }
    given = {f'estimator__{name}': value for name, value in usual.items()}
    assert shared.change(**given) == (True, '')
    return shared


def assert_is_true(client, topic='tip_wrench/estimate'):
    """The force is that which acts, within its standard deviation, which is small."""
    found, stddev = client.wrench(topic)
    assert (np.abs(found - client.force) < 4.5 * stddev).all(), (found, stddev)
    return stddev


def test_a_force_on_the_tip_is_found_with_its_covariance(client):
    client.measure(1000.0 + 0.05 * np.arange(6))
    assert_is_true(client)
    client.force = FORCE
    client.measure(1001.0 + 0.05 * np.arange(12))
    stddev = assert_is_true(client)
    assert stddev[1:].max() < 0.5 * PRIOR
    covariance = client.newest('backbone/covariance')
    assert covariance.header == client.answers['tip_pose'][-1].header
    assert covariance.header.frame_id == 'arm_base'
    assert len(covariance.s) == STATIONS and covariance.contact_s == LENGTH
    poses = np.reshape(covariance.pose, (STATIONS, 6, 6))
    tip = client.newest('tip_pose').pose
    assert_array_equal(poses[-1].ravel(), tip.covariance)
    away = xyz(tip.pose.position) - client.shape.tip
    assert away @ np.linalg.solve(poses[-1, :3, :3], away) < 30.0  # chi-square of 3, 1e-6
    found = client.newest('tendon_tension_estimates')
    assert found.name == NAMES
    assert_allclose(found.tension, TENSIONS, atol=0.05)
    assert not client.answers['tension_bias'] and not client.answers['contact/estimate']


def test_tensions_alone_give_the_forward_model_and_say_what_they_cannot_tell(client):
    client.measure([1000.0], ['tendon_tensions'])
    found, stddev = client.wrench()
    assert_allclose(found, 0.0, atol=1e-9)
    assert_allclose(stddev, PRIOR, rtol=1e-6)
    status, values = client.status('estimate')
    assert status.message == 'waiting' and status.level == DiagnosticStatus.OK
    for axis in 'xyz':
        assert f'tip_force {axis} keeps its prior' in values['not observable']
    client.measure(1000.1 + 0.02 * np.arange(5), BOTH)
    _, values = client.status('estimate')
    assert 'tip_force z' not in values['not observable']
    assert values['tip pose accepted'] == '5' and values['tip pose refused'] == '0'
    client.diagnostics.clear()
    client.wait(
        lambda: 'estimating' in client.told(),
        'a diagnosis while it measures',
        lambda: client.measure([1000.2 + 0.01 * len(client.answers['tip_pose'])], BOTH),
    )


def test_a_sensor_that_lies_is_thrown_out_and_reported(client):
    def lie(message):
        message.pose.pose.position.z += 0.1

    client.force = FORCE
    client.measure(1000.0 + 0.05 * np.arange(8))
    for step in range(4):
        client.tell('measured/tip_pose', 1000.5 + 0.01 * step, lie)
    after, stddev = client.wrench()
    # Without the tip nothing tells of the force.
    assert (np.abs(after - FORCE) < 5 * stddev).all() and (stddev > 0.1 * PRIOR).all()
    client.log('tip pose refused: it contradicts the estimate')
    status, values = client.status('estimate')
    assert 'tip pose is refused since 1000.500 s' in status.message
    assert values['tip pose refused'] == '4' and values['tip pose accepted'] == '8'
    client.measure(1000.6 + 0.05 * np.arange(60))
    assert_is_true(client)
    assert 'tip pose is refused' not in client.status('estimate')[0].message


def test_late_measurements_count_within_the_window_and_are_refused_beyond_it(client):
    client.force = FORCE
    client.measure(1000.0 + 0.02 * np.arange(10))
    newest = client.newest('tip_pose').header
    _, before = client.wrench()
    for late in (0.15, 0.1, 0.05):
        assert client.tell('measured/markers', 1000.18 - late).header == newest
    after = assert_is_true(client)
    assert after.prod() < before.prod()  # with this noise a single one may grow
    heard = len(client.answers['tip_pose'])
    late = partial(client.send, 'measured/markers', 999.5)
    client.log('/measured/markers refused: measured 0.68', 'window of 0.2 s', again=late)
    assert int(client.status('estimate')[1]['came too late']) >= 1
    assert len(client.answers['tip_pose']) == heard


def warned(client, words):
    """Levels of what was said with these ``words``."""
    found = {
        status.level
        for message in client.diagnostics
        for status in message.status
        if words in status.message
    }
    assert found <= {DiagnosticStatus.WARN}
    return found


def test_a_bag_that_begins_anew_is_followed_from_its_beginning(client):
    client.diagnostics.clear()
    client.measure(1000.0 + 0.02 * np.arange(5))
    tip = client.tell('tendon_tensions', 990.0)
    assert tip.header.stamp.sec == 990
    client.log('/tendon_tensions: stamps run back by')
    words = 'stamps of /tendon_tensions ran back, the estimate was reset 1 time(s)'
    client.wait(lambda: warned(client, words), 'a diagnosis')
    _, stddev = client.wrench()
    assert_allclose(stddev, PRIOR, rtol=1e-6)


def test_an_estimate_begins_anew_where_time_jumps_back_by_little(client):
    """As in a simulation of a second that is reset: all would be late until that is over."""
    tell, tip = client.clock(), client.answers['tip_pose']
    assert client.change(use_sim_time=True) == (True, '')
    try:
        for sec in (1001, 1000):
            client.logs.clear()
            client.wait(
                lambda sec=sec: tip and tip[-1].header.stamp.sec == sec,
                f'an estimate at {sec} s',
                lambda sec=sec: (tell(sec), client.send('tendon_tensions', sec + 0.1)),
            )
        client.log('/clock: time jumps back; the estimate is reset')
    finally:
        assert client.change(use_sim_time=False) == (True, '')


def test_where_nothing_can_be_used_the_estimate_is_not_said_to_be_well(client, monkeypatch):
    client.diagnostics.clear()
    for seconds, why in ((2**31 - 1, 'its stamp is'), (1000, 'there is no shape')):
        client.wait(
            lambda why=why: warned(client, f'could be used: /tendon_tensions: {why}'),
            'a warning',
            lambda s=seconds: client.send('tendon_tensions', 1.0, setting('header.stamp.sec', s)),
        )
        monkeypatch.setattr(Estimator, 'add', Mock(side_effect=SolveError('there is no shape')))
    monkeypatch.undo()
    client.measure([1000.0])
    status, _ = client.status('estimate')
    assert 'could be used' not in status.message


def test_what_cannot_have_been_measured_is_refused_with_a_sentence(client):
    client.measure([1000.0, 1000.1])
    for topic, path, value, words in (
        ('tendon_tensions', 'name', ['elbow', *NAMES[1:]], 'unknown tendon elbow'),
        ('tendon_tensions', 'header.stamp.sec', 2**31 - 1, 'its stamp is'),
        ('tendon_displacements', 'name', 5000 * ['n' * 1000], '5000 displacements, this arm has'),
        ('measured/tip_pose', 'header.frame_id', 'camera', "its frame is 'camera', and no frame"),
        ('measured/tip_pose', 'pose.pose.position.x', math.inf, 'tip pose: position is'),
        ('measured/markers', 'poses', 20_000 * [Pose()], 'it has 20000 marker(s), expected 2'),
        ('measured/base_wrench', 'wrench.torque.y', math.nan, 'base wrench: value is'),
        ('measured/base_wrench', 'header.frame_id', 2**23 * 'f', '8388676 bytes, expected'),
    ):
        client.logs.clear()
        heard = len(client.answers['tip_pose'])
        bad = partial(client.send, topic, 1000.5, setting(path, value))
        client.log(f'/{topic} refused: {words}', again=bad)
        assert len(client.answers['tip_pose']) == heard
    # All of that changed nothing.
    client.force = FORCE
    client.measure(1001.0 + 0.05 * np.arange(8), [*INPUTS])
    assert_is_true(client)
    _, values = client.status('input')
    assert int(values['refused']) >= 7


def test_what_a_moving_camera_sees_waits_for_the_transform_of_its_time(client):
    """Which is published after it, as is usual."""
    tf2 = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')
    tell = client.teller(tf2.TFMessage, '/tf')
    times = itertools.count(1000.0, 0.02)

    def height(time):
        return 0.5 + 0.1 * (time - 1000.0)

    def move(time):
        link = TransformStamped(child_frame_id='rail')
        link.header.frame_id = 'arm_base'
        link.header.stamp.sec, link.header.stamp.nanosec = divmod(round(time * 1e9), 10**9)
        link.transform.translation.z, link.transform.rotation.w = height(time), 1.0
        itself = TransformStamped(child_frame_id='arm_base', header=link.header)  # is refused
        itself.transform.rotation.w = 1.0
        tell(transforms=[itself, link])

    def see(time):
        def seen(message):
            message.header.frame_id = 'rail'
            message.pose.pose.position.z -= height(time)

        client.send('measured/tip_pose', time, seen)

    tip = client.answers['tip_pose']
    client.measure([1000.0], ['tendon_tensions'])
    count = len(tip)

    def move_and_see():
        time = next(times)
        move(time)
        client.spin(0.1)
        see(time + 0.01)

    client.wait(lambda: len(tip) > count + 5, 'estimates of what the camera saw', move_and_see)
    assert np.linalg.norm(xyz(tip[-1].pose.pose.position) - client.shape.tip) < 2e-3


def test_noise_that_is_larger_than_told_is_said(client):
    client.measure(1000.0 + 0.02 * np.arange(40))
    status, values = client.status('estimate')
    assert 'larger than expected' not in status.message, values
    assert client.change(estimator__gate=0.999999999) == (True, '')
    client.scale = 2.5
    for start in range(1002, 1012):
        client.measure(start + 0.02 * np.arange(40))
        status, values = client.status('estimate')
        if status.level == DiagnosticStatus.WARN:
            break
    told = 'larger than expected', 'is refused', 'load cell'
    assert any(words in status.message for words in told), values
    assert client.change(estimator__gate=0.9999) == (True, '')


def test_what_does_not_concern_the_estimate_leaves_it_as_it_is(client):
    client.force = FORCE
    cases = (
        ({'markers_rate': 7.0}, True),
        ({'estimator__gate': 0.99}, False),
        ({'displacement_scale': [2.0]}, False),
        ({'displacement_scale': [1.0]}, False),
    )
    for second, (change, goes_on) in enumerate(cases, 1000):
        client.measure(second + 0.05 * np.arange(12))
        assert client.change(**change) == (True, '')
        client.tell('tendon_tensions', second + 0.6)
        stddev = client.wrench('tip_wrench/estimate')[1]
        assert (stddev[1:].max() < 0.5 * PRIOR) == goes_on, (change, stddev)


def test_a_bias_of_the_load_cells_is_estimated_where_it_may_be(client):
    exact = {'estimator__contact': 'none', 'estimator__displacement_stddev': 2e-5}
    assert client.change(estimator__tension_bias_stddev=0.1, **exact) == (True, '')
    bias = np.array([0.08, 0.0, -0.05, 0.02])

    def shift(message):
        message.tension = np.array(message.tension) + bias

    for step in range(12):
        client.tell('tendon_displacements', 1000.0 + 0.1 * step)
        client.tell('tendon_tensions', 1000.05 + 0.1 * step, shift)
    found = client.newest('tension_bias')
    assert found.name == NAMES
    assert_allclose(found.tension, bias, atol=0.02)


@pytest.mark.parametrize('place', [0.1, LENGTH])
def test_where_the_arm_is_touched_is_found(client, place):
    places = [0.1, LENGTH]
    assert client.change(estimator__contact='somewhere', estimator__contact_s=places) == (True, '')
    loads = Loads(points=(PointLoad(place, tuple(FORCE)),))
    usual = client.solver
    client.solver = dataclasses.replace(CONFIG, loads=loads).solver()
    try:
        topics = ('tendon_tensions', 'measured/tip_pose', 'measured/markers')
        client.measure(1000.0 + 0.05 * np.arange(10), topics)
    finally:
        client.solver = usual
    _, values = client.status('estimate')
    assert values['hypothesis'] == f'{place:.4g} m', values
    client.force = FORCE
    assert_is_true(client, 'contact/estimate')
    assert client.newest('backbone/covariance').contact_s == place


def test_parameters_that_cannot_be_are_refused_and_all_goes_on(client):
    for name, value, words in (
        ('contact', 'elbow', "estimator.contact is 'elbow', expected one of tip"),
        ('force_stddev', 1e300, 'estimator.force_stddev is 1e+300, expected'),
        ('displacement_stddev', 1e-300, 'estimator.displacement_stddev is 1e-300, expected'),
        ('marker_s', [1.0], 'estimator.marker_s has 1, expected from 0 to'),
    ):
        done, why = client.change(**{f'estimator__{name}': value})
        assert not done and words in why
    done, why = client.change(tension_stddev=1e-20)
    assert not done and 'differ by more than numbers resolve' in why
    done, why = client.change(model='octopus')
    assert not done and why == "model is 'octopus', expected one of renda2012, closed_form, exact"
    client.measure([1000.0])


def test_what_motors_read_in_a_field_is_a_measurement(client):
    shape = client.solver.solve(TENSIONS.reshape(1, 4))
    turns = 1e3 * displacements_of(client.solver, shape).ravel()
    field = {'displacement_type': 'sensor_msgs/msg/JointState', 'displacement_field': 'velocity'}
    assert client.change(**field, displacement_scale=[1e-3]) == (True, '')
    motors = client.node.create_publisher(JointState, 'tendon_displacements/field', 10)
    try:
        message = JointState(name=NAMES, velocity=turns.tolist())
        message.header.stamp.sec = 1000
        counted = 'tendon displacements accepted'
        client.wait(
            lambda: int(client.status('estimate')[1].get(counted, 0)) > 0,
            'an estimate',
            partial(motors.publish, message),
        )
        # Without load cells it is what the encoders say, against a wide prior of the tensions.
        tip = xyz(client.newest('tip_pose').pose.pose.position)
        assert_allclose(tip, shape.tip, atol=2e-3)
    finally:
        done = client.change(displacement_type='', displacement_field='', displacement_scale=[1.0])
        assert done == (True, '')
        client.node.destroy_publisher(motors)


def test_rviz_sees_the_tube_and_the_arrow(client):
    heard, steps = client.hear(MarkerArray, 'markers'), itertools.count()
    client.force = FORCE

    def seen():
        found = {marker.ns: marker for message in heard for marker in message.markers}
        return found if 'contact' in found and found['contact'].points else None

    def measure():
        client.measure([1000.0 + 0.05 * next(steps)])

    found = client.wait(seen, 'an arrow', measure)
    assert {'body', 'tendons', 'covariance', 'cone'} <= found.keys()


def test_who_lies_is_named_with_since_when_busy_is_busy_and_silent_is_silent(client):
    steps = itertools.count()
    # Others may have been heard before, and not since.
    heard = 'tendon_tensions', '/measured/tip_pose'

    def lie(message):
        message.tension[2] += 2.0

    def said(tip=1, cells=1):
        """What the next diagnosis says, by its part, while so many messages come at a time."""
        client.diagnostics.clear()
        while not client.diagnostics:
            for topic, count in (('tendon_tensions', cells), ('measured/tip_pose', tip)):
                for _ in range(count):
                    change = lie if topic == 'tendon_tensions' else None
                    client.send(topic, 1000.3 + 0.001 * next(steps), change)
            client.spin(0.1)
        found = client.diagnostics[-1].status
        return {status.name.split(': ')[1]: status.message for status in found}

    client.measure(1000.0 + 0.05 * np.arange(6))
    assert client.change(diagnostics__silence_limit=2.0) == (True, '')
    try:
        named = f'load cell {NAMES[2]} is refused since 1000.300 s'
        client.wait(lambda: named in said()['estimate'], 'its name')
        # The next diagnosis may have been made before they came.
        busy = client.wait(
            lambda: 'skipped for newer ones' in (now := said(20, 20))['output'] and now,
            'a warning',
        )
        for sensor in heard:
            assert f'{sensor} is silent' not in busy['input']
        assert named in busy['estimate']
        client.wait(
            lambda: (
                '/measured/tip_pose is silent for' in (now := said(tip=0))['input']
                and 'tendon_tensions is silent' not in now['input']
            ),
            'a warning',
        )
        tip = '/measured/tip_pose is silent'
        client.wait(lambda: tip not in said()['input'], 'an end of the warning')
    finally:
        assert client.change(diagnostics__silence_limit=1e6) == (True, '')


def test_a_managed_estimator_estimates_while_it_is_active_and_then_anew():
    with estimating_here(ManagedEstimatorNode) as client:
        assert client.transition(Transition.TRANSITION_CONFIGURE)
        client.wait(
            lambda: client.node.count_publishers('backbone/covariance') == 1, 'a configured node'
        )
        assert not any(client.node.count_subscribers(topic) for topic in INPUTS)
        client.force = np.array([0.0, -0.004, 0.008])
        for _ in range(2):
            assert client.transition(Transition.TRANSITION_ACTIVATE)
            client.connect()
            client.measure(1000.0 + 0.05 * np.arange(8))
            found, stddev = client.wrench()
            assert (np.abs(found - client.force) < 4.5 * stddev).all()
            status, values = client.status('estimate')
            assert status.message == 'waiting' and values['tip pose accepted'] == '8'
            assert client.transition(Transition.TRANSITION_DEACTIVATE)
            client.wait(
                lambda: not any(client.node.count_subscribers(topic) for topic in INPUTS),
                'an inactive node',
            )
            assert client.status('estimate')[0].message == 'inactive'
        assert client.transition(Transition.TRANSITION_CLEANUP)
        client.wait(
            lambda: client.node.count_publishers('backbone/covariance') == 0,
            'a node without publishers',
        )
