"""Where the base of an arm that moves goes, and the water around it, as somebody tells."""

from __future__ import annotations

import math

import numpy as np

from octo_arm_model.arm.errors import ConfigError, LoadError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Vector
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import LARGEST, vector
from octo_arm_model.rod.motion import base_of

# Time constant of each of the two lags with which both follow what is told [s]: poses come in
# steps, and an arm whose base jumped to a velocity would whip.
LAG = 0.05
FARTHEST, MOST_TURN = 0.1, 0.3  # of the pose that is told from where the base is [m], [rad]
FASTEST = 10.0  # current [m/s]
SHAPE = 3, 10
_BASE, _CURRENT = slice(0, 7), slice(7, 10)


class Surroundings:
    """Pose of the base and current over time.

    Attributes:
        values: both now, their rates, and what they go to: position [m], quaternion w, x, y, z
            and velocity of the water [m/s], of `SHAPE`.
        is_told: whether anything else than at the beginning was told.
    """

    def __init__(self, base: Pose, current: Vector) -> None:
        """Begin with these, at rest."""
        now = np.append(base_of(base), current)
        self.values: FloatArray = np.array([now, np.zeros(now.size), now])
        self.is_told = False

    def move_base(self, pose: Pose) -> None:
        """Let the base go to a ``pose`` in base_frame.

        Raises:
            LoadError: if it is too far from where the base is now.
        """
        goal, now = base_of(pose), self.values[0, _BASE]
        far = math.dist(goal[:3], now[:3])
        along = float(goal[3:] @ now[3:]) / float(np.linalg.norm(now[3:]))
        turn = 2.0 * math.acos(min(abs(along), 1.0))
        if not (far <= FARTHEST and turn <= MOST_TURN):
            raise LoadError(
                f'the pose is {far:.3g} m and {turn:.3g} rad from where the base is, expected at '
                f'most {FARTHEST:g} m and {MOST_TURN:g} rad'
            )
        goal[3:] *= math.copysign(1.0, along)
        self.values[2, _BASE], self.is_told = goal, True

    def flow(self, current: Vector) -> None:
        """Let the water come to flow by a ``current`` in base_frame [m/s].

        Raises:
            LoadError: if it is faster than `FASTEST`.
            ArmDefinitionError: if it is not three finite numbers.
        """
        if (speed := math.hypot(*vector('current', current, 'm/s'))) > FASTEST:
            raise LoadError(f'the current is {speed:.4g} m/s, expected at most {FASTEST:g} m/s')
        self.values[2, _CURRENT], self.is_told = current, True

    def after(self, elapsed: float) -> FloatArray:
        """The `values` after a time [s]."""
        now, rate, goal = self.values
        off, left = now - goal, math.exp(-elapsed / LAG)
        slope = rate + off / LAG
        return np.array(
            [goal + left * (off + slope * elapsed), left * (rate - slope * elapsed / LAG), goal]
        )


def check_values(values: FloatArray, base: FloatArray) -> None:
    """Check `Surroundings.values` of a file, of an arm on a ``base``, as of `base_of`.

    Raises:
        ConfigError: if they are none of it.
    """
    far = np.abs(values[:, _BASE] - [base, np.zeros(7), base])
    # On the way from one orientation to another a quaternion is a little shorter than one.
    if not (far[0].max() < 0.02 and far[2].max() < 0.5 and np.abs(values).max() < LARGEST):
        raise ConfigError('surroundings are not those of the base of the arm')


def pose_of(values: FloatArray) -> Pose:
    """Pose of the base of `Surroundings.values`."""
    x, y, z, *turn = values[0, _BASE].tolist()
    qw, qx, qy, qz = (part / math.hypot(*turn) for part in turn)
    return Pose((x, y, z), (qx, qy, qz, qw))


def current_of(values: FloatArray) -> Vector:
    """Current of `Surroundings.values` [m/s]."""
    u, v, w = values[0, _CURRENT].tolist()
    return u, v, w
