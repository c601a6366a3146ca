"""The publisher of markers of the arm for RViz, at a limited rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.ros.node.outputs.output import Output
from octo_arm_model.ros.work.interruption import until_shutdown
from octo_arm_model.wire.cdr.drawing import MarkersWriter
from octo_arm_model.wire.stamp import Stamp

MARKERS_TOPIC = 'markers'


class _StampedBackbone(NamedTuple):
    backbone: Backbone
    stamp: Stamp
    more: Callable[[], bytes] | None


class MarkerPublisher:
    """Publishes markers of the newest backbone at a limited rate, while somebody subscribes."""

    def __init__(self, node: Node, output: Output) -> None:
        """Publish with ``output`` of ``node``."""
        self._node, self._output = node, output
        self._writer: MarkersWriter | None = None
        self._timer: Timer | None = None
        self._waiting: _StampedBackbone | None = None
        self._is_clean, self._largest = False, 0.0
        self._arm: Arm | None = None
        self._rate = 0.0

    def describe(self, writer: MarkersWriter, rate: float, arm: Arm) -> None:
        """Draw ``arm`` with ``writer`` from now on, at ``rate`` [Hz] at most; 0 for each shape.

        Markers of another arm are deleted first. Of the same one they are replaced, as where
        another hypothesis has become the most probable.
        """
        if arm is not self._arm:
            self._is_clean, self._largest = False, 0.0
        self.forget()
        self._writer, self._arm = writer, arm
        if rate == self._rate:
            return
        self._stop_timer()
        self._rate = rate
        if rate:
            # Steady: ROS time may run faster than real time.
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = self._node.create_timer(1.0 / rate, self._on_time, clock=clock)
            self._timer.cancel()

    def stop(self) -> None:
        """Publish nothing until `describe`."""
        self._stop_timer()
        self._waiting = self._writer = self._arm = None

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._timer, self._rate = None, 0.0

    def forget(self) -> None:
        """Drop the backbone that waits for the timer."""
        self._waiting = None

    def publish(
        self, backbone: Backbone, stamp: Stamp, more: Callable[[], bytes] | None = None
    ) -> None:
        """Publish this backbone now, or at the next timer if there is no newer one by then.

        ``more`` makes a message of further markers that go with it.
        """
        if not self._output.is_heard:
            self.forget()
            return
        stamped = _StampedBackbone(backbone, stamp, more)
        if self._timer is None:
            self._draw(stamped)
        elif self._timer.is_canceled():
            self._draw(stamped)
            self._timer.reset()
        else:
            self._waiting = stamped

    def _on_time(self) -> None:
        """Publish the backbone that waits; if none does, the next is published at once."""
        stamped, self._waiting = self._waiting, None
        if stamped is None:
            if self._timer is not None:
                self._timer.cancel()
            return
        with until_shutdown(self._node.context):
            self._draw(stamped)

    def _draw(self, stamped: _StampedBackbone) -> None:
        if self._writer is None:
            return
        if not self._is_clean:
            # Markers of the arm before may still be shown.
            self._output.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
            self._is_clean = True
        # Red is the largest tension so far: colours stay comparable over time.
        self._largest = max(self._largest, float(stamped.backbone.tensions.max()))
        data = self._writer.write(stamped.backbone, *stamped.stamp, self._largest or None)
        self._output.publish(data)
        if stamped.more is not None:
            self._output.publish(stamped.more())
