"""The commanded tensions over time: set by sliders, in transition, from a profile or a search."""

import contextlib
import math
import os
import queue
import shlex
import threading
from collections.abc import Callable

import numpy as np
import yaml
from numpy.typing import ArrayLike

from octo_arm_model.analysis.inverse import Inverse, find_tensions
from octo_arm_model.analysis.targets import TipPosition
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive
from octo_arm_model.rod.solver import Solver
from octo_arm_model.simulation.profiles import CommandProfile, transition

MOVE_TIME = 1.0  # [s] to a preset or to the first row of a profile


class Commander:
    """Tensions to command: constant, in transition to others, or played from a profile.

    Attributes:
        tensions: commanded last [N], (tendons,).
        profile: the profile that is played; None for none.
    """

    def __init__(self, tensions: ArrayLike) -> None:
        """Begin at ``tensions`` [N], (tendons,), without a command."""
        self.tensions = np.array(tensions, dtype=np.float64)
        self.profile: CommandProfile | None = None
        self._speed, self._loop = 1.0, False
        self._transition: CommandProfile | None = None
        self._began = 0.0
        self._is_due = False

    def pull(self, tendon: int, tension: float) -> None:
        """Set one tendon to ``tension`` [N] at once; a transition or profile is stopped."""
        self.stop()
        self.tensions[tendon] = tension
        self._is_due = True

    def move(self, tensions: ArrayLike, now: float, duration: float = MOVE_TIME) -> None:
        """Begin a smooth transition to ``tensions`` [N] at ``now``, of ``duration`` [s]."""
        self.stop()
        self._transition, self._began = transition(self.tensions, tensions, duration), now

    def play(
        self, profile: CommandProfile, now: float, *, speed: float = 1.0, loop: bool = True
    ) -> None:
        """Play ``profile`` from its beginning, after a smooth transition to it.

        Raises:
            ArmDefinitionError: if ``speed`` is not finite or not > 0.
        """
        positive('speed', speed, '-')
        self.move(profile.at(0.0), now)
        self.profile, self._speed, self._loop = profile, speed, loop

    def change_speed(self, speed: float, now: float) -> None:
        """Continue the profile at another ``speed``.

        Raises:
            ArmDefinitionError: if it is not finite or not > 0.
        """
        positive('speed', speed, '-')
        if self.profile is not None and self._transition is None:
            self._began = now - (now - self._began) * self._speed / speed
        self._speed = speed

    def stop(self) -> None:
        """Hold the tensions."""
        self.profile = self._transition = None

    @property
    def is_moving(self) -> bool:
        """Whether there is a transition or a profile is played."""
        return self._transition is not None or self.profile is not None

    def advance(self, now: float) -> FloatArray | None:
        """Tensions to command at ``now`` [s], (tendons,) [N]; None if they have not changed."""
        if self._transition is not None:
            self._set(self._transition.at(now - self._began))
            if now - self._began >= self._transition.duration:
                self._began += self._transition.duration
                self._transition = None
        elif self.profile is not None:
            time = (now - self._began) * self._speed
            self._set(self.profile.at(time, loop=self._loop))
            if time >= self.profile.duration and not self._loop:
                self.profile = None
        is_due, self._is_due = self._is_due, False
        return self.tensions.copy() if is_due else None

    def _set(self, tensions: FloatArray) -> None:
        self._is_due = self._is_due or not np.array_equal(tensions, self.tensions)
        self.tensions = np.array(tensions)


def as_yaml(arm: Arm, tensions: FloatArray, flow: bool | None = None) -> str:
    """``tensions`` (tendons,) [N] as the YAML of an octo_arm_msgs/msg/TendonTensions.

    In one line where it is to ``flow``.
    """
    message = {'name': list(arm.tendon_names), 'tension': np.round(tensions, 6).tolist()}
    return yaml.safe_dump(message, default_flow_style=flow, sort_keys=False, width=math.inf)


def as_shell_line(arm: Arm, tensions: FloatArray, topic: str) -> str:
    """``tensions`` (tendons,) [N] as a line for a shell that publishes them once on ``topic``.

    It names the ROS domain of this process, unless that is 0.
    """
    message = shlex.quote(as_yaml(arm, tensions, flow=True).strip())
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    setting = '' if domain == '0' else f'ROS_DOMAIN_ID={shlex.quote(domain)} '
    return f'{setting}ros2 topic pub -1 {topic} octo_arm_msgs/msg/TendonTensions {message}'


Answer = Inverse | OctoArmError
Request = tuple[FloatArray, FloatArray]  # tip [m] and tensions to begin from [N]


class _Superseded(Exception):
    """There is a newer target, or none is searched for any more."""


class TargetSearch:
    """Finds tensions for the newest of the requested targets; older ones are dropped."""

    def __init__(
        self, solver: Solver, highest: FloatArray, deliver: Callable[[Answer], None]
    ) -> None:
        """Search with ``solver`` up to ``highest`` [N]; ``deliver`` is called in its thread."""
        self._solver, self._deliver = solver, deliver
        self._highest = highest.reshape(solver.arm.tension_shape)
        self._requests: queue.SimpleQueue[Request | None] = queue.SimpleQueue()
        self._last: Request | None = None
        # A daemon: the end of a program does not wait for a search, as it would for a pool.
        threading.Thread(target=self._work, name='search', daemon=True).start()

    def request(self, tip: FloatArray, start: FloatArray) -> None:
        """Search tensions for the tip at ``tip`` (3,) [m], from ``start`` (tendons,) [N]."""
        start = np.clip(start.reshape(self._highest.shape), 0.0, self._highest)
        self._last = np.array(tip), start
        self._requests.put(self._last)

    def close(self) -> None:
        """Search no more."""
        self._last = None
        self._requests.put(None)

    def _work(self) -> None:
        while (request := self._requests.get()) is not None:
            with contextlib.suppress(_Superseded):
                self._search(request)

    def _search(self, request: Request) -> None:
        def check() -> None:
            if request is not self._last:
                raise _Superseded

        check()
        try:
            given = self._solver, TipPosition(request[0]), self._highest
            answer: Answer = find_tensions(*given, start=request[1], pause=check)
        except OctoArmError as error:
            answer = error
        check()
        self._deliver(answer)
