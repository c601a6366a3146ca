"""Settings of the middleware: policies, security, and what remains of a client."""

import contextlib
import importlib.util
import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import pytest
from checkout import ROOT
from rclpy.duration import Duration
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from octo_arm_model import ConfigError
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client.client import COMMANDS, DETAILS, POSES, ArmClient
from octo_arm_model.ros.estimator.main import EstimatorNode, ManagedEstimatorNode
from octo_arm_model.ros.node.main import ManagedOctoArmNode, OctoArmNode
from octo_arm_model.ros.node.sensor_frames import SensorFrames
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.ros.topics import POLICIES, create_subscription

MANUAL = ROOT / 'docs' / 'node.md'
CONFIG_FILE = preset_path('renda2012_table4')
NODES = {
    'octo_arm': (OctoArmNode, ManagedOctoArmNode),
    'octo_arm_estimator': (EstimatorNode, ManagedEstimatorNode),
    'octo_arm_sim': (SimulatorNode,),
}
KINDS = OctoArmNode, ManagedOctoArmNode, SimulatorNode
# Of rclpy itself.
OTHERS = {'/rosout', '/parameter_events', '/clock', '/octo_arm/transition_event'}
# None of them is what any topic has by default.
WANTED = {
    'history': ('keep_last', HistoryPolicy.KEEP_LAST),
    'depth': (7, 7),
    'durability': ('transient_local', DurabilityPolicy.TRANSIENT_LOCAL),
    'deadline': (3 * 10**9, Duration(seconds=3)),
    'lifespan': (4 * 10**9, Duration(seconds=4)),
    'liveliness': ('manual_by_topic', LivelinessPolicy.MANUAL_BY_TOPIC),
    'liveliness_lease_duration': (5 * 10**9, Duration(seconds=5)),
}


def make(kind: Any, context: object, *overrides: str, namespace: str = '') -> Node:
    """A node, active, with parameters overridden."""
    given = ['--ros-args', '--params-file', str(CONFIG_FILE)]
    given += [word for override in overrides for word in ('-p', override)]
    options = {'context': context, 'namespace': namespace, 'use_global_arguments': False}
    node = kind(cli_args=given, **options)
    if kind in (ManagedOctoArmNode, ManagedEstimatorNode):
        for transition in (node.on_configure, node.on_activate):
            if transition(None) != TransitionCallbackReturn.SUCCESS:
                raise ConfigError('refused, and the reason is in the log')
    return node


def entities(node: Node) -> dict[tuple[str, str], object]:
    """Publishers and subscriptions by kind and topic."""
    found = {('publisher', publisher.topic_name): publisher for publisher in node.publishers}
    for subscription in node.subscriptions:
        found['subscription', subscription.topic_name] = subscription
    return {key: entity for key, entity in found.items() if key[1] not in OTHERS}


@pytest.mark.parametrize('kind', KINDS)
def test_every_policy_of_every_topic_is_overridden(kind, context):
    plain = make(kind, context)
    topics = entities(plain)
    before = {key: entity.qos_profile for key, entity in topics.items()}
    plain.destroy_node()
    overrides, expected = [], {}
    for number, (key, qos) in enumerate(before.items()):
        for policy, (text, value) in WANTED.items():
            if (key[0], policy) != ('subscription', 'lifespan'):
                overrides.append(f'qos_overrides.{key[1]}.{key[0]}.{policy}:={text}')
                expected[(*key, policy)] = value
        # Each another depth, so that none takes that of another; what comes last counts.
        expected[(*key, 'depth')] = 10 + number
        overrides.append(f'qos_overrides.{key[1]}.{key[0]}.depth:={10 + number}')
        is_reliable = qos.reliability == ReliabilityPolicy.RELIABLE
        other = ReliabilityPolicy.BEST_EFFORT if is_reliable else ReliabilityPolicy.RELIABLE
        expected[(*key, 'reliability')] = other
        overrides.append(f'qos_overrides.{key[1]}.{key[0]}.reliability:={other.name.lower()}')
    node = make(kind, context, *overrides)
    found = {
        (*key, policy): getattr(entity.qos_profile, policy)
        for key, entity in entities(node).items()
        for policy in [*WANTED, 'reliability']
        if (*key, policy) in expected
    }
    assert found == expected
    # And what others see of it.
    if kind != SimulatorNode:
        (seen,) = node.get_publishers_info_by_topic('/tip_pose')
        assert seen.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert seen.qos_profile.deadline == Duration(seconds=3)
    node.destroy_node()


def test_overrides_are_parameters_that_cannot_change_later(context):
    node = make(OctoArmNode, context, 'qos_overrides./strains.publisher.depth:=77')
    names = {name for name in node.get_parameters_by_prefix('') if name.startswith('qos_')}
    assert {name.rpartition('.')[2] for name in names} == {p.name.lower() for p in POLICIES}
    for name in names:
        assert node.describe_parameter(name).read_only
    node.destroy_node()


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(
    ('override', 'reason'),
    [
        ('/{}.publisher.durabilty:=volatile', 'durabilty overrides nothing'),
        ('/{}.subscription.depth:=5', 'depth overrides nothing'),
        ('{}.publisher.depth:=5', 'depth overrides nothing'),
        ('/{}.publisher.reliability:=surely', 'surely'),
        ('/{}.publisher.depth:=many', 'depth'),
        ('/tf.subscription.depth:=-1', 'depth'),
        ('/{}.publisher.depth:=-1', 'depth is -1, expected 0 to 100000'),
        ('/{}.publisher.depth:=100001', 'depth is 100001, expected 0 to 100000'),
        ('/{}.publisher.deadline:=-1', 'deadline is -1, expected nanoseconds >= 0'),
    ],
)
def test_overrides_that_cannot_be_are_refused(kind, override, reason, context):
    topic = 'ground_truth/tendon_tensions' if kind == SimulatorNode else 'strains'
    with pytest.raises(ConfigError) as error:
        make(kind, context, 'qos_overrides.' + override.format(topic))
    assert kind == ManagedOctoArmNode or re.search(re.escape(reason), str(error.value))
    assert '\n' not in str(error.value)


