"""The markers of the arm, over DDS."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG, CONFIG_FILE, spin_until
from rclpy.qos import QoSProfile
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node.outputs import MarkerPublisher, Output
from octo_arm_model.wire.markers import MarkersWriter
from octo_arm_model.wire.stamp import Stamp


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
    assert client.change(markers_rate=30.0) == (True, '')


def ask_until_drawn(client, drawn):
    """Whether somebody has drawn what was asked just now."""
    stamp = client.ask('tendon_tensions', FETCHING_IN_PLANE)[0].header.stamp.sec
    client.spin(0.05)
    return stamp in drawn


def test_markers_come_at_their_rate_and_the_last_shape_is_always_drawn(client, drawn):
    assert client.change(markers_rate=0.0) == (True, '')
    client.wait(lambda: ask_until_drawn(client, drawn), 'a drawing')
    assert client.change(markers_rate=0.5) == (True, '')
    drawn.clear()
    stamps = [
        client.ask('tendon_tensions', FETCHING_IN_PLANE)[0].header.stamp.sec for _ in range(20)
    ]
    client.wait(lambda: stamps[-1] in drawn, 'a drawing of the last shape')
    assert drawn[:2] == [None, stamps[0]]  # another arm may have been there before
    assert len(drawn) < 20


def test_every_shape_is_drawn_if_that_is_wanted(client, drawn):
    assert client.change(markers_rate=0.0) == (True, '')
    client.wait(lambda: ask_until_drawn(client, drawn), 'a drawing')
    stamps = [
        client.ask('tendon_tensions', FETCHING_IN_PLANE)[0].header.stamp.sec for _ in range(5)
    ]
    client.wait(lambda: set(stamps) <= set(drawn), 'drawings of all')


def test_markers_of_the_same_arm_are_replaced_and_those_of_another_deleted(make_node):
    """The estimator describes the arm anew whenever another hypothesis is the most probable."""
    node, actions = make_node('drawing'), []
    node.create_subscription(
        MarkerArray, 'markers', lambda message: actions.append(message.markers[0].action), 100
    )
    output = Output(node, MarkerArray, 'markers', QoSProfile(depth=100))
    markers = MarkerPublisher(node, output)

    def draw(config):
        solver, arm = config.solver(compiled=None), config.arm
        markers.describe(MarkersWriter(arm, solver.grid.s, 'arm_base', widen=False), 0.0, arm)
        actions.clear()
        markers.publish(solver.solve(FETCHING_IN_PLANE), Stamp(1, 0))
        spin_until(node.executor, lambda: actions and actions[-1] == Marker.ADD)
        return list(actions)

    spin_until(node.executor, lambda: output.is_heard)
    assert draw(CONFIG) == [Marker.DELETEALL, Marker.ADD]
    assert draw(CONFIG) == [Marker.ADD]
    assert draw(load_config(CONFIG_FILE)) == [Marker.DELETEALL, Marker.ADD]
