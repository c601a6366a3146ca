"""The markers of how well an estimated shape and the force on it are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from octo_arm_model.analysis.geometry.uncertainty_mesh import (
    ARROW_TRIANGLES,
    CONE_TRIANGLES,
    UncertaintyDrawing,
)
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.wire.cdr.drawing import ADD, add_triangles
from octo_arm_model.wire.cdr.layout import Layout, text_field
from octo_arm_model.wire.cdr.templates import Template

_DELETE = 2  # of visualization_msgs/Marker


class _Part(NamedTuple):
    """A marker: its namespace, colour and triangles."""

    name: bytes
    colour: tuple[float, float, float, float]
    triangles: IntArray


class UncertaintyMarkersWriter:
    """Writes them as visualization_msgs/MarkerArray.

    Their namespaces are ``covariance``, ``contact`` and ``cone``. They replace those of the
    message before; the force is deleted where it may as well be none.
    """

    def __init__(self, arm: Arm, s: FloatArray, frame_id: str) -> None:
        """Lay out the markers of ``arm`` with stations ``s`` (stations,) [m] in ``frame_id``.

        Raises:
            ConfigError: if UTF-8 cannot hold ``frame_id``.
        """
        self._drawing = UncertaintyDrawing(arm, s)
        frame = text_field('frame_id', frame_id)
        tube = _Part(b'covariance', (0.35, 0.55, 0.85, 0.25), self._drawing.triangles)
        force = _Part(b'contact', (0.1, 0.43, 0.2, 1.0), ARROW_TRIANGLES)
        cone = _Part(b'cone', (0.1, 0.43, 0.2, 0.35), CONE_TRIANGLES)
        parts = tube, force, cone
        self._with_force, self._without = _template(frame, parts, 3), _template(frame, parts, 1)

    def write(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        covariance: FloatArray,
        s: float,
        force: FloatArray,
        of_force: FloatArray,
        sec: int,
        nanosec: int,
    ) -> bytes:
        """Markers of one estimate; see `UncertaintyDrawing.tube` and `UncertaintyDrawing.arrow`.

        ``force`` (3,) [N] acts at ``s`` [m], see `UncertaintyDrawing.place`; ``of_force`` (3, 3)
        [N^2] is its covariance.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        tube = self._drawing.tube(position, quaternion, covariance)[self._drawing.triangles]
        arrow = self._drawing.arrow(self._drawing.place(position, s), force, of_force)
        if arrow is None:
            return self._without.write(sec, nanosec, tube.reshape(-1, 3))
        parts = tube, arrow.shaft[ARROW_TRIANGLES], arrow.cone[CONE_TRIANGLES]
        return self._with_force.write(sec, nanosec, *(part.reshape(-1, 3) for part in parts))


def _template(frame: bytes, parts: Sequence[_Part], shown: int) -> Template:
    """A message with markers of the first ``shown`` ``parts``, whose points vary.

    The others are deleted.
    """
    layout = Layout()
    layout.count(len(parts))
    for number, part in enumerate(parts):
        corners, action = (part.triangles.size, ADD) if number < shown else (0, _DELETE)
        add_triangles(layout, frame, part.name, part.colour, corners, action)
    return Template(layout)
