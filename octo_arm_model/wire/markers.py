"""The markers and frames of an arm, and the markers of the uncertainty of an estimate."""

import numpy as np

from octo_arm_model.analysis import drawing
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.wire.cdr import Template, text_field

# Constants of visualization_msgs/Marker.
_TRIANGLE_LIST, _CYLINDER, _LINE_STRIP = 11, 3, 4
ADD, _DELETE = 0, 2

BODY_COLOUR = (0.85, 0.55, 0.5, 0.45)  # transparent, so that the tendons inside are visible
DISC_COLOUR = (0.25, 0.25, 0.3, 0.8)
_ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], '<f8')  # position and quaternion


class _MarkerArray(Template):
    """The template of a visualization_msgs/MarkerArray, to which markers are added."""

    def __init__(self, frame_id: str, count: int) -> None:
        """Begin an array of ``count`` markers; ConfigError if UTF-8 cannot hold ``frame_id``."""
        super().__init__()
        self._frame = text_field('frame_id', frame_id)
        self.count(count)

    def begin(self, namespace: bytes, number: int, kind: int, action: int = ADD) -> None:
        """Add the first fields of a Marker; pose, scale and colour follow."""
        self.header(self._frame)
        self.constants(namespace, np.array([number, kind, action], '<i4'))

    def finish(self, points: int) -> None:
        """Add the last fields of a Marker, with a lifetime until the next one of its name."""
        self.constants(np.zeros(2, '<u4'), np.zeros(1, '<u1'))  # lifetime, frame_locked
        self.count(points)
        if points:
            self.numbers(points, 3)
        self.count(0)  # colors
        self.constants(b'', np.zeros(2, '<u4'), b'', b'')  # no texture: resource, header, format
        self.count(0)  # its data
        self.count(0)  # uv_coordinates
        self.constants(b'', b'', b'')  # text, mesh_resource, mesh_file.filename
        self.count(0)  # mesh_file.data
        self.constants(np.zeros(1, '<u1'))  # mesh_use_embedded_materials

    def triangles(
        self, namespace: bytes, colour: tuple[float, ...], corners: int, action: int = ADD
    ) -> None:
        """Add a Marker of triangles, number 0 of its ``namespace``, whose ``corners`` vary."""
        self.begin(namespace, 0, _TRIANGLE_LIST, action)
        # RViz multiplies the points by the scale.
        self.constants(_ORIGIN, np.ones(3, '<f8'), np.array(colour, '<f4'))
        self.finish(corners)


