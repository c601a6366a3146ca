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

# Time constant of each of the two lags with which both follow what is told [s]: poses come in
# steps, and an arm whose base jumped to a velocity would whip.
LAG = 0.05
FARTHEST, MOST_TURN = 0.1, 0.3  # of the pose that is told from where the base is [m], [rad]
FASTEST = 10.0  # current [m/s]
_BASE, _CURRENT = slice(0, 7), slice(7, 10)


class Surroundings:
    """Pose of the base and current over time.

    Attributes:
        values: both now, their rates, and what they go to: position [m], quaternion w, x, y, z
            and velocity of the water [m/s], (3, 10).
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


SUFFIX = '.npz'  # of files of a state
_STEP = 5e-3  # of the integration, at most [s]


class HeldLengths(NamedTuple):
    """What winches hold at a length, each (tendons,) or a row of these.

    Attributes:
        lengths: reeled in [m]; NaN of winches that follow tensions.
        bounds: tensions below which they reel in, and above which they give way [N], (2, tendons).
        direction: 1 where a winch is to reel in, -1 where it is to reel out, else 0.
        at_bound: 1 where a tendon was at its upper bound, -1 at the lower one, else 0.
        keeps_taut: whether the lower bound is a tension; tendons at one of 0 hang slack.
    """

    lengths: FloatArray
    bounds: FloatArray
    direction: FloatArray
    at_bound: FloatArray
    keeps_taut: bool


class DynamicArm(SimulatedArm):
    """The motion of an arm under tensions, winches and a push."""

    def __init__(self, config: Config, push: Push, sensors: Sensors) -> None:
        """Of the arm of ``config``, by the model exact; OctoArmError if the arm has no density."""
        super().__init__(config, push, sensors, is_pushed=True)
        self._dynamics = self._pushed.dynamics()
        # Several sensors and the ground truth see one state.
        self._shape_of = functools.lru_cache(1)(self._dynamics.backbone)
        self._names = np.array(config.arm.tendon_names)
        self._held = self._none = np.full(self._names.size, np.nan)
        self._state: MotionState | None = None
        self.surroundings = Surroundings(config.base, config.motion.current)

    def go_on_from(self, before: SimulatedArm) -> bool:
        """As `SimulatedArm.go_on_from`; another arm begins at rest."""
        if not isinstance(before, DynamicArm):
            return False
        mine, theirs = (one._dynamics.nodes.s for one in (self, before))
        if self._config.has_balance_of(before._config) and np.array_equal(mine, theirs):
            self._state, self.surroundings = before._state, before.surroundings
            self._held = before._held
            return False
        return before._state is not None and before._state.history is not None

    def reset(self) -> None:
        """Be at rest again, tendons with friction pulled from slack, base and current as first."""
        self._state, self._held = None, self._none
        self.surroundings = Surroundings(self._config.base, self._config.motion.current)

    def check_force(self, force: FloatArray) -> None:
        """Check a ``force`` of the push, (3,) [N]; LoadError if it is too large."""
        self._dynamics.solver.check_tip_wrench(np.append(force, np.zeros(3)))

    def check_lengths(self, lengths: Mapping[str, float]) -> None:
        """Check ``lengths`` that winches are to reel in, by tendon name [m].

        Raises:
            TensionError: if a name is unknown, or a length more than there is.
        """
        self._dynamics.checked(Inputs(np.zeros(self._config.arm.tension_shape), lengths))

    def advance(
        self,
        tensions: FloatArray,
        force: FloatArray,
        elapsed: float,
        reeled: HeldLengths | None = None,
    ) -> None:
        """Move on by ``elapsed`` [s] to ``tensions`` (tendons,) and a ``force`` of the push (3,).

        And to what is ``reeled`` in: a winch whose tendon would bear more than it gives way, or
        less than it keeps reels in. At rest, at first, tensions alone act.

        Raises:
            SolveError: if no step succeeds; the last state stays.
        """
        wrench = self._wrench(force)
        inputs = Inputs(tensions.reshape(self._config.arm.tension_shape), tip_wrench=wrench)
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
        """The state after that, and lengths that winches hold."""
        if reeled is None:
            return self._dynamics.go_on(state, inputs, elapsed, _STEP), self._none
        lengths, (least, most), direction, at, keeps_taut = reeled
        given, gave = np.asarray(inputs.tensions), np.zeros(at.size, np.bool_)
        while True:
            holds = ~np.isnan(lengths) & (at == 0.0)
            pulled = np.where(at > 0.0, most, np.where(at < 0.0, least, given.ravel()))
            held = dict(zip(self._names[holds].tolist(), lengths[holds].tolist()))
            inputs = dataclasses.replace(
                inputs, tensions=pulled.reshape(given.shape), displacements=held
            )
            try:
                found = self._dynamics.go_on(state, inputs, elapsed, _STEP)
            except SolveError:
                # Lengths may be beyond what any tensions reel in: winches then do what they can.
                if not (direction * holds).any():
                    raise
                at, direction = np.where(holds, direction, at), 0.0 * direction
                continue
            over = (found.tensions - np.clip(found.tensions, least, most)) * holds
            gives = np.abs(over) > 1e-9 * (1.0 + found.tensions)  # not of rounding
            # A length that is reached is held again.
            passed = self._dynamics.displacements(found) - lengths
            is_reached = ~gave & (at * passed > 0.0)
            if not (gives | is_reached).any():
                hangs = (at < 0.0) & (not keeps_taut)
                return found, np.where(holds | hangs, lengths, np.nan)
            gave |= gives
            at = np.where(is_reached, 0.0, at + np.sign(over) * gives)

    def save(self, path: Path, values: Mapping[str, FloatArray]) -> None:
        """Write the state, and ``values`` of what pulls the arm, to a file, whole or not at all.

        Raises:
            SolveError: if there is none yet.
            ConfigError: if it cannot be written, or ``path`` does not end with .npz.
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
        """A state in the file ``path``, for `restore`, and the values of these ``shapes``.

        Raises:
            ConfigError: if it cannot be read, or is none of this arm or version.
        """
        state, values = self._dynamics.load(path), {}
        with np.load(path, allow_pickle=False) as file:
            for name, shape in shapes.items():
                if name not in file.files:
                    raise ConfigError(
                        f'{path} is the state of an arm alone, without its winches: no {name}'
                    )
                array = values[name] = file[name]
                is_fine = array.shape == shape and array.dtype.kind == 'f'
                if not (is_fine and (np.abs(array) < LARGEST).all()):
                    expected = f'finite numbers {shape}'
                    raise ConfigError(f'{path}: {name} is {shown(array)}, expected {expected}')
        return state, values

    def restore(self, state: MotionState, around: FloatArray) -> None:
        """Go on from a ``state`` and the values of its surroundings."""
        self._state, self._held = state, self._none
        self.surroundings.values, self.surroundings.is_told = around, True

    @property
    def state(self) -> MotionState:
        """Now; there is one after `advance`.

        Raises:
            SolveError: if there is none.
        """
        if self._state is None:
            raise SolveError('the arm has not moved yet')
        return self._state

    @property
    def backbone(self) -> Backbone:
        """The shape now."""
        return self._shape_of(self.state)

    def reeled_in(self) -> FloatArray:
        """Length that winches have reeled in [m], (tendons,).

        Of slack tendons what they hold, or what makes them taut where tensions are commanded.
        """
        taut = self._dynamics.displacements(self.state)
        return np.where(np.isnan(self._held), taut, self._held)

    @property
    def true_base_wrench(self) -> FloatArray:
        """Force and moment of all loads about the base, (6,) [N, N m]."""
        return self.state.base_wrench
