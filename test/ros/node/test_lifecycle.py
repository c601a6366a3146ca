"""The managed node, over DDS."""

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from live_nodes import NO_TRANSITION, assert_is_backbone, file_with, hosting, running

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.estimator.lifecycle import ManagedEstimatorNode
from octo_arm_model.ros.node.lifecycle import ManagedOctoArmNode


@pytest.fixture(scope='module')
def managed():
    """Client of a managed node that every test leaves unconfigured."""
    with hosting(ManagedOctoArmNode, node='managed') as client:
        yield client


def test_a_managed_node_answers_while_it_is_active():
    with running('ros.node.lifecycle') as client:
        answers_while_it_is_active(client)


def answers_while_it_is_active(managed):
    assert managed.transition(Transition.TRANSITION_CONFIGURE)
    managed.wait(lambda: managed.node.count_publishers('backbone/path') == 1, 'a configured node')
    assert managed.node.count_subscribers('tendon_tensions') == 0
    for _ in range(2):
        assert managed.transition(Transition.TRANSITION_ACTIVATE)
        managed.connect()
        assert_is_backbone(managed.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
        assert managed.transition(Transition.TRANSITION_DEACTIVATE)
        managed.wait(
            lambda: managed.node.count_subscribers('tendon_tensions') == 0, 'an inactive node'
        )
    assert managed.transition(Transition.TRANSITION_CLEANUP)
    managed.wait(
        lambda: managed.node.count_publishers('backbone/path') == 0, 'a node without publishers'
    )


def test_a_managed_node_that_does_not_answer_says_so(managed):
    assert managed.change(diagnostics__silence_limit=1e6) == (True, '')

    def says(words, level=DiagnosticStatus.WARN):
        parts = managed.diagnostics[-1].status if managed.diagnostics else []
        return len(parts) == 3 and all((p.message, p.level) == (words, level) for p in parts)

    managed.wait(lambda: says('unconfigured'), 'the diagnosis of an unconfigured node')
    assert managed.transition(Transition.TRANSITION_CONFIGURE)
    managed.wait(lambda: says('inactive'), 'the diagnosis of an inactive node')
    assert managed.transition(Transition.TRANSITION_ACTIVATE)
    managed.wait(lambda: says('waiting', DiagnosticStatus.OK), 'the diagnosis of an active node')
    assert managed.transition(Transition.TRANSITION_DEACTIVATE)
    managed.wait(lambda: says('inactive'), 'the diagnosis of an inactive node')
    assert managed.transition(Transition.TRANSITION_CLEANUP)
    managed.wait(lambda: says('unconfigured'), 'the diagnosis of an unconfigured node')


def test_a_managed_node_that_cannot_be_configured_says_why_and_stays(tmp_path):
    files = [file_with(tmp_path, 'length: 0.45', 'length: 0.1')]
    with hosting(ManagedOctoArmNode, files=files) as client:
        assert not client.transition(Transition.TRANSITION_CONFIGURE)
        assert client.change(body__length=0.45) == (True, '')
        client.log('not configured: sections[1].anchorage is 0.45')
        assert client.transition(Transition.TRANSITION_CONFIGURE)


def test_a_managed_node_refuses_a_transition_that_is_none_and_goes_on(managed):
    for impossible in (Transition.TRANSITION_ACTIVATE, NO_TRANSITION):
        assert not managed.transition(impossible)
    assert managed.transition(Transition.TRANSITION_CONFIGURE)
    assert managed.transition(Transition.TRANSITION_CLEANUP)


def test_a_managed_node_that_cannot_publish_leaves_no_publisher_behind():
    for name, make_node, topic in (
        ('octo_arm', ManagedOctoArmNode, 'markers'),
        ('octo_arm_estimator', ManagedEstimatorNode, 'tension_bias'),
    ):
        given = '-p', f'qos_overrides./{topic}.publisher.depth:=-5'
        with hosting(make_node, *given, node=name) as client:
            for _ in range(2):
                assert not client.transition(Transition.TRANSITION_CONFIGURE)
                client.log('not configured: qos_overrides')
                client.wait(
                    lambda client=client: client.node.count_publishers('backbone/path') == 0,
                    'a node without publishers',
                )


def test_a_managed_node_that_cannot_subscribe_leaves_no_subscription_behind():
    for name, make_node, topic, first in (
        ('octo_arm', ManagedOctoArmNode, 'tendon_tensions/joint_state', 'tendon_tensions'),
        (
            'octo_arm_estimator', ManagedEstimatorNode, 'measured/markers',
            'measured/tip_pose',
        ),
    ):  # fmt: skip
        given = '-p', f'qos_overrides./{topic}.subscription.depth:=-5'
        with hosting(make_node, *given, node=name) as client:
            assert client.transition(Transition.TRANSITION_CONFIGURE)
            for _ in range(2):
                assert not client.transition(Transition.TRANSITION_ACTIVATE)
                client.wait(
                    lambda client=client, first=first: client.node.count_subscribers(first) == 0,
                    'a node without subscriptions',
                )
