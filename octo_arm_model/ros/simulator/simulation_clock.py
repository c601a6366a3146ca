"""When the simulator steps: with the node's clock, or with a time of its own on /clock."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from octo_arm_model.ros.qos import create_publisher
from octo_arm_model.ros.work import SLICE, until_shutdown

TOPIC = '/clock'
_AGAIN = 1e-3  # [s] between slices of steps, in which others are answered
_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


class SimulationClock:
    """Calls a function once a period.

    Attributes:
        is_paused: whether time stands still.
        period: of the steps [s].
    """

    def __init__(self, node: Node, step: Callable[[float, Time], None]) -> None:
        """Call ``step`` with the time that it goes on by [s] and the time then."""
        self._node, self._step = node, step
        self.is_paused = False
        self.period, self._is_own, self._slice = 0.0, False, 0.0
        self._timer: Timer | None = None
        self._pace: tuple[float, ...] = ()
        self._last, self._time_ns = 0, 0
        self._publisher: Publisher | None = None

    def use(self, rate: float, is_own: bool, factor: float) -> None:
        """Step at ``rate`` [Hz] of the node's clock, or of an own one.

        That goes ``factor`` times as fast as the wall clock; 0 for as fast as it goes.
        """
        pace, self._pace = self._pace, (rate, is_own, factor)
        if pace == self._pace:
            return
        self.period, self._is_own = 1.0 / rate, is_own
        self._slice = 0.0 if factor else SLICE
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        if not is_own:
            self._timer = self._node.create_timer(self.period, self._go_on)
            return
        self._last = 0
        if self._publisher is None:
            self._publisher = create_publisher(self._node, ClockMessage, TOPIC, _QOS)
        self._timer = self._node.create_timer(
            self.period / factor if factor else _AGAIN, self._go_on_alone,
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )  # fmt: skip

    def reset(self) -> None:
        """Begin anew, where time is the simulator's own."""
        self._time_ns = 0

    def step(self) -> None:
        """Go on by one period, also while paused."""
        self._advance(self.period, self._node.get_clock().now())

    def _go_on(self) -> None:
        clock_time = self._node.get_clock().now()
        now = clock_time.nanoseconds
        if now == self._last:
            return  # where several clock messages wait, rclpy calls the timer once for each
        # Time that is not set yet is 0. Where it jumps back, as when a bag is played again, the
        # winches do not move.
        elapsed = 1e-9 * (now - self._last) if self._last else self.period
        self._last = now
        if not self.is_paused:
            self._advance(max(elapsed, 0.0), clock_time)

    def _go_on_alone(self) -> None:
        until = time.monotonic() + self._slice
        while not self.is_paused:
            self.step()
            if time.monotonic() >= until:
                return

    def _advance(self, elapsed: float, now: Time) -> None:
        with until_shutdown(self._node.context):
            if self._is_own and self._publisher is not None:
                self._time_ns += round(1e9 * elapsed)
                now = Time(nanoseconds=self._time_ns)
                # First, so that who hears what comes at this time knows it.
                self._publisher.publish(ClockMessage(clock=now.to_msg()))
            self._step(elapsed, now)
