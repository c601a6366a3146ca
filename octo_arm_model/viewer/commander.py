"""The commanded tensions over time: from sliders, transitions and profiles."""

import math
import os
import shlex

import numpy as np
import yaml
from numpy.typing import ArrayLike

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import positive
from octo_arm_model.simulation.profiles import CommandProfile, transition

MOVE_TIME = 1.0  # [s] of a transition to a preset or to the first row of a profile
# [s] after a command in which a report that there is none does not count: it may be older.
_REPORT_TIME = 2.0


class Commander:
    """The tensions to command: constant, in transition to others, or played from a profile.

    They go on from the newest command, of this page or of another node. While no command is known
    they follow what is measured.

    Attributes:
        tensions: newest tensions [N], (tendons,).
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
        self._commanded_at: float | None = None  # time of the newest command [s]

    def pull(self, tendon: int, tension: float) -> None:
        """Set one tendon to ``tension`` [N] at once; a transition or profile is stopped."""
        self.stop()
        self.tensions[tendon] = tension
        self._is_due = True

    def follow(self, tensions: ArrayLike, now: float) -> None:
        """Go on from ``tensions`` (tendons,) [N] that another node commands at ``now`` [s].

        They stop a profile. A transition goes on, so that it can end the profile of another page.
        """
        self._commanded_at = now
        if self._transition is None:
            self.stop()
            self.tensions = np.array(tensions, dtype=np.float64)

    def measure(self, tensions: FloatArray) -> None:
        """Go on from measured ``tensions`` (tendons,) [N], unless a command is known."""
        if self._commanded_at is None and not self.is_moving:
            self.tensions = tensions.copy()

    def forget(self, now: float) -> None:
        """Follow what is measured from now on, as what drives the tendons has no command."""
        if self._commanded_at is not None and now > self._commanded_at + _REPORT_TIME:
            self._commanded_at = None

    def move(self, tensions: ArrayLike, now: float, duration: float = MOVE_TIME) -> None:
        """Start a smooth transition to ``tensions`` [N] at ``now`` [s], of ``duration`` [s]."""
        self.stop()
        self._transition, self._started = transition(self.tensions, tensions, duration), now

    def play(
        self, profile: CommandProfile, now: float, *, speed: float = 1.0, loop: bool = True
    ) -> None:
        """Play ``profile`` after a smooth transition to it, at a ``speed`` > 0 [-]."""
        positive('speed', speed, '-')
        self.move(profile.at(0.0), now)
        self.profile, self._speed, self._loop = profile, speed, loop

    def change_speed(self, speed: float, now: float) -> None:
        """Continue the profile at another ``speed`` > 0 [-], else ArmDefinitionError."""
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
        if not is_due:
            return None
        self._commanded_at = now
        return self.tensions.copy()

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
