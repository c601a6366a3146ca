"""The arm as RViz draws it: body, anchorages, and tendons in the colour of their tension."""

from __future__ import annotations

from operator import itemgetter

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model.analysis.arm_mesh import SIDES, Drawing, Drawn, tension_colours
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.ros.messages import pose_message

TOPIC = 'markers'
BODY_COLOUR = (0.85, 0.55, 0.5, 0.45)  # the tendons inside show through
DISC_COLOUR = (0.25, 0.25, 0.3, 0.8)


class ArmMarkers:
    """Draws shapes of one arm, many times.

    Namespaces and ids stay the same from message to message, so each message replaces the one
    before: ``body`` 0, ``anchorages`` and ``tendons`` from 1 on, in the arm's order.
    """

    def __init__(
        self,
        arm: Arm,
        s: FloatArray,
        *,
        widen: bool = False,
        prefix: str = '',
        sides: int = SIDES,
    ) -> None:
        """Prepare to draw ``arm``; see `Drawing`.

        ``prefix`` is what namespaces begin with, to tell arms apart that share a topic.
        """
        self._drawing = Drawing(arm, s, widen=widen, sides=sides)
        self._prefix = prefix
        # Picks the corner of every triangle from the list of vertices, which has each but once.
        self._corners = itemgetter(*self._drawing.triangles.ravel().tolist())

    def build(
        self,
        backbone: Backbone,
        stamp: Time,
        frame_id: str,
        largest_tension: float | None = None,
    ) -> MarkerArray:
        """Markers of one shape, all with the same header.

        Args:
            backbone: a single solution with the stations this was prepared for.
            stamp: time of the shape.
            frame_id: frame the backbone is expressed in.
            largest_tension: tension drawn in full red [N], as is all beyond it; None for the
                largest of this shape.
        """
        header = Header(stamp=stamp, frame_id=frame_id)
        drawn = self._drawing.draw(backbone.position, backbone.quaternion, backbone.q)
        colours = tension_colours(backbone.tensions.ravel(), largest_tension)
        markers = [self._body(header, drawn)]
        markers += self._discs(header, drawn)
        markers += self._tendons(header, drawn, colours)
        return MarkerArray(markers=markers)

    def _body(self, header: Header, drawn: Drawn) -> Marker:
        marker = self._marker(header, 'body', 0, Marker.TRIANGLE_LIST, BODY_COLOUR)
        # RViz multiplies the points by it.
        marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
        marker.points = list(self._corners(_points(drawn.vertices)))
        return marker

    def _discs(self, header: Header, drawn: Drawn) -> list[Marker]:
        markers = []
        for index, radius in enumerate(drawn.disc_radius.tolist()):
            marker = self._marker(header, 'anchorages', index + 1, Marker.CYLINDER, DISC_COLOUR)
            marker.pose = pose_message(drawn.disc_position[index], drawn.disc_quaternion[index])
            thickness = self._drawing.disc_thickness
            marker.scale = Vector3(x=2.0 * radius, y=2.0 * radius, z=thickness)
            markers.append(marker)
        return markers

    def _tendons(self, header: Header, drawn: Drawn, colours: FloatArray) -> list[Marker]:
        markers = []
        for index, (path, colour) in enumerate(zip(drawn.tendons, colours.tolist(), strict=True)):
            marker = self._marker(header, 'tendons', index + 1, Marker.LINE_STRIP, tuple(colour))
            marker.scale = Vector3(x=self._drawing.line_width)
            marker.points = _points(path)
            markers.append(marker)
        return markers

    def _marker(
        self, header: Header, namespace: str, number: int, kind: int, colour: tuple[float, ...]
    ) -> Marker:
        """Marker that stays until the next one of its name, its pose the origin of its frame."""
        red, green, blue, alpha = colour
        return Marker(
            header=header,
            ns=self._prefix + namespace,
            id=number,
            type=kind,
            action=Marker.ADD,
            pose=Pose(orientation=Quaternion(w=1.0)),
            color=ColorRGBA(r=red, g=green, b=blue, a=alpha),
        )


def _points(array: FloatArray) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in array.tolist()]