def test_a_topic_of_another_type_is_no_matter_of_overrides(make_node):
    node, reason = make_node('listener'), '^subscription to heard: Failed to create'
    node.create_subscription(String, 'heard', print, 10)
    with pytest.raises(ConfigError, match=reason) as error:
        create_subscription(node, JointState, 'heard', print, QoSProfile(depth=1))
    assert 'qos_overrides' not in str(error.value)


def test_the_manual_names_every_topic(context):
    node = make(OctoArmNode, context)
    text = MANUAL.read_text().split('## Services')[0]
    named = set(re.findall(r'^\| `([a-z0-9_/]+)` \|', text, re.MULTILINE))
    found = {key[1] for key in entities(node)}
    # Without tf2_msgs there are no frames; any type of messages is heard if it is named.
    absent = {'/tf', '/tendon_tensions/field', '/tendon_displacements/field'}
    assert {'/' + name.lstrip('/') for name in named} - absent == found - absent
    node.destroy_node()


POLICY = ROOT / 'config' / 'sros2' / 'octo_arm_policy.xml'
ENCLAVES = (*NODES, 'octo_arm_viewer')
ENDS = ('publish', 'subscribe', 'reply', 'request')
Names = dict[str, set[str]]


def granted(text: str, enclave: str) -> tuple[str, str, Names]:
    """Namespace, node and full names of what a policy allows in ``enclave``."""
    root = ElementTree.fromstring(text)
    (profile,) = root.findall(f"./enclaves/enclave[@path='{enclave}']/profiles/profile")
    namespace, node = profile.attrib['ns'].rstrip('/'), profile.attrib['node']
    names: Names = {kind: set() for kind in ENDS}
    for rule in profile:
        for kind, qualifier in rule.attrib.items():
            assert qualifier == 'ALLOW'
            for entry in rule:
                name = str(entry.text).replace('~', f'{namespace}/{node}')
                assert name not in names[kind], f'{name} stands there twice'
                names[kind].add(name if name.startswith('/') else f'{namespace}/{name}')
    return profile.attrib['ns'], node, names


def seen(node: Node) -> Names:
    """Full names of what ``node`` has in the graph."""
    graph: dict[str, Callable[[str, str], list[tuple[str, list[str]]]]] = {
        'publish': node.get_publisher_names_and_types_by_node,
        'subscribe': node.get_subscriber_names_and_types_by_node,
        'reply': node.get_service_names_and_types_by_node,
        'request': node.get_client_names_and_types_by_node,
    }
    names = node.get_name(), node.get_namespace()
    return {kind: {name for name, _ in look(*names)} for kind, look in graph.items()}


def look_for_a_frame(frames: SensorFrames) -> None:
    """Of one that is not there the second look is at all of /tf."""
    for _ in range(2):
        with contextlib.suppress(MeasurementError):
            frames.pose_of('camera', 'arm_base', 0)


def nodes_of(enclave: str, namespace: str, context: object) -> list[Node]:
    """Every node that runs in an enclave, as busy as it gets."""
    own = ['use_sim_time:=true', 'start_type_description_service:=true']
    own += ['publish_clock:=true'] * (enclave == 'octo_arm_sim')
    if enclave in NODES:
        nodes = [make(kind, context, *own, namespace=namespace) for kind in NODES[enclave]]
        if enclave != 'octo_arm_sim':
            look_for_a_frame(nodes[0]._server._frames)
        return nodes
    given = ['--ros-args', *(word for one in own for word in ('-p', one))]
    viewer = Node(
        enclave,
        context=context,
        namespace=namespace,
        cli_args=given,
        use_global_arguments=False,
        automatically_declare_parameters_from_overrides=True,
    )
    client = ArmClient(viewer)
    client.listen({**COMMANDS, **POSES, **DETAILS})
    assert client.simulator is not None  # as its page uses it
    return [viewer]


@pytest.mark.parametrize('namespace', ['/', '/left', '/right/ground_truth'])
@pytest.mark.parametrize('enclave', ENCLAVES)
def test_the_policy_grants_what_the_nodes_have(enclave, namespace, context):
    text, path = POLICY.read_text(), f'/{enclave}'
    if namespace != '/':
        # What the README says to do.
        text = text.replace('ns="/"', f'ns="{namespace}"').replace(
            'path="/', f'path="{namespace}/'
        )
        path = namespace + path
    where, name, allowed = granted(text, path)
    nodes = nodes_of(enclave, namespace, context)
    found: Names = {kind: set() for kind in ENDS}
    for node in nodes:
        assert (node.get_namespace(), node.get_name()) == (where, name)
        for kind, names in seen(node).items():
            found[kind] |= names
    if '/tf' not in found['publish']:  # Where tf2_msgs is not installed.
        for names in allowed.values():
            names -= {'/tf', '/tf_static'}
    if importlib.util.find_spec('simulation_interfaces') is None:
        allowed['reply'] = {name for name in allowed['reply'] if 'simulat' not in name}
    assert found == allowed
    for node in nodes:
        node.destroy_node()


def test_every_enclave_is_tested():
    paths = {found.attrib['path'] for found in ElementTree.parse(POLICY).iter('enclave')}
    assert paths == {f'/{enclave}' for enclave in ENCLAVES}
