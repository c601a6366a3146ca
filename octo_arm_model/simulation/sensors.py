"""Parameters of the push on a simulated arm, and of its sensors besides load cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import not_negative
from octo_arm_model.config.parameter import ParameterGroup, stated
from octo_arm_model.estimation.parameters import MAX_MARKERS
from octo_arm_model.rod.backbone import Backbone

_RATE = 'how often it is measured [Hz], at most rate; 0 for never'


@dataclass(frozen=True)
class Push(ParameterGroup):
    """A force on one cross section, again and again."""

    GROUP = 'push'

    force: tuple[float, ...] = stated(
        'force that pushes the arm, in base_frame [N]; with model exact', (0.0, 0.0, 0.0)
    )
    s: float = stated(
        'arc coordinate of the cross section it acts on [m]; 0 for the tip', 0.0, 'on the arm'
    )
    period: float = stated(
        'how often it begins anew, to last half of that [s]; 0 for a constant force', 0.0, '>= 0',
        'time',
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Validate what does not depend on the arm."""
        super().__post_init__()
        if len(self.force) != 3 or not np.isfinite(self.force).all():
            raise ArmDefinitionError('push.force', list(self.force), '3 finite numbers [N]')
        not_negative('push.s', self.s, 'arc coordinate', 'm')

    def at(self, time: float) -> FloatArray:
        """Force ``time`` [s] after the beginning, the second half of each period (3,) [N]."""
        acts = not self.period or math.fmod(time, self.period) >= 0.5 * self.period
        return np.array(self.force) * acts

    def is_at_tip(self, length: float) -> bool:
        """Whether it acts on the tip of an arm of ``length`` [m]."""
        return self.s in (0.0, length)


@dataclass(frozen=True)
class Sensors(ParameterGroup):
    """The sensors, of rate 0 where there is none, and their noise."""

    GROUP = 'sensors'

    tip_pose_rate: float = stated(f'measured/tip_pose: {_RATE}', 0.0, '>= 0')
    tip_position_stddev: float = stated(
        'noise of each coordinate of the position of the tip [m]', 0.0, '>= 0'
    )
    tip_rotation_stddev: float = stated(
        'noise of each component of its rotation [rad]', 0.0, '>= 0'
    )
    markers_rate: float = stated(f'measured/markers: {_RATE}', 0.0, '>= 0')
    marker_s: tuple[float, ...] = stated(
        f'arc coordinates of the markers [m], at most {MAX_MARKERS}', (), 'on the arm',
        most=MAX_MARKERS,
    )  # fmt: skip
    marker_stddev: float = stated('noise of each coordinate of a marker [m]', 0.0, '>= 0')
    base_wrench_rate: float = stated(f'measured/base_wrench: {_RATE}', 0.0, '>= 0')
    base_force_stddev: float = stated(
        'noise of each component of the force under the base [N]', 0.0, '>= 0'
    )
    base_moment_stddev: float = stated(
        'noise of each component of the moment under the base [N m]', 0.0, '>= 0'
    )
    seed: int = stated('seed of the noise of all of them', 0, '>= 0')

    def __post_init__(self) -> None:
        """Validate what does not depend on the arm."""
        super().__post_init__()
        if self.markers_rate and not self.marker_s:
            raise ArmDefinitionError('sensors.marker_s', (), 'arc coordinates of the markers [m]')

    @property
    def rates(self) -> tuple[float, float, float]:
        """Rates of pose, markers and wrench [Hz]."""
        return self.tip_pose_rate, self.markers_rate, self.base_wrench_rate


class Noise:
    """What the sensors read of true values."""

    def __init__(self, sensors: Sensors) -> None:
        """Of ``sensors``, by their seed."""
        self._own, self._random = sensors, np.random.default_rng(sensors.seed)

    def pose(self, shape: Backbone) -> Pose:
        """The pose of the tip of ``shape``."""
        position = shape.tip + self._own.tip_position_stddev * self._random.standard_normal(3)
        turn = self._own.tip_rotation_stddev * self._random.standard_normal(3)
        turned = Rotation.from_rotvec(turn) * Rotation.from_quat(np.array(shape.quaternion[-1]))
        return Pose(tuple(position.tolist()), tuple(turned.as_quat().tolist()))

    def markers(self, position: FloatArray) -> FloatArray:
        """Markers at a ``position`` (markers, 3) [m]."""
        noise = self._random.standard_normal(position.shape)
        return np.asarray(position + self._own.marker_stddev * noise)

    def base_wrench(self, wrench: FloatArray) -> FloatArray:
        """The ``wrench`` of all loads about the base, (6,) [N, N m]."""
        stddev = np.repeat([self._own.base_force_stddev, self._own.base_moment_stddev], 3)
        return np.asarray(wrench + stddev * self._random.standard_normal(6))
