"""Where a base or a sensor is: position and orientation, checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import real_numbers

FARTHEST = 1e9  # [m] of a base from its frame: positions are then rounded to 1e-7 m


@dataclass(frozen=True)
class Pose:
    """Position [m] and orientation (quaternion x, y, z, w) in the base frame.

    Raises:
        ConfigError: if a component is not finite or beyond `FARTHEST`, or the quaternion not of
            unit length.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Validate, and make the quaternion unit to rounding."""
        array = _numbers('base.position', self.position, 3)
        object.__setattr__(self, 'position', tuple(array.tolist()))
        array = _unit('base.quaternion', self.quaternion)
        object.__setattr__(self, 'quaternion', tuple(array.tolist()))

    @classmethod
    def called(
        cls,
        position_name: str,
        quaternion_name: str,
        position: tuple[float, float, float],
        quaternion: tuple[float, float, float, float],
    ) -> Pose:
        """Of a ``position`` and a ``quaternion`` that errors call by these names.

        Raises:
            ConfigError: as of a `Pose`.
        """
        try:
            return cls(position, quaternion)
        except ConfigError:
            _numbers(position_name, position, 3)
            _unit(quaternion_name, quaternion)
            raise


def _numbers(name: str, values: object, size: int) -> FloatArray:
    """The ``values`` of what errors call ``name``, (size,)."""
    array = real_numbers(values)
    if array is None or array.shape != (size,) or not (np.abs(array) <= FARTHEST).all():
        raise ConfigError(
            f'{name} is {shown(values)}, expected {size} finite numbers of at most {FARTHEST:g}'
        )
    return array


def _unit(name: str, values: object) -> FloatArray:
    """The quaternion ``values`` of what errors call ``name``, of length 1 to rounding, (4,)."""
    array = _numbers(name, values, 4)
    norm = float(np.linalg.norm(array))
    if abs(norm - 1.0) > 1e-3:
        raise ConfigError(
            f'{name} is {shown(values)} of length {norm:.6g}, expected x, y, z, w of length 1'
        )
    return np.asarray(array / norm)
