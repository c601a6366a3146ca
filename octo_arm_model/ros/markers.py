"""The arm as RViz draws it: body, anchorages, and tendons in the colour of their tension."""

from __future__ import annotations

import math
from operator import itemgetter

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model.arm import Arm
from octo_arm_model.backbone import Backbone
from octo_arm_model.hints import FloatArray, IntArray
from octo_arm_model.ros.frames import anchorage_stations
from octo_arm_model.ros.messages import pose_message
from octo_arm_model.rotation import Quaternions

TOPIC = 'markers'
SIDES = 12
# More rings than these cannot be told apart on a screen, but cost as much as the rest.
MOST_RINGS = 101

BODY_COLOUR = (0.85, 0.55, 0.5, 0.45)  # the tendons inside show through
DISC_COLOUR = (0.25, 0.25, 0.3, 0.8)
SLACK_COLOUR = (0.6, 0.6, 0.6, 1.0)
TAUT_COLOUR = (1.0, 0.0, 0.0, 1.0)

# Sizes relative to the length of the arm, but for the rim of the discs, relative to the radius.
_LINE_WIDTH = 0.002
_DISC_THICKNESS = 0.004
_DISC_RIM = 1.05  # surfaces in the same place would flicker

# A cylinder's axis is its z axis, that of a cross section its x axis: a quarter turn about y.
_UPRIGHT = Quaternions.from_xyzw((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))


class ArmMarkers:
    """Draws shapes of one arm, many times.

    What does not depend on the shape is tabulated once. Namespaces and ids stay the same from
    message to message, so each message replaces the one before: ``body`` 0, ``anchorages`` and
    ``tendons`` from 1 on, in the arm's order.
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
        """Prepare to draw ``arm``.

        Args:
            arm: the arm.
            s: stations of the backbones to come [m], (stations,), as `Solver.grid` has them.
            widen: whether cross sections that are compressed get wider by (1 + q)^-1/2 and take
                their tendons along, as those of an elastic law that keeps the volume do.
            prefix: what namespaces begin with, to tell arms apart that share a topic.
            sides: corners of the polygons that stand for circles.
        """
        self._arm, self._widen, self._prefix = arm, widen, prefix
        self._anchorages = anchorage_stations(arm, s)
        rings = np.linspace(0.0, s.size - 1.0, min(s.size, MOST_RINGS)).round().astype(np.int64)
        self._rings = np.union1d(rings, self._anchorages)
        self._ends = np.searchsorted(self._rings, self._anchorages)
        self._radius = arm.body.radius(s[self._rings])
        angle = np.linspace(0.0, 2.0 * math.pi, sides, endpoint=False)
        circle = np.array([np.cos(angle), np.sin(angle)])
        self._outline = circle[:, :, np.newaxis] * self._radius
        self._offsets = np.array(arm.tendon_offsets(s[self._rings]))
        # Picks the corner of every triangle from the list of vertices, which has each but once.
        self._corners = itemgetter(*_triangles(self._rings.size, sides).ravel().tolist())

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
        position = backbone.position[self._rings]
        frame = Quaternions.from_xyzw(backbone.quaternion[self._rings]).matrix()
        width = np.ones(self._rings.size)
        if self._widen:
            width = (1.0 + backbone.q[self._rings]) ** -0.5
        # Rows are x, y, z in the frame of the backbone, columns the axes n and b.
        across = frame[:, 1:] * width
        markers = [self._body(header, position, across)]
        markers += self._discs(header, backbone, width)
        markers += self._tendons(header, position, across, backbone.tensions, largest_tension)
        return MarkerArray(markers=markers)

    def _body(self, header: Header, position: FloatArray, across: FloatArray) -> Marker:
        surface = _place(position, across, self._outline).reshape(-1, 3)
        vertices = _points(np.concatenate([surface, position[[0, -1]]]))
        marker = self._marker(header, 'body', 0, Marker.TRIANGLE_LIST, BODY_COLOUR)
        # RViz multiplies the points by it.
        marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
        marker.points = list(self._corners(vertices))
        return marker

    def _discs(self, header: Header, backbone: Backbone, width: FloatArray) -> list[Marker]:
        turned = np.empty((self._anchorages.size, 4))
        frames = Quaternions.from_xyzw(backbone.quaternion[self._anchorages])
        frames.times(_UPRIGHT).write_xyzw(turned)
        radius = np.maximum(self._radius, self._arm.body.disc_radius)[self._ends]
        diameters = 2.0 * _DISC_RIM * radius * width[self._ends]
        markers = []
        for index, diameter in enumerate(diameters.tolist()):
            marker = self._marker(header, 'anchorages', index + 1, Marker.CYLINDER, DISC_COLOUR)
            marker.pose = pose_message(backbone.position[self._anchorages[index]], turned[index])
            thickness = _DISC_THICKNESS * self._arm.length
            marker.scale = Vector3(x=diameter, y=diameter, z=thickness)
            markers.append(marker)
        return markers

    def _tendons(
        self,
        header: Header,
        position: FloatArray,
        across: FloatArray,
        tensions: FloatArray,
        largest: float | None,
    ) -> list[Marker]:
        paths = _place(position, across, self._offsets)
        colours = tension_colours(tensions.ravel(), largest).tolist()
        markers = []
        for index, section in enumerate(self._arm.tendon_section):
            marker = self._marker(
                header, 'tendons', index + 1, Marker.LINE_STRIP, tuple(colours[index])
            )
            marker.scale = Vector3(x=_LINE_WIDTH * self._arm.length)
            marker.points = _points(paths[index, : self._ends[section - 1] + 1])
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


def tension_colours(tensions: FloatArray, largest: float | None = None) -> FloatArray:
    """Red, green, blue, alpha in [0, 1] of each tension, (tensions, 4), from grey to red.

    Args:
        tensions: tensions [N], (tensions,).
        largest: tension of full red [N]; None for the largest of ``tensions``.
    """
    scale = tensions.max(initial=0.0) if largest is None else largest
    share = np.zeros(tensions.shape)
    if scale > 0.0:
        share = np.clip(tensions / scale, 0.0, 1.0)
    slack, taut = np.array(SLACK_COLOUR), np.array(TAUT_COLOUR)
    return slack + share[:, np.newaxis] * (taut - slack)


def _place(position: FloatArray, across: FloatArray, places: FloatArray) -> FloatArray:
    """Points (k, rings, 3) [m] at ``places`` (2, k, rings) [m] along n and b of each ring."""
    return position + np.einsum('xar,akr->krx', across, places)


def _points(array: FloatArray) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in array.tolist()]


def _triangles(rings: int, sides: int) -> IntArray:
    """Vertices of each triangle (triangles, 3), anticlockwise seen from outside.

    Vertices are numbered ring by ring along each side, then come the centres of base and tip.
    """
    number = np.arange(sides * rings).reshape(sides, rings)
    beside = np.roll(number, -1, axis=0)
    near, far = number[:, :-1], number[:, 1:]
    near_beside, far_beside = beside[:, :-1], beside[:, 1:]
    base, tip = np.full((2, sides), [[sides * rings], [sides * rings + 1]])
    parts = (
        (near, near_beside, far),
        (near_beside, far_beside, far),
        (base, beside[:, 0], number[:, 0]),
        (tip, number[:, -1], beside[:, -1]),
    )
    return np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in parts])
