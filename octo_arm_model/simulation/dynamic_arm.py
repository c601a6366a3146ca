"""A simulated arm that moves with its base in water, and what sensors read of it."""

import dataclasses
import functools
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ConfigError, LoadError, SolveError, shown
from octo_arm_model.arm.hints import FloatArray, Vector
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import LARGEST, vector
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.motion import base_of
from octo_arm_model.rod.motion_state import Inputs, MotionState
from octo_arm_model.simulation.pushed_arm import Push, Sensors, SimulatedArm

# Time constant of both lags with which base and current follow their goals [s]: poses come in
# steps, and an arm whose base jumped to a velocity would whip.
LAG = 0.05
FARTHEST, MOST_TURN = 0.1, 0.3  # largest distance and angle from the base to its goal [m], [rad]
FASTEST = 10.0  # fastest current [m/s]
_BASE, _CURRENT = slice(0, 7), slice(7, 10)


class Surroundings:
    """The pose of the base and the current over time.

    Attributes:
        values: present values, their rates, and their goals: position [m], quaternion w, x, y, z
            and velocity of the water [m/s], (3, 10).
        is_told: whether a goal was set since the beginning.
    """

    def __init__(self, base: Pose, current: Vector) -> None:
        """Begin with this ``base`` and ``current``, at rest."""
        now = np.append(base_of(base), current)
        self.values: FloatArray = np.array([now, np.zeros(now.size), now])
        self.is_told = False

    def move_base(self, pose: Pose) -> None:
        """Set the goal of the base, a ``pose`` in base_frame; LoadError if it is too far."""
        goal, now = base_of(pose), self.values[0, _BASE]
        distance = math.dist(goal[:3], now[:3])
        cosine = float(goal[3:] @ now[3:]) / float(np.linalg.norm(now[3:]))
        angle = 2.0 * math.acos(min(abs(cosine), 1.0))
        if not (distance <= FARTHEST and angle <= MOST_TURN):
            raise LoadError(
                f'the pose is {distance:.3g} m and {angle:.3g} rad from where the base is, '
                f'expected at most {FARTHEST:g} m and {MOST_TURN:g} rad'
            )
        goal[3:] *= math.copysign(1.0, cosine)
        self.values[2, _BASE], self.is_told = goal, True

    def flow(self, current: Vector) -> None:
        """Set the goal of the ``current`` [m/s]; LoadError if it is faster than `FASTEST`."""
        if (speed := math.hypot(*vector('current', current, 'm/s'))) > FASTEST:
            raise LoadError(f'the current is {speed:.4g} m/s, expected at most {FASTEST:g} m/s')
        self.values[2, _CURRENT], self.is_told = current, True

    def after(self, elapsed: float) -> FloatArray:
        """Return `values` after a time ``elapsed`` [s]."""
        now, rate, goal = self.values
        error, decay = now - goal, math.exp(-elapsed / LAG)
        slope = rate + error / LAG
        value = goal + decay * (error + slope * elapsed)
        return np.array([value, decay * (rate - slope * elapsed / LAG), goal])


def check_values(values: FloatArray, base: FloatArray) -> None:
    """Raise ConfigError unless `Surroundings.values` belong to a ``base`` as from `base_of`."""
    far = np.abs(values[:, _BASE] - [base, np.zeros(7), base])
    # Between two orientations a quaternion is a little shorter than one.
    if not (far[0].max() < 0.02 and far[2].max() < 0.5 and np.abs(values).max() < LARGEST):
        raise ConfigError('surroundings are not those of the base of the arm')


def pose_of(values: FloatArray) -> Pose:
    """Return the present pose of the base in `Surroundings.values`."""
    x, y, z, *turn = values[0, _BASE].tolist()
    qw, qx, qy, qz = (part / math.hypot(*turn) for part in turn)
    return Pose((x, y, z), (qx, qy, qz, qw))


def current_of(values: FloatArray) -> Vector:
    """Return the present current in `Surroundings.values` [m/s]."""
    u, v, w = values[0, _CURRENT].tolist()
    return u, v, w


