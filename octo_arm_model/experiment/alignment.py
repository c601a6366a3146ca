"""Pose of the camera: the rigid motion from its frame to base_frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose

# Points within so many times their noise of a line or plane, or within this part of their extent,
# lie in it.
_TIMES_NOISE = 3.0
_FLAT = 1e-4


@dataclass(frozen=True)
class Alignment:
    """The transform camera to base: position_in_base = R position_in_camera + shift.

    Attributes:
        turn: rotation vector of R [rad], (3,).
        shift: where the camera's origin lies in base_frame [m], (3,).
    """

    turn: FloatArray
    shift: FloatArray

    @classmethod
    def none(cls) -> Alignment:
        """The identity, for a camera whose frame is base_frame."""
        return cls(np.zeros(3), np.zeros(3))

    @classmethod
    def from_pose(cls, pose: Pose) -> Alignment:
        """From the pose of the camera in base_frame."""
        turn = Rotation.from_quat(np.array(pose.quaternion)).as_rotvec()
        return cls(turn, np.array(pose.position))

    @property
    def rotation(self) -> FloatArray:
        """The rotation R, (3, 3)."""
        return Rotation.from_rotvec(self.turn).as_matrix()

    @property
    def quaternion(self) -> FloatArray:
        """The rotation as x, y, z, w."""
        return Rotation.from_rotvec(self.turn).as_quat()

    def to_base(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the camera's frame in base_frame [m]."""
        return points @ self.rotation.T + self.shift

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of base_frame in the camera's frame [m]."""
        return (points - self.shift) @ self.rotation

    def as_dict(self) -> dict[str, list[float]]:
        """Position [m] and quaternion x, y, z, w, ready for JSON."""
        return {'position': self.shift.tolist(), 'quaternion': self.quaternion.tolist()}


def align(camera: FloatArray, base: FloatArray, weight: ArrayLike = 1.0) -> Alignment:
    """The rigid motion that brings points ``camera`` (n, 3) nearest to ``base`` (n, 3).

    In the least squares sense, each with its ``weight`` (Kabsch 1976). For points on a line
    the rotation about it is undetermined and arbitrary; see `undetermined`.
    """
    weight = np.broadcast_to(np.asarray(weight, dtype=np.float64), (len(camera),))
    share = (weight / weight.sum())[:, np.newaxis]
    from_mean, to_mean = (share * camera).sum(axis=0), (share * base).sum(axis=0)
    covariance = (base - to_mean).T @ (share * (camera - from_mean))
    left, _, right = np.linalg.svd(covariance)
    # A proper rotation, even where a reflection would fit better.
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    rotation = left @ right
    turn = Rotation.from_matrix(rotation).as_rotvec()
    return Alignment(turn, to_mean - rotation @ from_mean)


def undetermined(points: FloatArray, noise: float) -> tuple[str, ...]:
    """Degrees of freedom of a fitted alignment that ``points`` (n, 3) leave open, in words.

    ``noise`` is the root mean square distance that the fit leaves [m]: what is within it of a line
    or a plane cannot be distinguished from one.
    """
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] == 0.0:
        return ('all measured points are one: the alignment has no rotation',)
    # A coordinate has a third of the square of a distance.
    flat = max(_TIMES_NOISE * noise * np.sqrt(len(points) / 3.0), _FLAT * spread[0])
    within = f'within {_TIMES_NOISE:g} times their noise '
    if spread[1] <= flat:
        return (f'all measured points lie {within}on a line: the rotation about it is open',)
    if spread[2] <= flat:
        return (
            f'all measured points lie {within}in a plane: the alignment cannot tell a picture '
            'from its mirror image, seen from the other side of the plane',
        )
    return ()
