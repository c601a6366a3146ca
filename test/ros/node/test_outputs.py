"""What the node publishes, and for whom."""

from functools import partial

import pytest
from live_nodes import CONFIG, hosting, xyz
from numpy.testing import assert_allclose, assert_array_equal
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.ros.node import outputs
from octo_arm_model.ros.node.main import OctoArmNode


@pytest.fixture
def drawn(client):
    """Stamps of the markers that come [s]; None for what clears the screen."""
    stamps = []

    def look(message):
        first = message.markers[0]
        stamps.append(first.header.stamp.sec if first.action == first.ADD else None)
        if first.action == first.ADD:
            assert {one.ns for one in message.markers} == {'body', 'anchorages', 'tendons'}
            assert {one.header.frame_id for one in message.markers} == {'arm_base'}

    looking = client.node.create_subscription(MarkerArray, 'markers', look, 100)
    yield stamps
    client.node.destroy_subscription(looking)
    assert client.change(markers_rate=30.0) == (True, '')


def ask_often(client, count):
    """Stamps [s] of shapes asked for as quickly as they are answered."""
    answers = (client.ask('tendon_tensions', FETCHING_IN_PLANE) for _ in range(count))
    return [path.header.stamp.sec for path, *_ in answers]


def test_markers_come_at_their_rate_and_the_last_shape_is_always_drawn(client, drawn):
    assert client.change(markers_rate=0.0) == (True, '')

    def is_drawn():
        (stamp,) = ask_often(client, 1)
        client.spin(0.05)
        return stamp in drawn

    client.wait(is_drawn, 'a drawing')
    stamps = ask_often(client, 5)
    client.wait(lambda: set(stamps) <= set(drawn), 'drawings of all')
    assert client.change(markers_rate=0.5) == (True, '')
    drawn.clear()
    stamps = ask_often(client, 20)
    client.wait(lambda: stamps[-1] in drawn, 'a drawing of the last shape')
    assert drawn[:2] == [None, stamps[0]]  # another arm may have been there before
    assert len(drawn) < 20


def test_frames_lead_from_the_base_to_the_tip():
    given = {'base_frame': 'robot', 'frame_prefix': 'left_'}
    with hosting(OctoArmNode, base__position=[0.1, -0.2, 0.3], **given) as client:
        heard = client.hear(TFMessage, '/tf')
        client.connect()
        # What is published before they meet is not heard.
        ask = partial(client.ask, 'tendon_tensions', FETCHING_IN_SPACE)
        client.wait(lambda: heard, 'frames', ask)
        tip = ask()[3]
        client.wait(
            lambda: heard[-1].transforms[0].header.stamp == tip.header.stamp, 'the frames of it'
        )
    frames = {frame.child_frame_id: frame for frame in heard[-1].transforms}
    assert set(frames) == {'left_tip', *(f'left_anchorage_{number}' for number in (1, 2, 3))}
    assert {frame.header.frame_id for frame in frames.values()} == {'robot'}
    found, place = frames['left_tip'].transform, xyz(tip.pose.pose.position)
    assert found.rotation == tip.pose.pose.orientation
    assert_array_equal(xyz(found.translation), place)
    expected = CONFIG.solver().solve(FETCHING_IN_SPACE).tip + [0.1, -0.2, 0.3]
    assert_allclose(place, expected, atol=1e-9)


def test_without_tf2_msgs_there_is_no_broadcaster_but_a_line_in_the_log(
    monkeypatch, make_node, capfd
):
    monkeypatch.setattr(outputs, 'TF_TYPE', 'absent_msgs/msg/TFMessage')
    node = make_node('plain')
    outputs.BackbonePublishers(node)
    assert node.count_publishers('/tf') == 0
    (line,) = capfd.readouterr().err.splitlines()
    assert 'tf2_msgs' in line