SUFFIX = '.npz'  # of the names of files with a state
_STEP = 5e-3  # longest step of the integration [s]


class HeldLengths(NamedTuple):
    """The tendons that winches hold at a length, each (tendons,)."""

    lengths: FloatArray  #: lengths reeled in [m]; NaN for winches that follow tensions
    #: tensions below which winches reel in, and above which they let out [N], (2, tendons)
    bounds: FloatArray
    #: 1 for a winch that is to reel in, -1 for one that is to let out, else 0
    direction: FloatArray
    #: 1 for a tendon at its upper bound, -1 for one at its lower bound, else 0
    at_bound: FloatArray
    keeps_taut: bool  #: whether the lower bound is > 0; tendons at a bound of 0 hang slack


class DynamicArm(SimulatedArm):
    """A simulated arm that moves under tensions, winches and a push."""

    def __init__(self, config: Config, push: Push, sensors: Sensors) -> None:
        """Simulate the arm of ``config`` by the model exact; OctoArmError if it has no density."""
        super().__init__(config, push, sensors, is_pushed=True)
        self._dynamics = self.config.dynamics()
        self._s = self._dynamics.nodes.s
        # Several sensors and the ground truth ask for the shape of one state.
        self._shape_of = functools.lru_cache(1)(self._dynamics.backbone)
        self._names = np.array(config.arm.tendon_names)
        self._none = np.full(self._names.size, np.nan)
        self.reset()

    def reset(self) -> None:
        """Be at rest as at first, without a history of friction, base and current as at first."""
        super().reset()
        self._state: MotionState | None = None
        self._held = self._none
        self.surroundings = Surroundings(self._config.base, self._config.motion.current)

    def _take_state(self, before: 'DynamicArm') -> None:
        self._state, self._held = before._state, before._held
        self.surroundings = before.surroundings
        if (current := self._config.motion.current) != before._config.motion.current:
            self.surroundings.values[2, _CURRENT], self.surroundings.is_told = current, True

    def check_force(self, force: FloatArray) -> None:
        """Check a ``force`` of the push, (3,) [N]; raise LoadError if it is too large."""
        self._dynamics.solver.check_tip_wrench(np.append(force, np.zeros(3)))

    def check_lengths(self, lengths: Mapping[str, float]) -> None:
        """Check ``lengths`` that winches are to reel in, by tendon name [m].

        TensionError if a name is unknown, or a length is longer than its tendon.
        """
        self._dynamics.checked(Inputs(np.zeros(self._config.arm.tension_shape), lengths))

    def advance(
        self,
        tensions: FloatArray,
        force: FloatArray,
        elapsed: float,
        reeled: HeldLengths | None = None,
    ) -> None:
        """Move for ``elapsed`` [s] under ``tensions`` (tendons,) and a push ``force`` (3,) [N].

        Winches go to the lengths ``reeled`` in. One whose tendon would be beyond its upper bound
        lets out, and one below its lower bound reels in. The first state is the equilibrium.

        Raises:
            SolveError: if no step succeeds; the last state is kept.
        """
        wrench, shape = self.push_with(force), self._config.arm.tension_shape
        inputs = Inputs(tensions.reshape(shape), tip_wrench=wrench)
        state = self._state
        if state is None:
            self._state, self._held = self._dynamics.at_rest(inputs), self._none
            return
        if elapsed <= 0.0:
            return
        around = self.surroundings.after(elapsed)
        if self.surroundings.is_told:
            inputs = dataclasses.replace(inputs, base=pose_of(around), current=current_of(around))
        self._state, self._held = self._moved(state, inputs, elapsed, reeled)
        self.surroundings.values = around

    def _moved(
        self, state: MotionState, inputs: Inputs, elapsed: float, reeled: HeldLengths | None
    ) -> tuple[MotionState, FloatArray]:
        """Return the state after ``elapsed`` [s], and the lengths that winches hold."""
        if reeled is None:
            return self._dynamics.go_on(state, inputs, elapsed, _STEP), self._none
        lengths, (least, most), direction, bound, keeps_taut = reeled
        commanded, released = np.asarray(inputs.tensions), np.zeros(bound.size, np.bool_)
        while True:
            holds = ~np.isnan(lengths) & (bound == 0.0)
            pull = np.where(bound > 0.0, most, np.where(bound < 0.0, least, commanded.ravel()))
            held = dict(zip(self._names[holds].tolist(), lengths[holds].tolist()))
            inputs = dataclasses.replace(
                inputs, tensions=pull.reshape(commanded.shape), displacements=held
            )
            try:
                after = self._dynamics.go_on(state, inputs, elapsed, _STEP)
            except SolveError:
                # No tensions may reach these lengths: winches then pull to their bounds.
                if not (direction * holds).any():
                    raise
                bound, direction = np.where(holds, direction, bound), 0.0 * direction
                continue
            excess = (after.tensions - np.clip(after.tensions, least, most)) * holds
            releases = np.abs(excess) > 1e-9 * most  # beyond rounding
            # A winch that reaches its length holds it again.
            passed = self._dynamics.displacements(after) - lengths
            is_reached = ~released & (bound * passed > 0.0)
            if not (releases | is_reached).any():
                is_slack = (bound < 0.0) & (not keeps_taut)
                return after, np.where(holds | is_slack, lengths, np.nan)
            released |= releases
            bound = np.where(is_reached, 0.0, bound + np.sign(excess) * releases)

    def save(self, path: Path, values: Mapping[str, FloatArray]) -> None:
        """Write the state, and ``values`` of the winches, to a file, whole or not at all.

        Raises:
            SolveError: if there is no state yet.
            ConfigError: if the file cannot be written, or ``path`` does not end with .npz.
        """
        if path.suffix != SUFFIX:
            raise ConfigError(
                f'{path} is no file of a state, expected a name that ends with {SUFFIX}'
            )
        part = path.with_name(f'{path.name}.part')
        try:
            self._dynamics.save(self.state, part, values)
            os.replace(part, path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise ConfigError(f'{path} cannot be written: {error.strerror}') from error

    def read(
        self, path: Path, shapes: Mapping[str, tuple[int, ...]]
    ) -> tuple[MotionState, dict[str, FloatArray]]:
        """Return the state in the file ``path``, for `restore`, and the values with ``shapes``.

        ConfigError if the file cannot be read, or is of another arm or version.
        """
        state, values = self._dynamics.load(path), {}
        with np.load(path, allow_pickle=False) as file:
            for name, shape in shapes.items():
                if name not in file.files:
                    raise ConfigError(
                        f'{path} is the state of an arm alone, without its winches: no {name}'
                    )
                array = values[name] = file[name]
                has_shape = array.shape == shape and array.dtype.kind == 'f'
                if not (has_shape and (np.abs(array) < LARGEST).all()):
                    expected = f'finite numbers {shape}'
                    raise ConfigError(f'{path}: {name} is {shown(array)}, expected {expected}')
        return state, values

    def restore(self, state: MotionState, around: FloatArray) -> None:
        """Go on from a ``state`` with surroundings of the values ``around``."""
        self._state, self._held = state, self._none
        self.surroundings.values, self.surroundings.is_told = around, True

    @property
    def state(self) -> MotionState:
        """The present state; SolveError before the first `advance`."""
        if self._state is None:
            raise SolveError('the arm has not moved yet')
        return self._state

    @property
    def backbone(self) -> Backbone:
        """The present shape."""
        return self._shape_of(self.state)

    def reeled_in(self) -> FloatArray:
        """Return the lengths that winches have reeled in [m], (tendons,).

        For a slack tendon it is the length that the winch holds, or, if tensions are commanded,
        the length that would make the tendon taut.
        """
        taut = self._dynamics.displacements(self.state)
        return np.where(np.isnan(self._held), taut, self._held)

    @property
    def true_base_wrench(self) -> FloatArray:
        """The force and the moment of all loads about the base, (6,) [N, N m]."""
        return self.state.base_wrench
