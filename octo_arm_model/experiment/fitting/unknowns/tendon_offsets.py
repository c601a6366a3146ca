"""Tendons moved away from the midline, in the parameters of an arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.tendon import Section


def move_tendons(
    values: Mapping[str, Any], arm: Arm, moved: Mapping[str, float]
) -> dict[str, Any]:
    """Parameters ``values`` of ``arm``, each tendon ``moved`` [m] away from the midline, by name.

    Sections have one distance for all their tendons, so the paths become tables.
    """
    new = dict(values)
    if not values.get('tendons.table_s'):
        # Linear in s; beyond their anchorages they have no effect.
        s = (0.0, arm.length)
        sections = [section for section in arm.sections if isinstance(section, Section)]
        offsets = [section.offset(s) for section in sections for _ in section.angles]
        turns = [
            angle + twist * np.array(s) / section.anchorage
            for section in sections
            for angle, twist in zip(section.angles, section.twist or len(section.angles) * (0.0,))
        ]
        for name in (
            'sections.offset_base', 'sections.offset_anchorage', 'tendons.angle', 'tendons.twist',
        ):  # fmt: skip
            new.pop(name, None)
        new['tendons.table_s'] = list(s)
        new['tendons.table_angle'] = np.concatenate(turns).tolist()
        rows = np.array(offsets)
    else:
        rows = np.array(values['tendons.table_offset']).reshape(len(arm.tendons), -1)
    farther = np.array([moved[name] for name in arm.tendon_names])[:, np.newaxis]
    new['tendons.table_offset'] = (rows + farther).ravel().tolist()
    return new
