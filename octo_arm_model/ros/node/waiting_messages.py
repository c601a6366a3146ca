"""Measurements that wait for the transform of their time: it is usually published after them."""

from __future__ import annotations

import collections
import time
from collections.abc import Callable
from typing import NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.timer import Timer

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.ros.node.inputs import Intake
from octo_arm_model.ros.node.sensor_frames import NotKnownYet, SensorFrames

MOST_WAITING = 50  # messages, beyond which the oldest is refused
LARGEST = 50_000  # bytes of a message that waits
LONGEST = 2.0  # [s] that a message waits
_PERIOD = 0.5  # [s] between looks for those that have waited for too long


class _Waiting(NamedTuple):
    topic: str
    data: bytes
    read: Callable[[bytes], None]
    error: NotKnownYet
    until: float


class WaitingMessages:
    """Reads messages once the transforms are known that they need."""

    def __init__(self, intake: Intake, frames: SensorFrames) -> None:
        """Wait for transforms of ``frames``."""
        self._intake, self._frames = intake, frames
        self._waiting: collections.deque[_Waiting] = collections.deque()
        self._timer: Timer | None = None
        self._is_due = False
        frames.on_change = self._on_transforms

    def open(self) -> None:
        """Begin to refuse what waits for too long."""
        # Steady: ROS time may stand still.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self._intake.node.create_timer(_PERIOD, self._expire, clock=clock)

    def close(self) -> None:
        """Forget what waits."""
        self.forget()
        if self._timer is not None:
            self._intake.node.destroy_timer(self._timer)
        self._timer, self._is_due = None, False

    def forget(self) -> None:
        """Forget what waits; it is of another arm."""
        self._waiting.clear()

    def take(self, topic: str, data: bytes, read: Callable[[bytes], None]) -> None:
        """Call ``read`` with ``data`` that came on ``topic``, now or once its frame is known.

        Raises:
            OctoArmError: what ``read`` raises now, but for a `NotKnownYet` that is waited for.
        """
        try:
            read(data)
        except NotKnownYet as error:
            if len(data) > LARGEST:
                raise
            if len(self._waiting) >= MOST_WAITING:
                self._refuse_oldest()
            until = time.monotonic() + LONGEST
            self._waiting.append(_Waiting(topic, data, read, error, until))

    def _refuse_oldest(self) -> None:
        oldest = self._waiting.popleft()
        self._intake.refuse(oldest.topic, oldest.error)

    def _expire(self) -> None:
        while self._waiting and self._waiting[0].until < time.monotonic():
            self._refuse_oldest()

    def _on_transforms(self) -> None:
        if self._waiting and not self._is_due:
            self._is_due = True
            self._intake.work.add(self._read_next)

    def _read_next(self) -> bool:
        """Read the oldest message whose transform is known; whether there was one."""
        for one in self._waiting:
            if self._frames.reaches(one.error):
                break
        else:
            self._is_due = False
            return False
        self._waiting.remove(one)
        try:
            one.read(one.data)
        except OctoArmError as error:
            self._intake.refuse(one.topic, error)
        return True
