"""The frames of the arm on /tf."""

import sys

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import TransformStamped
from live_nodes import CONFIG, hosting
from rotations import matrix_of
from tf2_msgs.msg import TFMessage

from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.ros.node.main import OctoArmNode
from octo_arm_model.ros.node.outputs import frames_class


def test_frames_lead_from_the_base_to_the_tip():
    with hosting(
        OctoArmNode, '-p', 'base.position:=[0.1, -0.2, 0.3]', '-p', 'base_frame:=robot',
        '-p', 'frame_prefix:=left_',
    ) as client:  # fmt: skip
        heard = client.hear(TFMessage, '/tf')
        client.connect()

        def are_heard():  # What is published before they meet is not.
            client.ask('tendon_tensions', FETCHING_IN_SPACE)
            return heard

        client.wait(are_heard, 'frames')
        tip = client.ask('tendon_tensions', FETCHING_IN_SPACE)[3]
        client.wait(
            lambda: heard[-1].transforms[0].header.stamp == tip.header.stamp, 'the frames of it'
        )
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
    expected[:3, :3] = np.diag([-1.0, -1.0, 1.0]) @ matrix_of([turn.x, turn.y, turn.z, turn.w])
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
        matrix[:3, :3] = matrix_of([turn.x, turn.y, turn.z, turn.w])
        matrix[:3, 3] = [move.x, move.y, move.z]
        whole = matrix @ whole
        frame = step.header.frame_id
    return whole


class Recorder:
    """As much of a node as it takes to look for tf2_msgs; keeps what it is told."""

    def __init__(self):
        self.lines = []

    def get_logger(self):
        return self

    def warning(self, line):
        self.lines.append(line)


def test_without_tf2_msgs_there_is_no_broadcaster_but_a_line_in_the_log(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    node = Recorder()
    assert frames_class(node) is None
    assert len(node.lines) == 1
    assert 'tf2_msgs' in node.lines[0]
