"""The commanded tensions over time: from sliders, transitions, profiles and the target search."""

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

MOVE_TIME = 1.0  # [s] of a transition to a preset or to the first row of a profile


class Commander:
    """The tensions to command: constant, in transition to others, or played from a profile.

    Attributes:
        tensions: newest commanded tensions [N], (tendons,).
        profile: the profile that is played, or None.
        commands: number of commands so far, of which each replaces the one before.
    """

    def __init__(self, tensions: ArrayLike) -> None:
        """Start at ``tensions`` [N], (tendons,), without a command."""
        self.tensions = np.array(tensions, dtype=np.float64)
        self.profile: CommandProfile | None = None
        self.commands = 0
        self._speed, self._loop = 1.0, False
        self._transition: CommandProfile | None = None
        self._started = 0.0
        self._is_due = False

    def pull(self, tendon: int, tension: float) -> None:
        """Set one tendon to ``tension`` [N] at once; a transition or profile is stopped."""
        self.stop()
        self.tensions[tendon] = tension
        self._is_due = True

    def move(self, tensions: ArrayLike, now: float, duration: float = MOVE_TIME) -> None:
        """Start a smooth transition to ``tensions`` [N] at ``now`` [s], of ``duration`` [s]."""
        self.stop()
        self._transition, self._started = transition(self.tensions, tensions, duration), now

    def play(
        self, profile: CommandProfile, now: float, *, speed: float = 1.0, loop: bool = True
    ) -> None:
        """Play ``profile`` from its first row, after a smooth transition to it.

        Raises:
            ArmDefinitionError: if ``speed`` is not finite or not > 0.
        """
        positive('speed', speed, '-')
        self.move(profile.at(0.0), now)
        self.profile, self._speed, self._loop = profile, speed, loop

    def change_speed(self, speed: float, now: float) -> None:
        """Continue the profile at another ``speed`` [-].

        Raises:
            ArmDefinitionError: if ``speed`` is not finite or not > 0.
        """
        positive('speed', speed, '-')
        if self.profile is not None and self._transition is None:
            self._started = now - (now - self._started) * self._speed / speed
        self._speed = speed

    def stop(self) -> None:
        """Stop any transition or profile, and hold the tensions."""
        self.profile = self._transition = None
        self.commands += 1

    @property
    def is_moving(self) -> bool:
        """Whether a transition or a profile is in progress."""
        return self._transition is not None or self.profile is not None

    def advance(self, now: float) -> FloatArray | None:
        """Return the tensions for ``now`` [s], (tendons,) [N]; None if they have not changed."""
        if self._transition is not None:
            self._set(self._transition.at(now - self._started))
            if now - self._started >= self._transition.duration:
                self._started += self._transition.duration
                self._transition = None
        elif self.profile is not None:
            time = (now - self._started) * self._speed
            self._set(self.profile.at(time, loop=self._loop))
            if time >= self.profile.duration and not self._loop:
                self.profile = None
        is_due, self._is_due = self._is_due, False
        return self.tensions.copy() if is_due else None

    def _set(self, tensions: FloatArray) -> None:
        self._is_due = self._is_due or not np.array_equal(tensions, self.tensions)
        self.tensions = np.array(tensions)


def as_yaml(arm: Arm, tensions: FloatArray, flow: bool | None = None) -> str:
    """Return ``tensions`` (tendons,) [N] as YAML of an octo_arm_msgs/msg/TendonTensions.

    With ``flow`` the text is a single line.
    """
    message = {'name': list(arm.tendon_names), 'tension': np.round(tensions, 6).tolist()}
    return yaml.safe_dump(message, default_flow_style=flow, sort_keys=False, width=math.inf)


def as_shell_line(arm: Arm, tensions: FloatArray, topic: str) -> str:
    """Return a shell command that publishes ``tensions`` (tendons,) [N] once on ``topic``.

    It sets the ROS domain of this process, unless that is 0.
    """
    message = shlex.quote(as_yaml(arm, tensions, flow=True).strip())
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    setting = '' if domain == '0' else f'ROS_DOMAIN_ID={shlex.quote(domain)} '
    return f'{setting}ros2 topic pub -1 {topic} octo_arm_msgs/msg/TendonTensions {message}'


Answer = Inverse | OctoArmError
Request = tuple[FloatArray, FloatArray]  # target of the tip [m] and initial tensions [N]


class _Superseded(Exception):
    """Raised in a search if there is a newer target, or if the search is closed."""


class TargetSearch:
    """Finds tensions for the newest requested target in a thread; older targets are dropped."""

    def __init__(
        self, solver: Solver, highest: FloatArray, deliver: Callable[[Answer], None]
    ) -> None:
        """Search with ``solver`` up to ``highest`` [N]; its thread calls ``deliver``."""
        self._solver, self._deliver = solver, deliver
        self._highest = highest.reshape(solver.arm.tension_shape)
        self._requests: queue.SimpleQueue[Request | None] = queue.SimpleQueue()
        self._last: Request | None = None
        # A program that ends does not wait for a daemon thread, but would wait for a pool.
        threading.Thread(target=self._work, name='search', daemon=True).start()

    def request(self, tip: FloatArray, start: FloatArray) -> None:
        """Search tensions that move the tip to ``tip`` (3,) [m], from ``start`` (tendons,) [N]."""
        start = np.clip(start.reshape(self._highest.shape), 0.0, self._highest)
        self._last = np.array(tip), start
        self._requests.put(self._last)

    def close(self) -> None:
        """End the search and its thread."""
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
            arguments = self._solver, TipPosition(request[0]), self._highest
            answer: Answer = find_tensions(*arguments, start=request[1], pause=check)
        except OctoArmError as error:
            answer = error
        check()
        self._deliver(answer)
