"""Simulated arms: the push, the sensors besides load cells, and the arm at rest."""

import dataclasses
import functools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import ArmDefinitionError
from octo_arm_model.arm.hints import FloatArray, Vector
from octo_arm_model.arm.loads import Loads, PointLoad, ScaledLoads
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.stiffness import bending_force, default_highest
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import ParameterGroup, stated
from octo_arm_model.estimation.measurements import forces_at_stations, require_covered
from octo_arm_model.estimation.settings import MAX_MARKERS
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.simulation.profiles import CommandProfile

_AXES: tuple[Vector, ...] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_RATE = 'rate of measurements [Hz], at most rate; 0 for none'


@dataclass(frozen=True)
class Push(ParameterGroup):
    """A force on one cross section, periodic or constant."""

    GROUP = 'push'

    force: tuple[float, ...] = stated(
        'double[] | [0.0, 0.0, 0.0]',
        'force that pushes the arm, in base_frame [N]; with model exact',
    )
    s: float = stated(
        'double | 0.0 | >= 0',
        'arc coordinate on the arm of the cross section it acts on [m]; 0 for the tip',
    )
    period: float = stated(
        'double | 0.0 | >= 0 | what time',
        'period of the force, which acts in the second half of it [s]; 0 for a constant force',
    )

    def __post_init__(self) -> None:
        """Check the values that do not depend on the arm."""
        super().__post_init__()
        if len(self.force) != 3:
            raise ArmDefinitionError('push.force', list(self.force), '3 finite numbers [N]')

    def at(self, time: float) -> FloatArray:
        """Return the force (3,) [N] at a ``time`` [s]: it acts in the second half of a period."""
        acts = not self.period or math.fmod(time, self.period) >= 0.5 * self.period
        return np.array(self.force) * acts

    def is_at_tip(self, length: float) -> bool:
        """Whether the push acts on the tip of an arm of ``length`` [m]."""
        return self.s in (0.0, length)


@dataclass(frozen=True)
class Sensors(ParameterGroup):
    """The rates of the sensors, 0 for a sensor that is not there, and their noise."""

    GROUP = 'sensors'

    tip_pose_rate: float = stated('double | 0.0 | >= 0', f'measured/tip_pose: {_RATE}')
    tip_position_stddev: float = stated(
        'double | 0.0 | >= 0', 'noise of each coordinate of the position of the tip [m]'
    )
    tip_rotation_stddev: float = stated(
        'double | 0.0 | >= 0', 'noise of each component of its rotation [rad]'
    )
    markers_rate: float = stated('double | 0.0 | >= 0', f'measured/markers: {_RATE}')
    marker_s: tuple[float, ...] = stated(
        f'double[] | [] | >= 0 | most {MAX_MARKERS}',
        'arc coordinates on the arm of the markers [m]',
    )
    marker_stddev: float = stated(
        'double | 0.0 | >= 0', 'noise of each coordinate of a marker [m]'
    )
    base_wrench_rate: float = stated('double | 0.0 | >= 0', f'measured/base_wrench: {_RATE}')
    base_force_stddev: float = stated(
        'double | 0.0 | >= 0', 'noise of each component of the force under the base [N]'
    )
    base_moment_stddev: float = stated(
        'double | 0.0 | >= 0', 'noise of each component of the moment under the base [N m]'
    )
    seed: int = stated('integer | 0 | >= 0', 'seed of the noise of all these sensors')

    def __post_init__(self) -> None:
        """Check the values that do not depend on the arm."""
        super().__post_init__()
        if self.markers_rate and not self.marker_s:
            raise ArmDefinitionError('sensors.marker_s', (), 'arc coordinates of the markers [m]')

    @property
    def rates(self) -> tuple[float, float, float]:
        """The rates of pose, markers and wrench [Hz]."""
        return self.tip_pose_rate, self.markers_rate, self.base_wrench_rate


