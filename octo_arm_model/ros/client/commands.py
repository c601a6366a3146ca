"""Tension commands within a tendon's limit, published one by one or as a profile."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike
from octo_arm_msgs.msg import TendonTensions
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.ros.messages import tensions_message
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.start import client_node
from octo_arm_model.simulation.movements import TOPIC, check_command, check_profile, tendon_limits
from octo_arm_model.simulation.profiles import CommandProfile, transition
from octo_arm_model.terminal import on_signals


class CommandPublisher:
    """Publishes tensions for the tendons of one arm at a time.

    Attributes:
        publisher: the ROS publisher, to count its subscriptions.
    """

    def __init__(self, node: Node, topic: str, config: Config | None = None) -> None:
        """Publish on ``topic`` of ``node``, for the arm of ``config`` or that of `use`."""
        self.publisher: Any = node.create_publisher(TendonTensions, topic, OUTPUT_QOS)
        self._config: Config | None = None
        if config is not None:
            self.use(config)

    def use(self, config: Config) -> None:
        """Command the tendons of ``config`` from now on, up to their limits."""
        self._config, self._limits = config, tendon_limits(config)

    def publish(self, tensions: ArrayLike, stamp: Time, frame: str = '') -> None:
        """Publish ``tensions`` (tendons,) or as `Arm.tension_shape` [N] of all tendons.

        Raises:
            TensionError: if they do not fit this arm, or one is beyond its limit; then nothing is
                published.
        """
        assert self._config is not None
        arm = self._config.arm
        checked = check_command(arm, tensions, self._limits)
        self.publisher.publish(tensions_message(checked, arm, stamp, frame))


RELEASE_TIME = 2.0  # [s] from the last tensions to slack
_POLL = 0.05  # [s] between looks
_SAME_SIGNAL = 0.3  # [s] within which signals count as one
_FLUSH_TIMEOUT = 5.0  # [s] for the last command to arrive

Report = Callable[[str, float, float], None]


def play(  # noqa: PLR0913 - options by keyword
    profile: CommandProfile,
    config: Config,
    *,
    topic: str,
    speed: float = 1.0,
    loop: bool = False,
    rate: float = 50.0,
    release: bool = True,
    timeout: float = 5.0,
    report: Report = lambda what, played, duration: None,
) -> None:
    """Publish ``profile`` on ``topic`` until it ends or SIGINT, SIGTERM or SIGHUP comes.

    Args:
        profile: tensions over time.
        config: the arm whose tendons it pulls, with their limits.
        topic: of type octo_arm_msgs/TendonTensions.
        speed: factor on its speed [-].
        loop: whether to repeat it.
        rate: of the commands [Hz].
        release: whether to ramp the tensions to zero at the end; a second signal stops the ramp.
        timeout: to wait for a subscription [s].
        report: called with the activity, the time it has taken and its duration [s].

    Raises:
        ConfigError: if ``topic`` is no name of a topic, or nobody subscribes to it.
        ProfileError: if ``profile`` goes beyond the limit of a tendon.
    """
    check_profile(profile, config.arm, tendon_limits(config))
    received: list[int] = []  # signals, which would otherwise leave the tendons tensioned
    with on_signals(received.append, _SAME_SIGNAL), client_node('octo_arm_player') as node:
        commands = _open(node, topic, config)
        publisher = commands.publisher
        player = _Player(commands, config, rate, received)
        if _find_listener(publisher, timeout, received, report):
            player.play(profile, speed, loop, partial(report, 'playing'))
            if release:
                player.release(partial(report, 'releasing'))
        # The process must not end before the last command has arrived.
        publisher.wait_for_all_acked(Duration(seconds=_FLUSH_TIMEOUT))


def _open(node: Node, topic: str, config: Config) -> CommandPublisher:
    """Publisher of commands; ConfigError if ``topic`` is no name."""
    try:
        return CommandPublisher(node, topic, config)
    except InvalidTopicNameException as error:
        raise ConfigError(f'topic is {topic!r}, expected a name such as {TOPIC}') from error


def _find_listener(
    publisher: Any, timeout: float, received: Sequence[int], report: Report
) -> bool:
    """Wait for a subscription; False if a signal came first, ConfigError after ``timeout`` [s]."""
    began = time.monotonic()
    while not publisher.get_subscription_count():
        waited = time.monotonic() - began
        if waited >= timeout:
            raise ConfigError(
                f'nobody subscribes to {publisher.topic_name}: start octo_arm_sim, or what drives '
                'the winches, or choose another topic'
            )
        report('waiting for a subscriber', waited, timeout)
        time.sleep(_POLL)
        if received:
            return False
    return True


class _Player:
    """Publishes profiles in real time."""

    def __init__(
        self, commands: CommandPublisher, config: Config, rate: float, received: Sequence[int]
    ) -> None:
        self._commands, self._rate = commands, rate
        self._received = received
        self._newest: FloatArray = np.zeros(len(config.arm.tendons))
        self._clock = Clock(clock_type=ClockType.SYSTEM_TIME)

    def play(
        self,
        profile: CommandProfile,
        speed: float,
        loop: bool,
        report: Callable[[float, float], None],
    ) -> None:
        """Publish ``profile`` up to its last row, or until the next interruption."""
        allowed = len(self._received)
        duration = profile.duration / speed
        began = time.monotonic()
        sent = 0
        while len(self._received) <= allowed:
            played = time.monotonic() - began
            self._send(profile.at(speed * played, loop=loop))
            report(played if loop else min(played, duration), duration)
            if played >= duration and not loop:
                return
            # Commands that are late are skipped.
            sent = max(sent + 1, int(played * self._rate))
            time.sleep(max(0.0, began + sent / self._rate - time.monotonic()))

    def release(self, report: Callable[[float, float], None]) -> None:
        """Bring the tensions smoothly to zero."""
        if self._newest.any():
            ramp = transition(self._newest, np.zeros_like(self._newest), RELEASE_TIME)
            self.play(ramp, 1.0, False, report)

    def _send(self, tensions: FloatArray) -> None:
        self._newest = tensions
        self._commands.publish(tensions, self._clock.now().to_msg())
