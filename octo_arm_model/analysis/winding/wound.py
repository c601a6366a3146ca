"""What solving for displacements of tendons gives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.winches import MET


@dataclass(frozen=True)
class Wound:
    """An arm with tendons of prescribed displacement.

    Attributes:
        backbone: its shape; ``backbone.tensions`` are the tensions of all tendons [N].
        displacement: length that the winch of each tendon has reeled in [m], of
            `Arm.tension_shape`; of a slack one, what would make it taut, more than was asked for.
        slack: names of tendons of prescribed displacement without tension, longer than their path.
        driven: whether the displacement of each tendon was prescribed, (tendons,).
    """

    backbone: Backbone
    displacement: FloatArray
    slack: tuple[str, ...]
    driven: NDArray[np.bool_] = field(repr=False)


def wound_of(
    arm: Arm, backbone: Backbone, displacement: FloatArray, wanted: FloatArray,
    driven: NDArray[np.bool_],
) -> Wound:  # fmt: skip
    """The ``backbone`` of ``arm`` whose ``displacement`` (J,) [m] was ``wanted`` where driven."""
    is_slack = (backbone.tensions.ravel() == 0.0) & driven
    is_slack &= displacement > np.where(driven, wanted, 0.0) + MET * arm.length
    names = tuple(arm.tendon_names[tendon] for tendon in np.flatnonzero(is_slack).tolist())
    return Wound(backbone, displacement.reshape(arm.tension_shape), names, driven)
