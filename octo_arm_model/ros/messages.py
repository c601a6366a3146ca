"""Conversion between ROS messages and the arrays of the core, in both directions."""

from __future__ import annotations

import importlib
import importlib.machinery
import re
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Wrench
from octo_arm_msgs.msg import TendonTensions
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, LoadError, MessageError, shown
from octo_arm_model.arm.hints import FloatArray

_TYPE = re.compile(r'([a-z]\w*)/msg/([A-Z]\w*)')


def decoded(data: bytes, kind: Any) -> Any:
    """The message of type ``kind`` that ``data`` is.

    Raises:
        MessageError: if it is none.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:
        # The middleware raises errors of several types for bytes that are no message.
        raise MessageError(f'{len(data)} bytes that are no {kind.__name__}') from error


def message_class(type_name: str) -> Any:
    """The class of a type of messages, such as 'sensor_msgs/msg/JointState'.

    Raises:
        ConfigError: if it is not installed.
    """
    match, found = _TYPE.fullmatch(type_name), None
    if match is not None and _has_messages(match[1]):
        module = importlib.import_module(f'{match[1]}.msg')
        found = getattr(module, match[2], None)
    if not hasattr(found, 'get_fields_and_field_types'):
        raise ConfigError(
            f'no messages of type {shown(type_name)} are installed, expected one such as '
            'sensor_msgs/msg/JointState'
        )
    return found


def _has_messages(package: str) -> bool:
    """Whether a Python ``package`` has a subpackage msg: nothing of it is run to know that."""
    spec = importlib.machinery.PathFinder.find_spec(package)
    folders = None if spec is None else spec.submodule_search_locations
    if folders is None:
        return False
    return importlib.machinery.PathFinder.find_spec(f'{package}.msg', folders) is not None


def wrench_values(message: Wrench) -> FloatArray:
    """Force and moment (6,) [N, N m].

    Raises:
        LoadError: if a component is not finite.
    """
    force, torque = message.force, message.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    if not np.isfinite(values).all():
        raise LoadError(f'tip wrench is {values.tolist()}, expected finite numbers [N, N m]')
    return values


def tensions_message(tensions: FloatArray, arm: Arm, stamp: Time, frame_id: str) -> TendonTensions:
    """Tensions [N] of all tendons by name."""
    header = Header(stamp=stamp, frame_id=frame_id)
    return TendonTensions(header=header, name=list(arm.tendon_names), tension=tensions.ravel())


def pose_message(position: FloatArray, quaternion: FloatArray) -> Pose:
    """One pose from position [m] and quaternion x, y, z, w."""
    x, y, z = position.tolist()
    qx, qy, qz, qw = quaternion.tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
