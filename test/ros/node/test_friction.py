"""The node with friction, whose history it remembers, and what it is told in other frames."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from live_nodes import AFFORDED, CONFIG, CONFIG_FILE, RELIABLE, hosting, spin_until, tip_of
from numpy.testing import assert_allclose, assert_array_equal
from sensor_msgs.msg import PointCloud2

from octo_arm_model import Config, Solver
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.ros.node.main import OctoArmNode

tf2 = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, TransformStamped, WrenchStamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation

from octo_arm_model import FollowingWrench, Loads
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node import inputs
from octo_arm_model.ros.node.inputs import LARGEST, LONGEST, MOST_WAITING, Inputs
from octo_arm_model.ros.node.sensor_frames import SensorFrames

HIGH = np.full((3, 4), 0.02) + [[0.0], [0.0], [1.0]] * np.array([1.0, 0.5, 0.0, 0.0])
LOW = 0.5 * HIGH
SETTINGS = {'model': 'exact', 'tendons.friction': [0.2], 'friction_memory': 5.0}


def test_a_loop_has_two_shapes_and_a_gap_ends_the_memory():
    given = Config.from_parameters(load_parameters(CONFIG_FILE) | SETTINGS)
    assert given.arm.friction == len(CONFIG.arm.tendons) * (0.2,)
    solver: Solver = given.solver(compiled=None)
    up, fresh = solver.solve(HIGH), solver.solve(LOW)
    down = solver.follow(LOW, up)
    assert np.linalg.norm(down.tip - fresh.tip) > 1e-3
    with hosting(OctoArmNode, **AFFORDED, **SETTINGS) as client:
        client.connect()
        profiles = client.hear(PointCloud2, 'tendon_tension_profiles')
        # From the start: time goes back.
        client.stamps = itertools.count(1)
        client.ask('tendon_tensions', HIGH)
        assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), down.tip, atol=1e-9)
        assert_profiles(client, profiles, LOW, down)
        # A parameter that the balance does not depend on leaves the history as it is.
        assert client.change(markers_rate=10.0) == (True, '')
        assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), down.tip, atol=1e-9)
        _, values = client.status('solver')
        assert values['friction history kept'] == 'True'
        forgotten = int(values['friction history forgotten after a gap'])
        client.stamps = itertools.count(100)
        assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), fresh.tip, atol=1e-9)
        _, values = client.status('solver')
        assert int(values['friction history forgotten after a gap']) == forgotten + 1
        # Where a tendon sticks there are no derivatives: a listener does not cost the shape.
        assert client.change(tension_stddev=0.02) == (True, '')
        client.ask('tendon_tensions', HIGH)
        second = client.send('tendon_tensions', 0.999 * HIGH)
        shapes, tips = client.answers['backbone/path'], client.answers['tip_pose']
        client.wait(lambda: shapes[-1].header.stamp.sec == second, 'a shape')
        assert tips[-1].header.stamp.sec < second
        _, values = client.status('solver')
        assert values['shapes without tip_pose'] == '1'
        assert client.change(tendons__friction=[0.1]) == (True, '')
        assert client.status('solver')[1]['friction history kept'] == 'False'
        refused = (False, 'friction_memory is -1.0, expected a finite time >= 0 [s]')
        assert client.change(friction_memory=-1.0) == refused


def profiles_of(message):
    """Every field of every point of a PointCloud2 as a column, (points, fields)."""
    assert message.height == 1 and not message.is_bigendian
    names, kinds, offsets = zip(
        *(
            (field.name, {7: '<f4', 8: '<f8'}[field.datatype], field.offset)
            for field in message.fields
        )
    )
    layout = {'names': names, 'formats': kinds, 'offsets': offsets, 'itemsize': message.point_step}
    points = np.frombuffer(bytes(message.data), np.dtype(layout))
    return np.stack([points[name].astype(float) for name in names], axis=1)


def assert_profiles(client, profiles, tensions, expected):
    """The tensions along the tendons come with the shape, once the subscription is found."""
    client.stamps = itertools.count(1)

    def arrived():
        client.ask('tendon_tensions', HIGH)
        stamp = client.ask('tendon_tensions', tensions)[0].header.stamp
        client.spin()
        return profiles and profiles[-1].header.stamp == stamp

    client.wait(arrived, 'the tensions along the tendons')
    assert profiles[-1].header.frame_id == CONFIG.base_frame
    found = profiles_of(profiles[-1])
    assert_array_equal(found[:, 3], expected.s)
    assert_allclose(found[:, 4:], expected.tendon_tensions, rtol=1e-9, atol=1e-12)
    # Unloaded, tendons are tighter inside the arm than at the base.
    assert (found[5:, 4:] > 1.02 * found[0, 4:]).any()


# Wrenches in the frame of the tip and of sensors -------------------------------------------------


FORCE, MOMENT = np.array([2e-3, 3e-3, -1e-3]), np.array([1e-5, -2e-5, 3e-5])
TURN, PLACE = Rotation.from_euler('xyz', (0.3, -0.8, 1.1)), np.array([0.01, 0.0, -0.02])
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WITH_LOADS = dataclasses.replace(CONFIG, model='exact')


def link(parent, child):
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    shift, turn = made.transform.translation, made.transform.rotation
    shift.x, shift.y, shift.z = PLACE.tolist()
    turn.x, turn.y, turn.z, turn.w = TURN.as_quat().tolist()
    return made


@pytest.fixture(scope='module')
def felt():
    """Client of a node, and of transforms to a sensor on the tip, a world and a finger."""
    given = {'model': 'exact', 'frame_prefix': 'arm_', **AFFORDED, **RELIABLE}
    with hosting(OctoArmNode, node='felt', **given) as client:
        client.connect()
        links = [link('arm_tip', 'sensor'), link('arm_base', 'world')]
        client.static = client.node.create_publisher(tf2.TFMessage, '/tf_static', LATCHED)
        client.static.publish(tf2.TFMessage(transforms=links))
        client.moving = client.node.create_publisher(tf2.TFMessage, '/tf', 10)
        yield client


def following(force, moment):
    """The tip under a wrench that turns with it."""
    load = FollowingWrench(CONFIG.arm.length, tuple(force), tuple(moment))
    loads = Loads(others=(load,))
    return dataclasses.replace(WITH_LOADS, loads=loads).solver().solve(FETCHING_IN_PLANE).tip


def expected_of(frame):
    force, moment = TURN.apply(FORCE), TURN.apply(MOMENT)
    if frame == 'sensor':
        return following(force, moment + np.cross(PLACE, force))
    if frame == 'arm_tip':
        return following(FORCE, MOMENT)
    wrench = [*force, *moment] if frame == 'world' else [*FORCE, *MOMENT]
    return WITH_LOADS.solver().solve(FETCHING_IN_PLANE, wrench).tip


def send(client, frame, sec=0):
    message = WrenchStamped()
    message.header.frame_id, message.header.stamp.sec = frame, sec
    for part, values in ((message.wrench.force, FORCE), (message.wrench.torque, MOMENT)):
        part.x, part.y, part.z = values.tolist()
    client.wrench.publish(message)


def acts(client, frame):
    """Whether the arm has the shape under the wrench in ``frame``, after new tensions."""
    tip = tip_of(client.ask('tendon_tensions', FETCHING_IN_PLANE))
    return np.allclose(tip, expected_of(frame), atol=1e-8)


@pytest.mark.parametrize('frame', ['arm_tip', 'arm_base', 'sensor', 'world', 'sensor'])
def test_a_wrench_acts_as_its_frame_says(felt, frame):
    send(felt, frame)  # once, also in a frame that the node has not looked for before
    felt.wait(lambda: acts(felt, frame), f'a wrench in {frame}')


@pytest.mark.parametrize(
    ('frame', 'reason'),
    [('nowhere', "its frame is 'nowhere'"), ('finger', "which moves on 'arm_tip', expected stat")],
)
def test_a_wrench_in_a_frame_that_is_unknown_or_moves_is_refused(felt, frame, reason):
    def send_both():
        felt.moving.publish(tf2.TFMessage(transforms=[link('arm_tip', 'finger')]))
        send(felt, frame)
        felt.ask('tendon_tensions', FETCHING_IN_PLANE)

    felt.log('tip_wrench refused', reason, again=send_both)


def test_a_wrench_that_waits_for_its_transform_does_not_replace_a_newer_one(felt):
    def move(*frames, sec):
        moved = [link(parent, child) for parent, child in frames]
        for one in moved:
            one.header.stamp.sec = sec
        felt.moving.publish(tf2.TFMessage(transforms=moved))

    def acts_in_rail():
        move(('arm_base', 'rail'), sec=10)
        send(felt, 'rail', sec=10)
        return acts(felt, 'world')

    felt.wait(acts_in_rail, 'a wrench in the frame rail')
    felt.send_wrench(0.0)
    assert not acts(felt, 'world')
    send(felt, 'rail', sec=11)  # waits, also while parameters change
    assert not acts(felt, 'world')
    assert felt.change(markers_rate=20.0) == (True, '')
    move(('arm_base', 'rail'), sec=11)
    felt.wait(lambda: acts(felt, 'world'), 'what has waited')
    send(felt, 'rail', sec=12)  # waits
    assert acts(felt, 'world')
    felt.wait(
        lambda: acts(felt, 'arm_base'), 'a newer wrench', lambda: send(felt, 'arm_base', sec=13)
    )
    felt.logs.clear()
    move(('arm_base', 'rail'), ('arm_tip', 'finger'), sec=14)
    refuse = 'tip_wrench refused', "'finger', which moves on"
    felt.log(*refuse, again=lambda: (send(felt, 'finger', sec=14), acts(felt, 'arm_base')))
    assert acts(felt, 'arm_base')


def test_frames_have_another_parent_where_base_frame_changes(felt):
    def acts_on_cart(parent):
        moved = link(parent, 'cart')
        moved.header.stamp.sec = 10
        felt.moving.publish(tf2.TFMessage(transforms=[moved]))
        send(felt, 'cart', sec=10)
        return acts(felt, 'world')

    felt.send_wrench(0.0)
    try:
        for parent in ('arm_base', 'elsewhere'):
            assert felt.change(base_frame=parent) == (True, '')
            felt.wait(
                lambda parent=parent: acts_on_cart(parent), f'a wrench on a cart in {parent}'
            )
    finally:
        assert felt.change(base_frame='arm_base') == (True, '')


def test_moving_frames_are_forgotten_where_time_jumps_back(make_node):
    """Also by less than their history, as when a short simulation begins anew."""
    node = make_node('listener', parameter_overrides=[Parameter('use_sim_time', value=True)])
    frames, clock = SensorFrames(node, lambda: None), node.create_publisher(Clock, '/clock', 1)
    publisher = node.create_publisher(tf2.TFMessage, '/tf', 10)

    def is_at(x):
        moved = link('base', 'rail')
        moved.header.stamp.sec, moved.transform.translation.x = 1, x
        publisher.publish(tf2.TFMessage(transforms=[moved]))
        try:
            return frames.pose_of('rail', 'base', 10**9).position[0] == x
        except MeasurementError:
            return False

    def is_time(sec):
        clock.publish(Clock(clock=Time(sec=sec)))
        return node.get_clock().now().nanoseconds == sec * 10**9

    spin_until(node.executor, lambda: is_time(4))
    spin_until(node.executor, lambda: is_at(0.1))
    for _ in range(20):  # what was published meanwhile
        node.executor.spin_once(0.02)
    spin_until(node.executor, lambda: is_time(1))
    spin_until(node.executor, lambda: is_at(0.2))


def test_few_messages_wait_for_a_short_time(make_node, monkeypatch, capfd):
    node, refused, clock = make_node('listener'), [], SimpleNamespace(now=100.0)
    # One that is none does not hide those behind it.
    rail, twisted = link('base', 'rail'), link('base', 'twisted')
    twisted.transform.rotation = Quaternion(w=7.0)
    for one in (rail, twisted):
        one.header.stamp.nanosec = 100
    monkeypatch.setattr(inputs, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    made = Inputs(node, lambda topic, error: refused.append(str(error)), lambda older: None)
    frames = SensorFrames(node, made.look_again)
    publisher = node.create_publisher(tf2.TFMessage, '/tf', 10)

    def is_heard():
        publisher.publish(tf2.TFMessage(transforms=[twisted, rail]))
        try:
            return frames.pose_of('rail', 'base', 100).position == tuple(PLACE)
        except MeasurementError:
            return False

    spin_until(node.executor, is_heard)
    told = "/tf refused: 'twisted': transform.rotation is (0.0, 0.0, 0.0, 7.0) of length 7"
    assert told in capfd.readouterr().err
    for size in [6] * (MOST_WAITING + 2) + [LARGEST + 1]:
        made.attempt('/measured/tip_pose', lambda: frames.pose_of('rail', 'base', 5000), size)
    assert len(refused) == 3
    assert "its frame is 'rail', and the transform from 'rail'" in refused[0]
    clock.now += 1.01 * LONGEST
    spin_until(node.executor, lambda: len(refused) == MOST_WAITING + 3)
    made.close()
    frames.close()
