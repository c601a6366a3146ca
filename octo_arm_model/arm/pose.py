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
    """A position [m] and an orientation in base_frame, a quaternion x, y, z, w, made of length 1.

    Errors name position and quaternion by ``names``.

    Raises:
        ConfigError: if a component is not finite or beyond `FARTHEST`, or the quaternion's length
            is not within 1e-3 of 1.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    names: InitVar[tuple[str, str]] = ('base.position', 'base.quaternion')

    def __post_init__(self, names: tuple[str, str]) -> None:
        position, quaternion = map(_numbers, names, (self.position, self.quaternion), (3, 4))
        norm = float(np.linalg.norm(quaternion))
        if abs(norm - 1.0) > 1e-3:
            raise ConfigError(
                f'{names[1]} is {shown(self.quaternion)} of length {norm:.6g}, expected x, y, '
                'z, w of length 1'
            )
        unit = (np.array(quaternion) / norm).tolist()
        set_fields(self, position=tuple(position), quaternion=tuple(unit))

    @property
    def rotation(self) -> Rotation:
        """The rotation from the posed frame to base_frame."""
        return Rotation.from_quat(np.array(self.quaternion))

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