class MarkersWriter:
    """Writes shapes of one arm as visualization_msgs/MarkerArray.

    Each message replaces the one before, because namespaces and ids do not change: ``body`` 0,
    ``anchorages`` and ``tendons`` from 1 on, in the arm's order.
    """

    def __init__(self, arm: Arm, s: FloatArray, frame_id: str, law: int = LINEAR) -> None:
        """Lay out the markers of ``arm`` in ``frame_id``; ``s`` and ``law`` as in `Drawing`.

        Raises:
            ConfigError: if UTF-8 cannot hold ``frame_id``.
        """
        self._drawing = shape = drawing.Drawing(arm, s, law)
        self._corners = shape.triangles.ravel()
        count = 1 + shape.disc_count + len(shape.tendon_points)
        self._template = markers = _MarkerArray(frame_id, count)
        markers.triangles(b'body', BODY_COLOUR, self._corners.size)
        thickness, colour = np.array([shape.disc_thickness], '<f8'), np.array(DISC_COLOUR, '<f4')
        for index in range(shape.disc_count):
            markers.begin(b'anchorages', index + 1, _CYLINDER)
            markers.poses(1)
            markers.numbers(2)
            markers.constants(thickness, colour)
            markers.finish(0)
        for index, points in enumerate(shape.tendon_points):
            markers.begin(b'tendons', index + 1, _LINE_STRIP)
            markers.constants(_ORIGIN, np.array([shape.line_width, 0.0, 0.0], '<f8'))
            markers.numbers(4, kind='<f4')
            markers.finish(points)

    def write(
        self, backbone: Backbone, sec: int, nanosec: int, largest_tension: float | None = None
    ) -> bytes:
        """Return the markers of one shape at the stations of this writer, with one header.

        Tensions of ``largest_tension`` [N] and above are drawn in full red; None takes the largest
        tension of this shape.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        geometry = self._drawing.draw(backbone.position, backbone.quaternion, backbone.q)
        values = [geometry.vertices[self._corners]]
        for position, quaternion, radius in zip(
            geometry.disc_position, geometry.disc_quaternion, geometry.disc_radius, strict=True
        ):
            values += [position, quaternion, 2.0 * radius]
        colours = drawing.tension_colours(backbone.tensions.ravel(), largest_tension)
        for colour, path in zip(colours, geometry.tendons, strict=True):
            values += [colour, path]
        return self._template.write(sec, nanosec, *values)


class FramesWriter:
    """Writes the frames of shapes of one arm as tf2_msgs/TFMessage.

    Frames are ``<prefix>tip`` and ``<prefix>anchorage_<i>``, numbered from the tip; an anchorage
    at the tip has its own. Stations have none, because every listener on ``/tf`` receives all
    frames. The x axis is the tangent, y is n and z is b, as in the poses of the backbone.
    """

    def __init__(self, arm: Arm, s: FloatArray, base_frame: str, prefix: str = '') -> None:
        """Lay out the frames of ``arm``, which are children of ``base_frame``.

        Their names begin with ``prefix``. ``s`` (stations,) [m] are the stations of all backbones,
        as in `Solver.grid`.

        Raises:
            ConfigError: if UTF-8 cannot hold a name.
        """
        self._stations = [s.size - 1, *drawing.anchorage_stations(arm, s).tolist()]
        parent = text_field('base_frame', base_frame)
        names = ['tip', *(f'anchorage_{number}' for number in range(1, len(self._stations)))]
        self._template = frames = Template()
        frames.count(len(names))
        for name in names:
            frames.header(parent)
            frames.constants(text_field('frame_prefix', prefix + name))
            frames.poses(1)

    def write(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Return the frames of a single solution; raise ConfigError if no stamp holds the time."""
        values = []
        for station in self._stations:
            values += [backbone.position[station], backbone.quaternion[station]]
        return self._template.write(sec, nanosec, *values)


class UncertaintyMarkersWriter:
    """Writes the uncertainty of an estimate as visualization_msgs/MarkerArray.

    The namespaces are ``covariance``, ``contact`` and ``cone``. Each message replaces the one
    before. The markers of the force are deleted if it is not significant.
    """

    def __init__(self, arm: Arm, s: FloatArray, frame_id: str) -> None:
        """Lay out the markers of ``arm`` with stations ``s`` (stations,) [m] in ``frame_id``.

        Raises:
            ConfigError: if UTF-8 cannot hold ``frame_id``.
        """
        self._drawing = drawing.UncertaintyDrawing(arm, s)
        parts = (
            (b'covariance', (0.35, 0.55, 0.85, 0.25), self._drawing.triangles),
            (b'contact', (0.1, 0.43, 0.2, 1.0), drawing.ARROW_TRIANGLES),
            (b'cone', (0.1, 0.43, 0.2, 0.35), drawing.CONE_TRIANGLES),
        )
        templates = []
        for drawn in (3, 1):  # the markers from this number on are deleted
            markers = _MarkerArray(frame_id, len(parts))
            for number, (name, colour, triangles) in enumerate(parts):
                corners, action = (triangles.size, ADD) if number < drawn else (0, _DELETE)
                markers.triangles(name, colour, corners, action)
            templates.append(markers)
        self._with_force, self._without = templates

    def write(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        covariance: FloatArray,
        contact: tuple[float, FloatArray, FloatArray],
        sec: int,
        nanosec: int,
    ) -> bytes:
        """Return the markers of one estimate: `UncertaintyDrawing.tube` and `.arrow`.

        The arrays are (S, 3), (S, 4) and (S, 6, 6). ``contact`` is the s [m] of a force, the force
        (3,) [N] and its covariance (3, 3) [N^2].

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        s, force, force_covariance = contact
        tube = self._drawing.tube(position, quaternion, covariance)[self._drawing.triangles]
        arrow = self._drawing.arrow(self._drawing.place(position, s), force, force_covariance)
        if arrow is None:
            return self._without.write(sec, nanosec, tube.reshape(-1, 3))
        parts = tube, arrow.shaft[drawing.ARROW_TRIANGLES], arrow.cone[drawing.CONE_TRIANGLES]
        return self._with_force.write(sec, nanosec, *(part.reshape(-1, 3) for part in parts))
