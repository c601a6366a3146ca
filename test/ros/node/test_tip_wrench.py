"""Wrenches on the tip in the frame of the tip and of sensors, over DDS."""

import dataclasses

import numpy as np
import pytest

tf2 = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')

from geometry_msgs.msg import TransformStamped, WrenchStamped
from live_nodes import AFFORDED, CONFIG, hosting, tip_of
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation

from octo_arm_model import FollowingWrench, Loads
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node.main import OctoArmNode

FORCE, MOMENT = np.array([2e-3, 3e-3, -1e-3]), np.array([1e-5, -2e-5, 3e-5])
TURN, PLACE = Rotation.from_euler('xyz', (0.3, -0.8, 1.1)), np.array([0.01, 0.0, -0.02])
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
EXACT = dataclasses.replace(CONFIG, model='exact')


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
    prefix = '-p', 'frame_prefix:=arm_'
    with hosting(OctoArmNode, *AFFORDED, '-p', 'model:=exact', *prefix, node='felt') as client:
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
    return dataclasses.replace(EXACT, loads=loads).solver().solve(FETCHING_IN_PLANE).tip


def expected_of(frame):
    force, moment = TURN.apply(FORCE), TURN.apply(MOMENT)
    if frame == 'sensor':
        return following(force, moment + np.cross(PLACE, force))
    if frame == 'arm_tip':
        return following(FORCE, MOMENT)
    wrench = [*force, *moment] if frame == 'world' else [*FORCE, *MOMENT]
    return EXACT.solver().solve(FETCHING_IN_PLANE, wrench).tip


def send(client, frame):
    message = WrenchStamped()
    message.header.frame_id = frame
    for part, values in ((message.wrench.force, FORCE), (message.wrench.torque, MOMENT)):
        part.x, part.y, part.z = values.tolist()
    client.wrench.publish(message)


@pytest.mark.parametrize('frame', ['arm_tip', 'arm_base', 'sensor', 'world', 'sensor'])
def test_a_wrench_acts_as_its_frame_says(felt, frame):
    expected = expected_of(frame)

    def is_felt():
        send(felt, frame)
        tip = tip_of(felt.ask('tendon_tensions', FETCHING_IN_PLANE))
        return np.allclose(tip, expected, atol=1e-8)

    felt.wait(is_felt, f'a wrench in {frame}')


@pytest.mark.parametrize(
    ('frame', 'reason'),
    [('nowhere', "its frame is 'nowhere'"), ('finger', "which moves on 'arm_tip', expected stat")],
)
def test_a_wrench_in_a_frame_that_is_unknown_or_moves_is_refused(felt, frame, reason):
    def is_told():
        felt.moving.publish(tf2.TFMessage(transforms=[link('arm_tip', 'finger')]))
        send(felt, frame)
        felt.ask('tendon_tensions', FETCHING_IN_PLANE)
        return any('tip_wrench refused' in one.msg and reason in one.msg for one in felt.logs)

    felt.wait(is_told, 'a refusal')
