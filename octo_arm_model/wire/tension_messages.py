"""Tensions as messages carry them, whichever library read the messages.

The node gets them from ROS and the bag tools from `rosbags`: other classes with the same fields.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import TensionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.limits import MAX_NAME

_LISTED = 20


def tensions_from_tendon_tensions(message: Any, arm: Arm) -> FloatArray:
    """Tensions [N], of `Arm.tension_shape`, of octo_arm_msgs/TendonTensions, matched by name.

    Raises:
        TensionError: if names are unknown, repeated or missing, or lengths differ.
    """
    return _by_name(message.name, message.tension, 'tension', arm)


def tensions_from_joint_state(message: Any, arm: Arm) -> FloatArray:
    """Tensions [N], of `Arm.tension_shape`, from the efforts, matched by name.

    Raises:
        TensionError: if names are unknown, repeated or missing, or lengths differ.
    """
    return _by_name(message.name, message.effort, 'effort', arm)


def tensions_from_array(message: Any, arm: Arm) -> FloatArray:
    """Tensions [N], of `Arm.tension_shape`, from a row-major array.

    The layout may be empty, flat or that shape.

    Raises:
        TensionError: if the length or the layout is another.
    """
    shape = arm.tension_shape
    count = len(arm.tendons)
    if len(message.data) != count:
        meaning = 'one for each tendon, section by section from the tip'
        if len(shape) == 2:
            meaning = f'{shape[0]} section(s) from the tip, {shape[1]} tendons each'
        raise TensionError(f'data has {len(message.data)} values, expected {count}: {meaning}')
    layout = tuple(dimension.size for dimension in message.layout.dim)
    if message.layout.data_offset != 0 or layout not in ((), (count,), shape):
        raise TensionError(
            f'layout is {layout} with data_offset {message.layout.data_offset}, expected an '
            f'empty one or {shape} with data_offset 0'
        )
    return np.array(message.data, dtype=np.float64).reshape(shape)


def _by_name(names: Sequence[str], values: Sequence[float], field: str, arm: Arm) -> FloatArray:
    if len(names) != len(values):
        raise TensionError(f'name has {len(names)} entries but {field} has {len(values)}')
    tension_of = dict(zip(names, values))
    if len(tension_of) < len(names):
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        raise TensionError(f'tendon named more than once: {_listed(repeated)}')
    known = set(arm.tendon_names)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise TensionError(
            f'unknown tendon {_listed(unknown)}; this arm has {_listed(arm.tendon_names)}'
        )
    missing = [name for name in arm.tendon_names if name not in tension_of]
    if missing:
        raise TensionError(f'no tension for tendon {_listed(missing)}')
    ordered = [tension_of[name] for name in arm.tendon_names]
    return np.array(ordered, dtype=np.float64).reshape(arm.tension_shape)


def _listed(names: Sequence[str]) -> str:
    """Names for a message, of many or long ones not all."""
    text = ', '.join(name[:MAX_NAME] for name in names[:_LISTED])
    return f'{text} and {len(names) - _LISTED} more' if len(names) > _LISTED else text


# Topics of tensions, with the type of their messages and how these are read.
READERS: dict[str, tuple[str, Callable[[Any, Arm], FloatArray]]] = {
    'tendon_tensions': ('octo_arm_msgs/msg/TendonTensions', tensions_from_tendon_tensions),
    'tendon_tensions/array': ('std_msgs/msg/Float64MultiArray', tensions_from_array),
    'tendon_tensions/joint_state': ('sensor_msgs/msg/JointState', tensions_from_joint_state),
}
