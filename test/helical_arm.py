"""A cone with two sections of tendons that wind around it and converge towards the tip."""

from typing import Any

import numpy as np

from octo_arm_model import Arm, Body, Material, Section

RUBBER = Material(1.1e5, 0.45, 1080.0)
CONE = Body(0.4, 0.015, 0.006)
HELICES = (
    Section(0.4, 0.008, 0.004, angles=(0.3, 2.0, 4.0), twist=(3.0, -5.0, 1.0)),
    Section(0.25, 0.01, 0.007, angles=(0.0, 1.5, 3.0), twist=(0.0, 4.0, 4.0)),
)


def helical_arm(material: Material = RUBBER, **given: Any) -> Arm:
    """Six tendons in two sections, with the other fields of `Arm` as ``given``."""
    return Arm(material, CONE, HELICES, **given)


HELICAL = helical_arm()
# Tensions that bend it far [N].
PULL = np.array([[0.3, 0.6, 0.1], [1.0, 0.4, 1.5]])
