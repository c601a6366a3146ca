"""What pushes a simulated arm, and the sensors besides load cells that see it: parameters."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from octo_arm_model.config.parameter import Parameter
from octo_arm_model.core.arm.validation import not_negative, whole
from octo_arm_model.core.errors import ArmDefinitionError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.parameters import MAX_MARKERS

_RATE = 'how often it is measured [Hz], at most rate; 0 for never'
SENSOR_PARAMETERS = (
    Parameter('push.force', float,
              'force that pushes the arm, in base_frame [N]; with model exact', (0.0, 0.0, 0.0),
              is_array=True),
    Parameter('push.s', float, 'arc coordinate of the cross section it acts on [m]; 0 for the tip',
              0.0, range='on the arm'),
    Parameter('push.period', float,
              'how often it begins anew, to last half of that [s]; 0 for a constant force', 0.0,
              range='>= 0'),
    Parameter('sensors.tip_pose_rate', float,
              f'measured/tip_pose: {_RATE}', 0.0, range='>= 0'),
    Parameter('sensors.tip_position_stddev', float,
              'noise of each coordinate of the position of the tip [m]', 0.0, range='>= 0'),
    Parameter('sensors.tip_rotation_stddev', float,
              'noise of each component of its rotation [rad]', 0.0, range='>= 0'),
    Parameter('sensors.markers_rate', float,
              f'measured/markers: {_RATE}', 0.0, range='>= 0'),
    Parameter('sensors.marker_s', float,
              f'arc coordinates of the markers [m], at most {MAX_MARKERS}', (), is_array=True,
              range='on the arm'),
    Parameter('sensors.marker_stddev', float, 'noise of each coordinate of a marker [m]', 0.0,
              range='>= 0'),
    Parameter('sensors.base_wrench_rate', float,
              f'measured/base_wrench: {_RATE}', 0.0, range='>= 0'),
    Parameter('sensors.base_force_stddev', float,
              'noise of each component of the force under the base [N]', 0.0, range='>= 0'),
    Parameter('sensors.base_moment_stddev', float,
              'noise of each component of the moment under the base [N m]', 0.0, range='>= 0'),
    Parameter('sensors.seed', int, 'seed of the noise of all of them', 0, range='>= 0'),
)  # fmt: skip


@dataclass(frozen=True)
class Push:
    """A force on one cross section, again and again; see `SENSOR_PARAMETERS`.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    force: tuple[float, ...] = (0.0, 0.0, 0.0)
    s: float = 0.0
    period: float = 0.0

    def __post_init__(self) -> None:
        """Validate what does not depend on the arm."""
        if len(self.force) != 3 or not np.isfinite(self.force).all():
            raise ArmDefinitionError('push.force', list(self.force), '3 finite numbers [N]')
        not_negative('push.s', self.s, 'arc coordinate', 'm')
        not_negative('push.period', self.period, 'time', 's')

    def at(self, time: float) -> FloatArray:
        """Force ``time`` [s] after the beginning, the second half of each period (3,) [N]."""
        acts = not self.period or math.fmod(time, self.period) >= 0.5 * self.period
        return np.array(self.force) * acts

    def is_at_tip(self, length: float) -> bool:
        """Whether it acts on the tip of an arm of ``length`` [m]."""
        return self.s in (0.0, length)


@dataclass(frozen=True)
class Sensors:
    """The sensors, of rate 0 where there is none, and their noise; see `SENSOR_PARAMETERS`.

    Raises:
        ArmDefinitionError: if a value is outside its range.
    """

    tip_pose_rate: float = 0.0
    tip_position_stddev: float = 0.0
    tip_rotation_stddev: float = 0.0
    markers_rate: float = 0.0
    marker_s: tuple[float, ...] = ()
    marker_stddev: float = 0.0
    base_wrench_rate: float = 0.0
    base_force_stddev: float = 0.0
    base_moment_stddev: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Validate what does not depend on the arm."""
        for field in dataclasses.fields(self):
            name, value = f'sensors.{field.name}', getattr(self, field.name)
            if field.name not in ('marker_s', 'seed'):
                unit = 'Hz' if name.endswith('rate') else 'N' if 'force' in name else 'm'
                not_negative(name, value, 'number', unit)
        if len(self.marker_s) > MAX_MARKERS:
            expected = f'at most {MAX_MARKERS} of them'
            raise ArmDefinitionError('sensors.marker_s', len(self.marker_s), expected)
        if self.markers_rate and not self.marker_s:
            raise ArmDefinitionError('sensors.marker_s', (), 'arc coordinates of the markers [m]')
        whole('sensors.seed', self.seed)

    @property
    def rates(self) -> tuple[float, float, float]:
        """Rates of pose, markers and wrench [Hz]."""
        return self.tip_pose_rate, self.markers_rate, self.base_wrench_rate
