"""Publishers and subscriptions with QoS parameters, and conversion of messages and arrays."""

import contextlib
import copy
import importlib
import importlib.machinery
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Wrench
from octo_arm_msgs.msg import TendonTensions
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, LoadError, MessageError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.ros.work import end_if_interrupted

_TYPE = re.compile(r'([a-z]\w*)/msg/([A-Z]\w*)')


def decoded(data: bytes, kind: Any) -> Any:
    """Deserialise ``data`` as a message of type ``kind``; MessageError if that fails."""
    try:
        return deserialize_message(data, kind)
    except Exception as error:
        # For bytes that are not a message the middleware raises errors of several types, and for
        # an exception by a signal as well.
        end_if_interrupted()
        raise MessageError(f'{len(data)} bytes that are no {kind.__name__}') from error


def take_all(subscription: Subscription, kind: Any) -> Iterator[tuple[bytes, dict[str, Any]]]:
    """Yield the serialised messages of type ``kind`` that have come, oldest first, and their info.

    A callback of the subscription is not called for these messages.
    """
    handle: Any = subscription.handle
    with handle:
        while (message := handle.take_message(kind, True)) is not None:
            yield message


def message_class(type_name: str) -> Any:
    """Return the class of messages such as sensor_msgs/msg/JointState; ConfigError for none."""
    match, message_type, finder = _TYPE.fullmatch(type_name), None, importlib.machinery.PathFinder
    package = finder.find_spec(match[1]) if match else None
    folders = package.submodule_search_locations if package else None
    # The specs are looked up first, so that no code of a package without messages is run.
    if match and folders is not None and finder.find_spec(f'{match[1]}.msg', folders):
        message_type = getattr(importlib.import_module(f'{match[1]}.msg'), match[2], None)
    if not hasattr(message_type, 'get_fields_and_field_types'):
        raise ConfigError(
            f'no messages of type {shown(type_name)} are installed, expected one such as '
            'sensor_msgs/msg/JointState'
        )
    return message_type


def wrench_values(message: Wrench) -> FloatArray:
    """Return force and moment (6,) [N, N m]; LoadError if a component is not finite."""
    force, torque = message.force, message.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    if not np.isfinite(values).all():
        raise LoadError(f'tip wrench is {values.tolist()}, expected finite numbers [N, N m]')
    return values


def tensions_message(tensions: FloatArray, arm: Arm, stamp: Time, frame_id: str) -> TendonTensions:
    """Return a message with the ``tensions`` [N] of all tendons by name."""
    header = Header(stamp=stamp, frame_id=frame_id)
    return TendonTensions(header=header, name=list(arm.tendon_names), tension=tensions.ravel())


def pose_message(position: FloatArray, quaternion: FloatArray) -> Pose:
    """Return the pose message of a position (3,) [m] and a quaternion x, y, z, w."""
    x, y, z = position.tolist()
    qx, qy, qz, qw = quaternion.tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


# All policies of rclpy but avoid_ros_namespace_conventions, which changes the name of the topic.
_NO_POLICIES = QoSPolicyKind.INVALID, QoSPolicyKind.AVOID_ROS_NAMESPACE_CONVENTIONS
POLICIES = tuple(policy for policy in QoSPolicyKind if policy not in _NO_POLICIES)
MAX_DEPTH = 100_000
_OVERRIDES = 'qos_overrides.'
# rclpy raises these for impossible values of a policy.
_REFUSALS = (InvalidQosOverridesError, ParameterException, RuntimeError, ValueError, OverflowError)


def create_publisher(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Publisher:
    """Create a publisher of ``node``; every policy of ``qos`` is a parameter of the node.

    ConfigError if it cannot be created, as with a value that a policy cannot have.
    """
    with _overriding(node, 'publisher', topic) as options:
        # The profile is copied because rclpy writes the overrides into it.
        return node.create_publisher(kind, topic, copy.copy(qos), qos_overriding_options=options)


def create_subscription(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[[Any], None],
    qos: QoSProfile,
    *,
    raw: bool = False,
) -> Subscription:
    """Create a subscription of ``node``; every policy of ``qos`` but lifespan is a parameter.

    ConfigError if it cannot be created, as with a value that a policy cannot have.
    """
    with _overriding(node, 'subscription', topic) as options:
        return node.create_subscription(
            kind, topic, callback, copy.copy(qos), raw=raw, qos_overriding_options=options
        )


def is_overridden(node: Node, entity: str, topic: str) -> bool:
    """Whether a parameter overrides a policy of ``entity``, publisher or subscription."""
    prefix = _prefix(node, entity, topic)
    return any(name.startswith(prefix) for name in node._parameter_overrides)


def check_overrides(node: Node) -> None:
    """Raise ConfigError unless some entity of ``node`` uses each QoS override."""
    # This attribute is private in rclpy, which declares the overrides that it uses.
    for name in sorted(node._parameter_overrides):
        if name.startswith(_OVERRIDES) and not node.has_parameter(name):
            raise ConfigError(
                f'{name} overrides nothing, expected qos_overrides.TOPIC.publisher.POLICY or '
                'qos_overrides.TOPIC.subscription.POLICY with the whole name of a topic of '
                f'{node.get_fully_qualified_name()}'
            )


@contextlib.contextmanager
def _overriding(node: Node, entity: str, topic: str) -> Iterator[QoSOverridingOptions]:
    """Yield the options to create an ``entity`` of ``topic``; ConfigError if rclpy refuses."""
    try:
        yield QoSOverridingOptions(POLICIES, callback=_check)
    except _REFUSALS as error:
        is_by_override = is_overridden(node, entity, topic)
        what = f'{_prefix(node, entity, topic)}*' if is_by_override else f'{entity} to {topic}'
        raise ConfigError(f'{what}: {error}') from error


def _prefix(node: Node, entity: str, topic: str) -> str:
    return f'{_OVERRIDES}{node.resolve_topic_name(topic)}.{entity}.'


def _check(qos: QoSProfile) -> SetParametersResult:
    result = SetParametersResult(successful=False)
    for name in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        if (duration := getattr(qos, name).nanoseconds) < 0:
            result.reason = f'{name} is {duration}, expected nanoseconds >= 0'
            return result
    result.successful = 0 <= qos.depth <= MAX_DEPTH
    result.reason = f'depth is {qos.depth}, expected 0 to {MAX_DEPTH}'
    return result
