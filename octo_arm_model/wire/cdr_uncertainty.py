"""The markers of how well an estimated shape and the force on it are known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.analysis.uncertainty_mesh import (
    ARROW_TRIANGLES,
    CONE_TRIANGLES,
    UncertaintyDrawing,
)
from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.wire.cdr_drawing import ORIGIN, TRIANGLE_LIST, begin_marker, finish_marker
from octo_arm_model.wire.cdr_layout import Layout, text_field
from octo_arm_model.wire.cdr_templates import Template

_ADD, _DELETE = 0, 2  # of visualization_msgs/Marker


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
        self._with_force = _template(frame, [tube, force, cone], [])
        self._without = _template(frame, [tube], [force, cone])

    def write(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        covariance: FloatArray,
        start: FloatArray,
        force: FloatArray,
        of_force: FloatArray,
        sec: int,
        nanosec: int,
    ) -> bytes:
        """Markers of one estimate; see `UncertaintyDrawing.tube` and `UncertaintyDrawing.arrow`.

        ``of_force`` (3, 3) [N^2] is the covariance of ``force``.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        tube = self._drawing.tube(position, quaternion, covariance)[self._drawing.triangles]
        arrow = self._drawing.arrow(start, force, of_force)
        if arrow is None:
            return self._without.write(sec, nanosec, tube.reshape(-1, 3))
        parts = tube, arrow.shaft[ARROW_TRIANGLES], arrow.cone[CONE_TRIANGLES]
        return self._with_force.write(sec, nanosec, *(part.reshape(-1, 3) for part in parts))


def _template(frame: bytes, shown: list[_Part], deleted: list[_Part]) -> Template:
    """A message with the markers ``shown``, whose points vary, and the ``deleted`` ones."""
    layout = Layout()
    layout.count(len(shown) + len(deleted))
    for part in (*shown, *deleted):
        is_shown = any(part is one for one in shown)
        action = _ADD if is_shown else _DELETE
        begin_marker(layout, frame, part.name, 0, TRIANGLE_LIST, action)
        layout.constants(ORIGIN)
        layout.constants(np.ones(3, '<f8'))  # RViz multiplies the points by the scale
        layout.constants(np.array(part.colour, '<f4'))
        finish_marker(layout, part.triangles.size if is_shown else 0)
    return Template(layout)
