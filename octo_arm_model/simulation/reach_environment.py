"""A Gymnasium environment in which the tip of a moving arm is to reach a point."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from octo_arm_model.arm.errors import ArmDefinitionError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.arm.validation import vector, whole, within
from octo_arm_model.rod.checks import check_highest
from octo_arm_model.rod.motion import STEPS, Dynamics
from octo_arm_model.rod.motion_state import Inputs, MotionState
from octo_arm_model.terminal import missing

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(missing(error), name=error.name) from None

_TRIES = 100  # largest number of random tensions until their shape is a target


class Snapshot(NamedTuple):
    """The whole state of the environment, except the generator of targets."""

    state: MotionState  #: state of the arm
    target: FloatArray  #: target of the tip [m], (3,)
    steps: int  #: number of steps since the reset


class ReachEnvironment(gymnasium.Env[FloatArray, FloatArray]):
    """An environment in which the tip of a moving arm is to reach a target and can rest there.

    An action has a number for each tendon, in the order of their names, from -1 for slack to 1 for
    the highest tension; the tension changes linearly over a step. An observation has the position
    [m] and the velocity [m/s] of the tip, the vector from the tip to the target [m], and the
    tensions as actions. The reward is minus the distance over the length of the arm. An episode is
    truncated after a number of steps, and ends if no step of the motion succeeds, as when the arm
    is crushed; ``info`` has the distance [m], and the error if the motion ended.

    Environments may share one `Dynamics`, as states are values: many arms can move in one process,
    as in `gymnasium.vector.SyncVectorEnv`.

    Attributes:
        dynamics: dynamics of the arm.
        snapshot: present state, which may be saved and set again later.
    """

    metadata: dict[str, Any] = {'render_modes': []}  # noqa: RUF012

    def __init__(
        self,
        dynamics: Dynamics,
        highest: ArrayLike | None = None,
        period: float = 0.02,
        steps: int = 100,
        divisions: int = 4,
    ) -> None:
        """Move the arm of ``dynamics``.

        Args:
            dynamics: dynamics of the arm, its water and its loads.
            highest: highest tensions [N], one or of `Arm.tension_shape`; None for
                `default_highest`.
            period: duration of a step [s].
            steps: number of steps after which an episode is truncated.
            divisions: number of integration steps in a step of the environment.

        Raises:
            ArmDefinitionError: if a number is not > 0, or out of range for `Dynamics.step`.
            TensionError: if a highest tension is not > 0, or does not fit the tendons.
        """
        self.dynamics, arm = dynamics, dynamics.solver.arm
        for name, count in (('steps', steps), ('divisions', divisions)):
            if not whole(name, count):
                raise ArmDefinitionError(name, count, 'an integer > 0')
        within('period', period, divisions * STEPS[0], divisions * STEPS[1], 's')
        given = default_highest(arm) if highest is None else highest
        self._highest = check_highest(arm, given).reshape(arm.tension_shape)
        self._period, self._steps, self._divisions = period, steps, divisions
        count = self._highest.size
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (9 + count,), np.float64)
        self._rest = dynamics.at_rest(Inputs(0.0 * self._highest))
        self.snapshot = Snapshot(self._rest, np.zeros(3), 0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin at rest without tensions; ``options`` may have the ``target`` [m].

        Raises:
            ArmDefinitionError: if the target is not three finite numbers.
            SolveError: if no random tensions give a shape.
        """
        super().reset(seed=seed)
        given = (options or {}).get('target')
        target = self._random_target() if given is None else np.array(vector('target', given, 'm'))
        self.snapshot = Snapshot(self._rest, target, 0)
        return self._observe()

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Move on by one step, towards the tensions of an ``action``."""
        state, target, steps = self.snapshot
        tensions = 0.5 * (np.reshape(action, self._highest.shape) + 1.0) * self._highest
        failure, longest = '', self._period / self._divisions
        try:
            state = self.dynamics.go_on(state, Inputs(tensions), self._period, longest)
        except SolveError as error:
            failure = str(error)
        self.snapshot = Snapshot(state, target, steps + 1)
        observation, info = self._observe()
        reward = -info['distance'] / self.dynamics.solver.arm.length
        info |= {'error': failure} if failure else {}
        return observation, reward, bool(failure), steps + 1 >= self._steps, info

    def _observe(self) -> tuple[FloatArray, dict[str, Any]]:
        state, target, _ = self.snapshot
        tip, velocity = self.dynamics.backbone(state).tip, self.dynamics.velocities(state)[-1]
        pulled = 2.0 * state.tensions / self._highest.ravel() - 1.0
        away = target - tip
        return np.concatenate([tip, velocity, away, pulled]), {
            'distance': float(np.linalg.norm(away))
        }

    def _random_target(self) -> FloatArray:
        solver = self.dynamics.solver
        for _ in range(_TRIES):
            tensions = self.np_random.uniform(0.0, self._highest)
            tensions *= self.np_random.random(tensions.shape) < 0.5
            try:
                return np.array(solver.solve(tensions).tip)
            except SolveError:
                continue
        raise SolveError(f'none of {_TRIES} random sets of tensions has a shape')