class SimulatedArm(ABC):
    """An arm under tensions and a push, with sensors besides load cells.

    Attributes:
        config: configuration of the arm, with a push that is not at the tip among its loads.
    """

    _s: FloatArray  # arc coordinates of the points of the arm [m]
    _random: np.random.Generator

    def __init__(self, config: Config, push: Push, sensors: Sensors, is_pushed: bool) -> None:
        """Simulate the arm of ``config``; the noise of ``sensors`` follows from their seed.

        The force of ``push`` can act only if it ``is_pushed``.
        """
        self._config = self.config = config
        self._sensors = sensors
        self._at_tip = push.is_at_tip(config.arm.length)
        self._push: ScaledLoads | None = None
        if is_pushed and not self._at_tip:
            self._push = ScaledLoads([Loads(points=(PointLoad(push.s, axis),)) for axis in _AXES])
            loads = dataclasses.replace(config.loads, scaled=self._push)
            self.config = dataclasses.replace(config, loads=loads)

    def push_with(self, force: FloatArray) -> FloatArray | None:
        """Push with a ``force`` (3,) [N], and return the wrench (6,) on the tip.

        It is None without, as some models take none.
        """
        if self._push is not None:
            self._push.magnitudes[:] = force
        return np.append(force, np.zeros(3)) if self._at_tip and force.any() else None

    def go_on_from(self, before: 'SimulatedArm') -> bool:
        """Take over the state of ``before`` if it is the same arm; return whether it is.

        Take over also its noise, if that has the same seed.
        """
        if self._sensors.seed == before._sensors.seed:
            self._random = before._random
        # A push elsewhere than at the tip adds points to the arm.
        has_points = type(self) is type(before) and np.array_equal(self._s, before._s)
        is_same = has_points and self._config.has_balance_of(before._config)
        if is_same:
            self._take_state(before)
        return is_same

    def reset(self) -> None:
        """Be as at first: without a shape or a history of friction; noise begins anew."""
        self._random = np.random.default_rng(self._sensors.seed)

    @abstractmethod
    def _take_state(self, before: Any) -> None:
        """Take over the state of the same arm ``before``."""

    @property
    @abstractmethod
    def backbone(self) -> Backbone:
        """The present shape, which exists after `advance`."""

    @abstractmethod
    def reeled_in(self) -> FloatArray:
        """Return the lengths that winches have reeled in [m], (tendons,)."""

    @property
    @abstractmethod
    def true_base_wrench(self) -> FloatArray:
        """The force and the moment of all loads about the base, (6,) [N, N m]."""

    def tip_pose(self) -> Pose:
        """Return the measured pose of the tip."""
        shape, sensors, random = self.backbone, self._sensors, self._random
        position = shape.tip + sensors.tip_position_stddev * random.standard_normal(3)
        error = sensors.tip_rotation_stddev * random.standard_normal(3)
        rotation = Rotation.from_rotvec(error) * Rotation.from_quat(np.array(shape.quaternion[-1]))
        return Pose(tuple(position.tolist()), tuple(rotation.as_quat().tolist()))

    def markers(self) -> FloatArray:
        """Return the measured positions of all markers, (markers, 3) [m]."""
        shape, places = self.backbone, np.array(self._sensors.marker_s)
        position = CubicSpline(shape.s, shape.position)(places)
        noise = self._random.standard_normal(position.shape)
        return np.asarray(position + self._sensors.marker_stddev * noise)

    def base_wrench(self) -> FloatArray:
        """Return the measured force and moment of all loads about the base (6,) [N, N m].

        If the arm moves, inertia and the forces of the water are among the loads.
        """
        stddev = [self._sensors.base_force_stddev, self._sensors.base_moment_stddev]
        noise = np.repeat(stddev, 3) * self._random.standard_normal(6)
        return np.asarray(self.true_base_wrench + noise)


