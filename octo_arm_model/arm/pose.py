"""Where a base or a sensor is: position and orientation, checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.validation import real_numbers, set_fields

FARTHEST = 1e9  # [m] of a base from its frame: positions are then rounded to 1e-7 m


@dataclass(frozen=True)
class Pose:
    """Position [m] and orientation in the base frame, a quaternion x, y, z, w made unit.

    Raises:
        ConfigError: if a component is not finite or beyond `FARTHEST`, or the quaternion's length
            is not within 1e-3 of 1.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        position = _numbers('base.position', self.position, 3)
        quaternion = _unit('base.quaternion', self.quaternion)
        set_fields(self, position=tuple(position), quaternion=tuple(quaternion))

    @classmethod
    def called(
        cls,
        position_name: str,
        quaternion_name: str,
        position: tuple[float, float, float],
        quaternion: tuple[float, float, float, float],
    ) -> Pose:
        """A pose whose ``position`` and ``quaternion`` have other names in errors.

        Raises:
            ConfigError: as of a `Pose`.
        """
        _numbers(position_name, position, 3)
        _unit(quaternion_name, quaternion)
        return cls(position, quaternion)


def _numbers(name: str, values: object, size: int) -> list[float]:
    array = real_numbers(values)
    if array is None or array.shape != (size,) or not (np.abs(array) <= FARTHEST).all():
        raise ConfigError(
            f'{name} is {shown(values)}, expected {size} finite numbers of at most {FARTHEST:g}'
        )
    return array.tolist()


def _unit(name: str, values: object) -> list[float]:
    numbers = _numbers(name, values, 4)
    norm = float(np.linalg.norm(numbers))
    if abs(norm - 1.0) > 1e-3:
        raise ConfigError(
            f'{name} is {shown(values)} of length {norm:.6g}, expected x, y, z, w of length 1'
        )
    return [number / norm for number in numbers]
