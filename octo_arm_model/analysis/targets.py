"""The targets of the inverse: errors of a shape, and their derivatives by the tensions.

Errors are in metres; angles are multiplied by `length_per_radian`.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import TargetError, shown
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.validation import real_numbers, set_fields
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import left_jacobian
from octo_arm_model.rod.sensitivity import Change, Sensitivity
from octo_arm_model.rod.stations import nearest

_LARGEST = 1e9  # largest number of a target; squares of larger ones may overflow
# Below this sine of their angle the axis from one tangent to an opposite one is unknown.
_NO_DIRECTION = 1e-4


@runtime_checkable
class Target(Protocol):
    """A target: an error that is zero if the target is reached."""

    def error(self, backbone: Backbone) -> FloatArray:
        """Return the error of ``backbone``, (m,) [m]."""

    def jacobian(self, backbone: Backbone, change: Change) -> FloatArray:
        """Return the derivative of `error` by the quantities of ``change``, (m, quantities)."""


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    numbers = real_numbers(value)
    array = np.array(np.nan if numbers is None else numbers)
    fits = array.ndim == len(shape) and all(
        fixed in (-1, size) for size, fixed in zip(array.shape, shape)
    )
    if not fits or not array.size or not (np.abs(array) <= _LARGEST).all():
        counts = ' x '.join('n' if size < 0 else str(size) for size in shape)
        what = f'{counts} finite numbers, each' if counts else 'a finite number'
        raise TargetError(f'{name} is {shown(value)}, expected {what} of at most {_LARGEST:g}')
    return array


@dataclass(frozen=True)
class TipPosition:
    """A target position of the tip.

    Attributes:
        position: target position in base_frame [m], (3,).

    Raises:
        TargetError: if it is not three finite numbers.
    """

    position: FloatArray

    def __post_init__(self) -> None:
        """Check the values."""
        set_fields(self, position=_numbers('tip position', self.position, (3,)))

    def error(self, backbone: Backbone) -> FloatArray:
        """Return the position of the tip less that of the target, (3,) [m]."""
        return backbone.tip - self.position

    def jacobian(self, backbone: Backbone, change: Change) -> FloatArray:
        """Return the derivative of the position of the tip, (3, quantities)."""
        return change.tip[:3]


@dataclass(frozen=True)
class TipPose:
    """A target pose of the tip.

    Attributes:
        position: target position in base_frame [m], (3,).
        quaternion: target orientation x, y, z, w in base_frame; its x axis is the tangent.
        length_per_radian: weight of angles [m/rad].

    Raises:
        TargetError: if they are not finite numbers, or the quaternion not of unit length.
    """

    position: FloatArray
    quaternion: FloatArray
    length_per_radian: float = 0.1

    def __post_init__(self) -> None:
        """Check the values."""
        set_fields(self, position=_numbers('tip position', self.position, (3,)))
        _numbers('length_per_radian', self.length_per_radian, ())
        quaternion = _numbers('tip quaternion', self.quaternion, (4,))
        if abs(np.linalg.norm(quaternion) - 1.0) > 1e-3:
            raise TargetError(f'tip quaternion is {shown(self.quaternion)}, expected length 1')
        set_fields(self, quaternion=quaternion)

    def error(self, backbone: Backbone) -> FloatArray:
        """Return the difference of positions and the rotation vector from the target, (6,) [m]."""
        angle = self._away(backbone).as_rotvec()
        return np.concatenate([backbone.tip - self.position, self.length_per_radian * angle])

    def jacobian(self, backbone: Backbone, change: Change) -> FloatArray:
        """Return the derivative of the difference of positions and of the rotation vector."""
        # The left Jacobian is regular up to the angle pi, the largest of `as_rotvec`.
        turned = left_jacobian(self._away(backbone).as_rotvec())
        angle = np.linalg.solve(turned, change.tip[3:])
        return np.concatenate([change.tip[:3], self.length_per_radian * angle])

    def _away(self, backbone: Backbone) -> Rotation:
        tip = Rotation.from_quat(np.array(backbone.quaternion[-1]))
        return tip * Rotation.from_quat(self.quaternion).inv()


@dataclass(frozen=True)
class Bending:
    """A target angle between the tangents of tip and base, in a plane.

    Attributes:
        plane: angle of the plane about the tangent of the base [rad], from n towards b.
        angle: angle between the tangents in that plane [rad], 0 to pi.
        length_per_radian: weight of angles [m/rad].

    Raises:
        TargetError: if a value is not finite, or ``angle`` not from 0 to pi.
    """

    plane: float
    angle: float
    length_per_radian: float = 0.1

    def __post_init__(self) -> None:
        """Check the values."""
        _numbers('length_per_radian', self.length_per_radian, ())
        _numbers('bending plane', self.plane, ())
        if not 0.0 <= float(_numbers('bending angle', self.angle, ())) <= np.pi:
            raise TargetError(f'bending angle is {shown(self.angle)}, expected 0 to pi [rad]')

    def error(self, backbone: Backbone) -> FloatArray:
        """Return the angle from the target tangent to the tip's, about two axes, (2,) [m]."""
        tangent, target, across = self._directions(backbone)
        sine, direction = _polar(across @ np.cross(target, tangent))
        return self.length_per_radian * np.arctan2(sine, tangent @ target) * direction

    def jacobian(self, backbone: Backbone, change: Change) -> FloatArray:
        """Return the derivative of the angle by the rotation of the tip, (2, quantities)."""
        tangent, target, across = self._directions(backbone)
        turned = np.cross(change.tip[3:].T, tangent)
        cosine = float(tangent @ target)
        sine, direction = _polar(across @ np.cross(target, tangent))
        by_cosine, by_sine = turned @ target, across @ np.cross(target, turned).T
        along = direction @ by_sine
        # The angle changes along the direction, and the direction by what is across it.
        closer = np.outer(direction, cosine * along - sine * by_cosine)
        size = max(sine, _NO_DIRECTION)
        aside = (by_sine - np.outer(direction, along)) * np.arctan2(size, cosine) / size
        return self.length_per_radian * (closer + aside)

    def _directions(self, backbone: Backbone) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return tangents of tip and target, and two directions normal to the latter (2, 3)."""
        base = Rotation.from_quat(np.array(backbone.quaternion[0])).as_matrix()
        tip = Rotation.from_quat(np.array(backbone.quaternion[-1])).as_matrix()
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        out = np.array([0.0, np.cos(self.plane), np.sin(self.plane)])
        aside = np.array([0.0, -np.sin(self.plane), np.cos(self.plane)])
        target = np.array([cosine, 0.0, 0.0]) + sine * out
        across = np.stack([np.cross(target, aside), aside])
        return tip[:, 0], base @ target, across @ base.T


@dataclass(frozen=True)
class BackboneShape:
    """Target points of the midline, for example from a camera.

    Attributes:
        s: arc coordinates of the points [m], (n,); the nearest stations are compared.
        position: target positions in base_frame [m], (n, 3).

    Raises:
        TargetError: if a number is not finite, or there is not one point for each s.
    """

    s: FloatArray
    position: FloatArray

    def __post_init__(self) -> None:
        """Check the values."""
        s = _numbers('backbone s', self.s, (-1,))
        position = _numbers('backbone position', self.position, (-1, 3))
        if len(position) != len(s):
            raise TargetError(f'backbone position has {len(position)} points, expected {len(s)}')
        set_fields(self, s=s, position=position)

    def _stations(self, backbone: Backbone) -> IntArray:
        return nearest(self.s, backbone.s)

    def error(self, backbone: Backbone) -> FloatArray:
        """Return the scaled differences of points (3 n,) [m]; their norm is the rms distance."""
        differences = backbone.position[self._stations(backbone)] - self.position
        return differences.ravel() / np.sqrt(len(self.s))

    def jacobian(self, backbone: Backbone, change: Change) -> FloatArray:
        """Return the derivatives of the scaled points, (3 n, quantities)."""
        displacement = change.pose[self._stations(backbone), :3]
        return displacement.reshape(-1, displacement.shape[-1]) / np.sqrt(len(self.s))


@dataclass(frozen=True)
class Stiffness:
    """A target stiffness of the tip against a force, reached by co-contraction.

    Attributes:
        direction: direction of the force in base_frame, (3,).
        value: force per displacement in that direction [N/m], > 0.

    Raises:
        TargetError: if a value is not as described.
    """

    direction: FloatArray
    value: float

    def __post_init__(self) -> None:
        """Check the values."""
        direction = _numbers('stiffness direction', self.direction, (3,))
        if not direction.any():
            raise TargetError(f'stiffness direction is {shown(self.direction)}, expected not zero')
        if not float(_numbers('stiffness', self.value, ())) > 0.0:
            raise TargetError(f'stiffness is {shown(self.value)}, expected a number > 0 [N/m]')
        direction /= np.abs(direction).max()  # squares are then within the range of floats
        set_fields(self, direction=direction / np.linalg.norm(direction))

    def of(self, sensitivity: Sensitivity) -> float:
        """Return the stiffness of a solution in the direction [N/m]."""
        compliance = sensitivity.compliance[:3, :3]
        return float(1.0 / (self.direction @ compliance @ self.direction))


def _polar(vector: FloatArray) -> tuple[float, FloatArray]:
    """Return length and direction of a ``vector`` (2,); any direction of 0."""
    size = float(np.linalg.norm(vector))
    return size, vector / size if size else np.array([1.0, 0.0])
