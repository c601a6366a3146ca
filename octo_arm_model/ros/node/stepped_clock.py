"""The clock of a node, to which stamps of messages are compared."""

from __future__ import annotations

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node

from octo_arm_model.wire.stamp import Stamp, time_of

# Tolerance in steps of /clock: a message may precede the next one, and one may be lost.
_STEPS = 2.0


class SteppedClock:
    """The clock of a node, which /clock moves in steps where time is simulated."""

    def __init__(self, node: Node) -> None:
        """Follow the clock of ``node``."""
        self._clock = node.get_clock()
        self._step = 0.0
        every_step = JumpThreshold(
            min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=False
        )
        self._jumps = self._clock.create_jump_callback(every_step, post_callback=self._on_step)

    def _on_step(self, jump: TimeJump) -> None:
        """Record the last step of simulated time."""
        step = 1e-9 * jump.delta.nanoseconds
        # Not the first one, from zero.
        self._step = step if 1e-9 * self.now_ns > step else 0.0

    @property
    def now(self) -> Stamp:
        """The time; zero while it is simulated and not known yet."""
        return Stamp.from_ns(self.now_ns)

    @property
    def now_ns(self) -> int:
        """The same [ns]."""
        # For every message: the clock's own `now` takes five times as long.
        return int(self._clock.handle.get_now().nanoseconds)

    def time_of(self, stamp: Stamp | None) -> Stamp:
        """The ``stamp`` of a message; the time of receipt where it has none.

        Raises:
            MessageError: if it is no time.
        """
        return time_of(stamp) or self.now

    def ahead(self, stamp: Stamp, now_ns: int) -> float:
        """How far ``stamp`` is ahead of ``now_ns`` by more than the clock's steps explain [s].

        Negative where it is behind, and zero while the time is not known.
        """
        return 1e-9 * (stamp.ns - now_ns) - _STEPS * self._step if now_ns else 0.0
