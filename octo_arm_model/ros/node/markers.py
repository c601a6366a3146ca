"""The arm as RViz draws it, for whoever looks, and no oftener than they can see."""

from __future__ import annotations

from typing import NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.timer import Timer
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.wire.cdr_drawing import MarkersWriter
from octo_arm_model.wire.stamp import Stamp

TOPIC = 'markers'


class _Shape(NamedTuple):
    backbone: Backbone
    stamp: Stamp


class MarkerPublisher:
    """Publishes markers of the newest shape at a limited rate, while somebody listens."""

    def __init__(self, node: Node, publisher: Publisher) -> None:
        """Publish with ``publisher`` of ``node``."""
        self._node, self._publisher = node, publisher
        self._writer: MarkersWriter | None = None
        self._timer: Timer | None = None
        self._waiting: _Shape | None = None
        self._is_clean, self._largest = False, 0.0

    def describe(self, writer: MarkersWriter, rate: float) -> None:
        """Shapes to come are drawn by ``writer``, at most ``rate`` [Hz] of them; 0 for all."""
        self.stop()
        self._writer = writer
        self._is_clean, self._largest = False, 0.0
        if rate:
            # Time of ROS may run faster than that of whoever looks.
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = self._node.create_timer(1.0 / rate, self._on_time, clock=clock)
            self._timer.cancel()

    def stop(self) -> None:
        """Draw no more, until `describe`."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._timer = self._waiting = self._writer = None

    def forget(self) -> None:
        """Do not draw what waits for its time."""
        self._waiting = None

    def publish(self, backbone: Backbone, stamp: Stamp) -> None:
        """Draw this shape now, or when the time has come if there is no newer one by then."""
        if not self._publisher.get_subscription_count():
            self.forget()
            return
        shape = _Shape(backbone, stamp)
        if self._timer is None:
            self._draw(shape)
        elif self._timer.is_canceled():
            self._draw(shape)
            self._timer.reset()
        else:
            self._waiting = shape

    def _on_time(self) -> None:
        """Draw what has come meanwhile; if nothing has, the next is drawn at once."""
        shape, self._waiting = self._waiting, None
        if shape is None:
            if self._timer is not None:
                self._timer.cancel()
            return
        try:
            self._draw(shape)
        except RuntimeError:
            # A signal ends the context in the middle of whatever is done: no fault of anybody's.
            if self._node.context.ok():
                raise

    def _draw(self, shape: _Shape) -> None:
        if self._writer is None:
            return
        if not self._is_clean:
            # Nothing of another arm may stay.
            self._publisher.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
            self._is_clean = True
        # Red is the largest tension drawn so far, so that colours can be compared over time.
        self._largest = max(self._largest, float(shape.backbone.tensions.max()))
        data = self._writer.write(shape.backbone, *shape.stamp, self._largest or None)
        self._publisher.publish(data)
