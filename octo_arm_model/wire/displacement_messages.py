"""Displacements of winches as messages carry them: a sensor_msgs/JointState, by name.

Not a row of `TENSION_TOPICS`: these are lengths, and of as many tendons as are driven by length.
"""

from __future__ import annotations

from typing import Any

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import TensionError
from octo_arm_model.rod.displacements import check_displacements
from octo_arm_model.wire.tension_fields import values_by_name

DISPLACEMENTS = 'tendon_displacements'
DISPLACEMENT_TYPE = 'sensor_msgs/msg/JointState'


def read_displacements(message: Any, arm: Arm) -> dict[str, float]:
    """Length reeled in by tendon name [m], the positions of a JointState ``message``.

    Raises:
        TensionError: if names are unknown or repeated, lengths differ, or a position is not
            finite.
    """
    count, tendons = len(message.name), len(arm.tendons)
    if count > tendons:
        raise TensionError(f'{count} displacements, this arm has {tendons} tendons')
    given = values_by_name(message.name, message.position, 'position')
    found = {name: float(position) for name, position in given.items()}
    check_displacements(arm, found, {})
    return found
