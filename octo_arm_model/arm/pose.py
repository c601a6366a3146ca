"""The pose of a base, a sensor or a camera: position and orientation, checked."""

from __future__ import annotations

from dataclasses import InitVar, dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import real_numbers, set_fields

FARTHEST = 1e9  # largest coordinate of a base [m]: positions are then rounded to 1e-7 m


@dataclass(frozen=True)
class Pose:
    """A position [m] and an orientation in base_frame, a quaternion x, y, z, w of length 1.

    The quaternion is normalised. Errors name position and quaternion by ``names``.

    Raises:
        ConfigError: if a component is not finite or beyond `FARTHEST`, or the quaternion's length
            is not within 1e-3 of 1.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    names: InitVar[tuple[str, str]] = ('base.position', 'base.quaternion')

    def __post_init__(self, names: tuple[str, str]) -> None:
        position = tuple(_numbers(names[0], self.position, 3))
        set_fields(self, position=position, quaternion=tuple(_unit(names[1], self.quaternion)))

    @classmethod
    def turned(cls, turn: FloatArray, position: FloatArray) -> Pose:
        """Return the pose with this rotation vector (3,) [rad] and ``position`` (3,) [m]."""
        return cls(tuple(position), tuple(Rotation.from_rotvec(turn).as_quat()))

    @property
    def rotation(self) -> Rotation:
        """The rotation from the posed frame to base_frame."""
        return Rotation.from_quat(np.array(self.quaternion))

    @property
    def turn(self) -> FloatArray:
        """The rotation vector [rad], (3,)."""
        return self.rotation.as_rotvec()

    def to_base(self, points: FloatArray) -> FloatArray:
        """Transform ``points`` (n, 3) or (3,) [m] from the posed frame to base_frame."""
        return self.rotation.apply(points) + self.position

    def from_base(self, points: FloatArray) -> FloatArray:
        """Transform ``points`` (n, 3) or (3,) [m] from base_frame to the posed frame."""
        return self.rotation.apply(points - np.array(self.position), inverse=True)


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
