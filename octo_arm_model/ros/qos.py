"""Publishers and subscriptions whose QoS policies are parameters of their node."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

from octo_arm_model.arm.errors import ConfigError

# All of rclpy but avoid_ros_namespace_conventions, which would change the name of the topic.
POLICIES = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
    QoSPolicyKind.DEADLINE,
    QoSPolicyKind.LIFESPAN,
    QoSPolicyKind.LIVELINESS,
    QoSPolicyKind.LIVELINESS_LEASE_DURATION,
)
MAX_DEPTH = 100_000
_OVERRIDES = 'qos_overrides.'
# What rclpy raises for impossible values of a policy.
_REFUSALS = (InvalidQosOverridesError, ParameterException, RuntimeError, ValueError, OverflowError)


def create_publisher(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Publisher:
    """Publisher of ``node``, every policy of ``qos`` a parameter.

    Raises:
        ConfigError: if such a parameter has a value that its policy cannot have.
    """
    return _create(node, 'publisher', topic, qos, lambda *given, **options: (
        node.create_publisher(kind, *given, **options)
    ))  # fmt: skip


def create_subscription(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[[Any], None],
    qos: QoSProfile,
    *,
    raw: bool = False,
) -> Subscription:
    """Subscription of ``node``, every policy of ``qos`` a parameter but the publisher's lifespan.

    Raises:
        ConfigError: if such a parameter has a value that its policy cannot have.
    """
    return _create(node, 'subscription', topic, qos, lambda topic, qos, **options: (
        node.create_subscription(kind, topic, callback, qos, raw=raw, **options)
    ))  # fmt: skip


def is_overridden(node: Node, entity: str, topic: str) -> bool:
    """Whether a policy is given of an ``entity``, publisher or subscription, of ``topic``."""
    prefix = _prefix(node, entity, topic)
    return any(name.startswith(prefix) for name in node._parameter_overrides)


def check_overrides(node: Node) -> None:
    """Refuse overrides that no publisher or subscription of ``node`` uses.

    Raises:
        ConfigError: if there is one.
    """
    # Private in rclpy.
    for name in sorted(node._parameter_overrides):
        if name.startswith(_OVERRIDES) and not _is_read_only(node, name):
            raise ConfigError(
                f'{name} overrides nothing, expected qos_overrides.TOPIC.publisher.POLICY or '
                'qos_overrides.TOPIC.subscription.POLICY with the whole name of a topic of '
                f'{node.get_fully_qualified_name()}'
            )


def _create(
    node: Node, entity: str, topic: str, qos: QoSProfile, create: Callable[..., Any]
) -> Any:
    prefix = _prefix(node, entity, topic)
    for policy in POLICIES:
        # Declared by the node itself it would not be read-only: a later change would be accepted
        # and have no effect.
        name = prefix + policy.name.lower()
        if node.has_parameter(name) and not _is_read_only(node, name):
            node.undeclare_parameter(name)
    options = QoSOverridingOptions(POLICIES, callback=_check)
    try:
        # A copy: rclpy writes the overrides into the profile that it is given.
        return create(topic, copy.copy(qos), qos_overriding_options=options)
    except _REFUSALS as error:
        raise ConfigError(f'{prefix}*: {error}') from error


def _prefix(node: Node, entity: str, topic: str) -> str:
    """Prefix of the names of the parameters of an ``entity`` of ``topic``."""
    return f'{_OVERRIDES}{node.resolve_topic_name(topic)}.{entity}.'


def _is_read_only(node: Node, name: str) -> bool:
    return bool(node.has_parameter(name) and node.describe_parameter(name).read_only)


def _check(qos: QoSProfile) -> SetParametersResult:
    """Whether the depth and the durations are possible."""
    result = SetParametersResult(successful=False)
    for name in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        if (duration := getattr(qos, name).nanoseconds) < 0:
            result.reason = f'{name} is {duration}, expected nanoseconds >= 0'
            return result
    result.successful = 0 <= qos.depth <= MAX_DEPTH
    result.reason = f'depth is {qos.depth}, expected 0 to {MAX_DEPTH}'
    return result