class PushedArm(SimulatedArm):
    """A simulated arm without inertia, in equilibrium at any time.

    Attributes:
        force: present push, (3,) [N].
    """

    def __init__(self, config: Config, push: Push, sensors: Sensors) -> None:
        """Simulate the arm of ``config``.

        Raises:
            OctoArmError: if the model has no loads, or does not cover the arm, or the sensor under
                the base does not cover its loads.
        """
        super().__init__(config, push, sensors, any(push.force))
        self._solver = self.config.solver()
        self._s = self._solver.grid.s
        self._solver.check_tip_wrench(np.append(push.force, np.zeros(3)) * self._at_tip)
        self._push_s = push.s or config.arm.length
        if sensors.base_wrench_rate:
            require_covered(config.loads)
        self.reset()

    def reset(self) -> None:
        """Be as at first: without a shape, a push or a history of friction."""
        super().reset()
        self._shape: Backbone | None = None
        self.force = np.zeros(3)

    def _take_state(self, before: 'PushedArm') -> None:
        self._shape, self.force = before._shape, before.force

    def advance(self, tensions: FloatArray, force: FloatArray) -> None:
        """Find the shape under ``tensions`` (tendons,) and the ``force`` of the push (3,) [N].

        OctoArmError if there is no such shape; the last one is kept.
        """
        shape, push = self._config.arm.tension_shape, self.push_with(force)
        self._shape = self._solver.follow(tensions.reshape(shape), self._shape, push)
        self.force = force

    @property
    def backbone(self) -> Backbone:
        """The present shape, which exists after `advance`."""
        assert self._shape is not None
        return self._shape

    def reeled_in(self) -> FloatArray:
        """Return the lengths that winches have reeled in [m], (tendons,)."""
        return displacements_of(self._solver, self.backbone).ravel()

    @functools.cached_property
    def _forces(self) -> FloatArray:
        return forces_at_stations(self._config.arm, self._solver.grid, self._config.loads)

    @property
    def true_base_wrench(self) -> FloatArray:
        """The force and the moment of all loads about the base, (6,) [N, N m]."""
        shape, loads = self.backbone, self._config.loads
        moments = [loads.tip_moment, *(point.moment for point in loads.points)]
        lever = CubicSpline(shape.s, shape.position - shape.position[0])
        forces = [*self._forces, self.force]
        levers = [*lever(shape.s), lever(self._push_s)]
        moment = np.cross(levers, forces).sum(axis=0) + np.sum(moments, axis=0)
        return np.concatenate([np.sum(forces, axis=0), moment])


PERIOD = 6.0  # period of the push, which acts for half of it [s]
_PUSHED = 0.3  # displacement of the tip by the push, relative to the length
_SWUNG = 0.09  # the same by each of the forces that stand for inertia and drag
_TOUCHED_RATE = 25.0  # rate of the sensors [Hz]
# Noise of positions over the length, of rotations [rad], of tensions over the highest tension.
_POSITION, _ROTATION, _TENSION = 2e-3, 0.03, 1e-3
_CHANGE = 0.15  # change of tensions in a second, relative to the highest tension
_SLOWLY = 0.3  # highest speed of the movement of an arm that is pushed
_GAP, _SAMPLE = 0.2, 0.02  # time between readings that a busy machine uses, and of samples [s]
_MARKERS = (1 / 3, 2 / 3)  # arc coordinates of the markers over the length


def touched(
    config: Config, profile: CommandProfile | None = None, is_moving: bool = False
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return parameters of `octo_arm_sim` and `octo_arm_estimator`, besides those of the arm.

    The simulator plays ``profile`` so slowly that tensions change between two readings by no more
    than the standard deviation of their random walk: the estimator takes what changes faster for
    the reading of a faulty load cell.

    The estimator takes the arm to be in balance, so that inertia and drag of an arm that moves are
    unknown forces at the tip and the markers. They do not explain the rotation of the tip, so that
    it is not measured.
    """
    length = config.arm.length
    axes = axes_of(np.array(config.base.quaternion))
    force = bending_force(config.arm, _PUSHED) * axes @ np.array([0.0, 0.6, 0.8])
    highest = float(default_highest(config.arm).min())
    tension = _TENSION * highest
    markers = [part * length for part in _MARKERS]
    simulator = {
        'model': 'exact',
        'load_cells.noise_stddev': tension,
        'push.force': force.tolist(),
        'push.period': PERIOD,
        'sensors.tip_pose_rate': _TOUCHED_RATE,
        'sensors.tip_position_stddev': _POSITION * length,
        'sensors.tip_rotation_stddev': _ROTATION,
        'sensors.markers_rate': _TOUCHED_RATE,
        'sensors.marker_s': markers,
        'sensors.marker_stddev': _POSITION * length,
    }
    estimator = {
        'tension_stddev': tension,
        'estimator.tension_rate': _CHANGE * highest,
        'estimator.marker_s': markers,
        'estimator.marker_stddev': _POSITION * length,
        'estimator.force_time': 0.5,
    }
    if profile is not None:
        samples = profile.at(np.arange(0.0, profile.duration, _SAMPLE))
        fastest = float(np.abs(np.diff(samples, axis=0)).max(initial=0.0)) / _SAMPLE
        speed = _CHANGE * highest / math.sqrt(_GAP) / max(fastest, 1e-9)
        simulator['profile.speed'] = min(_SLOWLY, speed)
    if is_moving:
        simulator['sensors.tip_rotation_stddev'] = 0.0
        estimator |= {
            'estimator.contact': 'at',
            'estimator.contact_s': [length, *markers],
            'estimator.force_stddev': bending_force(config.arm, _SWUNG),
        }
    return simulator, estimator
