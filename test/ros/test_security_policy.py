"""The SROS 2 policy grants what the nodes have, no more and no less, seen in the live graph."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from xml.etree import ElementTree

import pytest
from checkout import ROOT

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from rclpy.node import Node

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient
from octo_arm_model.ros.estimator.lifecycle import ManagedEstimatorNode
from octo_arm_model.ros.estimator.main import EstimatorNode
from octo_arm_model.ros.node.lifecycle import ManagedOctoArmNode
from octo_arm_model.ros.node.main import OctoArmNode
from octo_arm_model.ros.simulator.main import SimulatorNode

POLICY = ROOT / 'config' / 'sros2' / 'octo_arm_policy.xml'
ENCLAVES = ('octo_arm', 'octo_arm_estimator', 'octo_arm_sim', 'octo_arm_viewer')
KINDS = ('publish', 'subscribe', 'reply', 'request')
Names = dict[str, set[str]]


def granted(text: str, enclave: str) -> tuple[str, str, Names]:
    """Namespace, node and full names of what a policy allows in ``enclave``."""
    root = ElementTree.fromstring(text)
    (profile,) = root.findall(f"./enclaves/enclave[@path='{enclave}']/profiles/profile")
    namespace, node = profile.attrib['ns'].rstrip('/'), profile.attrib['node']
    names: Names = {kind: set() for kind in KINDS}
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


def nodes_of(enclave: str, namespace: str, context: object) -> list[Node]:
    """Every node that runs in an enclave, as busy as it gets."""
    arguments = ['--ros-args', '--params-file', str(preset_path('renda2012_table4'))]
    arguments += ['-p', 'use_sim_time:=true', '-p', 'start_type_description_service:=true']
    options = {
        'context': context,
        'namespace': namespace,
        'cli_args': arguments,
        'use_global_arguments': False,
    }
    if enclave == 'octo_arm':
        managed = ManagedOctoArmNode(**options)
        managed.on_configure(None)
        managed.on_activate(None)
        return [OctoArmNode(**options), managed]
    if enclave == 'octo_arm_estimator':
        managed = ManagedEstimatorNode(**options)
        managed.on_configure(None)
        managed.on_activate(None)
        plain = EstimatorNode(**options)
        for _ in range(2):  # of frames that are not there the second look is at all of /tf
            with contextlib.suppress(MeasurementError):
                plain._server._frames.pose_of('camera', 'arm_base', 0)
        return [plain, managed]
    if enclave == 'octo_arm_sim':
        return [SimulatorNode(**options)]
    viewer = Node(
        'octo_arm_viewer', automatically_declare_parameters_from_overrides=True, **options
    )
    ArmClient(viewer).listen({**POSES, **DETAILS})
    return [viewer]


@pytest.mark.parametrize('namespace', ['/', '/left', '/right/ground_truth'])
@pytest.mark.parametrize('enclave', ENCLAVES)
def test_the_policy_grants_what_the_nodes_have(
    enclave: str, namespace: str, context: object
) -> None:
    text, path = POLICY.read_text(), f'/{enclave}'
    if namespace != '/':
        # What the README says to do.
        text = text.replace('ns="/"', f'ns="{namespace}"').replace(
            'path="/', f'path="{namespace}/'
        )
        path = namespace + path
    where, name, allowed = granted(text, path)
    nodes = nodes_of(enclave, namespace, context)
    found: Names = {kind: set() for kind in KINDS}
    for node in nodes:
        assert (node.get_namespace(), node.get_name()) == (where, name)
        for kind, names in seen(node).items():
            found[kind] |= names
    if '/tf' not in found['publish']:  # Where tf2_msgs is not installed.
        for names in allowed.values():
            names -= {'/tf', '/tf_static'}
    assert found == allowed
    for node in nodes:
        node.destroy_node()


def test_every_enclave_is_tested() -> None:
    paths = {found.attrib['path'] for found in ElementTree.parse(POLICY).iter('enclave')}
    assert paths == {f'/{enclave}' for enclave in ENCLAVES}
