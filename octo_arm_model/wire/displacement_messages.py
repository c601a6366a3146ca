"""Displacements of winches as messages carry them: a sensor_msgs/JointState, by name.

Not a row of `TENSION_TOPICS`: these are lengths, and of as many tendons as are driven by length.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from octo_arm_model.analysis.displacement import check_displacements
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.errors import TensionError
from octo_arm_model.core.limits import MAX_NAME

TOPIC = 'tendon_displacements'
TYPE_NAME = 'sensor_msgs/msg/JointState'


def read_displacements(message: Any, arm: Arm) -> dict[str, float]:
    """Length reeled in by tendon name [m], the positions of a JointState ``message``.

    Raises:
        TensionError: if names are unknown or repeated, lengths differ, or a position is not
            finite.
    """
    names, positions = list(message.name), list(message.position)
    if len(names) != len(positions):
        raise TensionError(f'name has {len(names)} entries but position has {len(positions)}')
    if len(names) > len(arm.tendons):
        raise TensionError(f'{len(names)} displacements, this arm has {len(arm.tendons)} tendons')
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise TensionError(f'tendon named more than once: {repeated[0][:MAX_NAME]}')
    found = dict(zip(names, map(float, positions)))
    check_displacements(arm, found, {})
    return found
