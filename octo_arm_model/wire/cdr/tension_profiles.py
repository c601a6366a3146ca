"""The tension along every tendon as sensor_msgs/PointCloud2, which has a stamp and named numbers.

A point for each station, so that RViz colours the backbone by any of the tensions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.wire.cdr.layout import Layout, text_field
from octo_arm_model.wire.cdr.templates import Template

TENSION_PROFILES = 'tendon_tension_profiles'
PREFIX = 'tension_'  # of the field of a tendon, so that none is called as a coordinate
_FLOAT32, _FLOAT64 = 7, 8  # of sensor_msgs/PointField
# A point in memory: x, y and z of 4 bytes, 4 that pad, then s and the tensions of 8.
_AXES, _S, _TENDONS = 3, 2, 3


class TensionProfilesWriter:
    """Writes the tensions of all tendons at all stations of one arm, point by point.

    A point has x, y, z [m] in single precision, as RViz reads them, s [m], and for each tendon
    ``tension_`` and its name [N].
    """

    def __init__(self, frame_id: str, s: FloatArray, tendon_names: Sequence[str]) -> None:
        """Lay out the messages of `Backbone` with these stations ``s`` [m], (stations,).

        Raises:
            ConfigError: if UTF-8 cannot hold a name.
        """
        points = np.zeros((s.size, _TENDONS + len(tendon_names)), '<f8')
        points[:, _S] = s
        self._points, self._tensions = points, points[:, _TENDONS:]
        self._positions = points.view('<f4')[:, :_AXES]
        fields = [(axis, 4 * number, _FLOAT32) for number, axis in enumerate('xyz')]
        for number, name in enumerate(['s', *(PREFIX + name for name in tendon_names)], _S):
            fields.append((name, 8 * number, _FLOAT64))
        layout = Layout(text_field('frame_id', frame_id))
        layout.count(1)  # height
        layout.count(s.size)  # width
        layout.count(len(fields))
        for name, offset, kind in fields:
            layout.string(text_field('tendon name', name))
            layout.count(offset)
            layout.constants(np.array([kind], np.uint8))
            layout.count(1)  # numbers of this name
        layout.zeros(1, 1)  # is_bigendian
        layout.count(points.strides[0])  # bytes of a point
        layout.count(points.nbytes)  # and of the row that all are in
        layout.sequence(points.nbytes, kind='|u1')
        layout.constants(np.array([1], np.uint8))  # is_dense: no number is missing
        self._template = Template(layout)

    def write(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message of a single solution with the stations and tendons of this writer.

        Raises:
            ConfigError: if it has others, or a ROS stamp cannot hold ``sec`` [s] and ``nanosec``
                [ns].
        """
        tensions = backbone.tendon_tensions
        if tensions.shape != self._tensions.shape:
            expected = f'expected {self._tensions.shape}: one for each station and tendon'
            raise ConfigError(f'tensions are of shape {tensions.shape}, {expected}')
        self._tensions[...] = tensions
        self._positions[...] = backbone.position
        return self._template.write(sec, nanosec, self._points.view(np.uint8).ravel())
