"""The messages of a backbone as bytes, written and read without objects."""

import struct
from collections.abc import Iterator, Sequence

import numpy as np

from octo_arm_model.arm.errors import MessageError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.wire import cdr

# Of tendons; the second only where some are driven by length.
TENDON_LENGTHS, TENSION_ESTIMATES = 'tendon_lengths', 'tendon_tension_estimates'
TIP_POSE = 'tip_pose'  # whose covariance may be unknown
# Topics on which a backbone is published, and their types.
BACKBONE_TOPICS: dict[str, str] = {
    'backbone/path': 'nav_msgs/msg/Path',
    'backbone/poses': 'geometry_msgs/msg/PoseArray',
    'strains': 'octo_arm_msgs/msg/SectionStrains',
    TIP_POSE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
}


class BackboneWriter:
    """Writes the messages of single solutions of one arm, for one thread at a time.

    The bytes stay as they are when the next are written. Every method raises ConfigError if a ROS
    stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
    """

    def __init__(
        self,
        frame_id: str,
        model: str,
        s: FloatArray,
        section: IntArray,
        tendon_names: Sequence[str] = (),
    ) -> None:
        """Lay out the messages of `Backbone` with this ``model``, ``s`` [m] and ``section``.

        Raises:
            ConfigError: if a name is not one that UTF-8 can hold.
        """
        frame = cdr.text_field('frame_id', frame_id)
        self._poses = cdr.Template(pose_array(frame, s.size))
        self._path = cdr.Template(path(frame, s.size))
        strains = cdr.Layout(frame)
        strains.constants(cdr.text_field('model', model))
        for values in (s.astype('<f8'), section.astype('<i4')):
            strains.count(s.size)
            strains.constants(values)
        for _ in ('tau', 'xi', 'k', 'q'):
            strains.sequence(s.size)
        self._strains = cdr.Template(strains)
        self._tip = cdr.Template(pose_with_covariance(frame))
        lengths = tendon_tensions(frame, tendon_names)  # but that the numbers are positions
        lengths.count(0)  # no velocities
        lengths.sequence(len(tendon_names))
        self._lengths = cdr.Template(lengths)
        self._tensions = cdr.Template(tendon_tensions(frame, tendon_names))

    def poses(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message geometry_msgs/PoseArray."""
        return self._poses.write(sec, nanosec, backbone.position, backbone.quaternion)

    def path(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message nav_msgs/Path, every pose with the same header."""
        return self._path.write(sec, nanosec, backbone.position, backbone.quaternion)

    def strains(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message octo_arm_msgs/SectionStrains."""
        new = backbone.tau, backbone.xi, backbone.k, backbone.q
        return self._strains.write(sec, nanosec, *new)

    def tip_pose(
        self, backbone: Backbone, covariance: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """Message geometry_msgs/PoseWithCovarianceStamped of the tip, ``covariance`` (6, 6)."""
        new = backbone.position[-1:], backbone.quaternion[-1:], covariance
        return self._tip.write(sec, nanosec, *new)

    def all(
        self, backbone: Backbone, covariance: FloatArray, sec: int, nanosec: int
    ) -> Iterator[bytes]:
        """Messages on `BACKBONE_TOPICS` in their order, each written when it is iterated to."""
        yield self.path(backbone, sec, nanosec)
        yield self.poses(backbone, sec, nanosec)
        yield self.strains(backbone, sec, nanosec)
        yield self.tip_pose(backbone, covariance, sec, nanosec)

    def tendon_lengths(
        self, lengths: FloatArray, tensions: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """Message sensor_msgs/JointState: lengths [m] as position, tensions [N] as effort."""
        return self._lengths.write(sec, nanosec, lengths.ravel(), tensions.ravel())

    def tensions(self, tensions: FloatArray, sec: int, nanosec: int) -> bytes:
        """Message octo_arm_msgs/TendonTensions of the ``tensions`` of all tendons [N]."""
        return self._tensions.write(sec, nanosec, tensions.ravel())


def pose_array(frame: bytes, stations: int) -> cdr.Layout:
    """Layout of a geometry_msgs/PoseArray."""
    layout = cdr.Layout(frame)
    layout.count(stations)
    layout.poses(stations)
    return layout


def path(frame: bytes, stations: int) -> cdr.Layout:
    """Layout of a nav_msgs/Path, every pose with the header of the whole."""
    layout = cdr.Layout(frame)
    layout.count(stations)
    layout.poses(stations, frame)
    return layout


def pose_with_covariance(frame: bytes) -> cdr.Layout:
    """Layout of a geometry_msgs/PoseWithCovarianceStamped."""
    layout = cdr.Layout(frame)
    layout.poses(1)
    layout.numbers(6, 6)
    return layout


def tendon_tensions(frame: bytes, names: Sequence[str]) -> cdr.Layout:
    """Layout of an octo_arm_msgs/TendonTensions of the tendons ``names``."""
    layout = cdr.Layout(frame)
    layout.count(len(names))
    layout.constants(*(cdr.text_field('tendon name', name) for name in names))
    layout.sequence(len(names))
    return layout


def read_poses(data: bytes) -> tuple[float, FloatArray]:
    """Stamp [s] and poses (poses, 7) of a serialised geometry_msgs/PoseArray.

    Ten times faster than deserialising every pose into an object.

    Raises:
        MessageError: if ``data`` is none.
    """
    try:
        order, start = '<' if data[1] else '>', len(cdr.ENCAPSULATION)
        sec, nanosec, length = struct.unpack_from(f'{order}iII', data, start)
        place = start + cdr.aligned(12 + length, 4)
        (count,) = struct.unpack_from(f'{order}I', data, place)
        place = start + cdr.aligned(place + 4 - start, 8)
        poses = np.frombuffer(data[place : place + 8 * cdr.POSE * count], f'{order}f8')
        return sec + 1e-9 * nanosec, poses.astype(np.float64).reshape(count, cdr.POSE)
    except (IndexError, ValueError, struct.error) as error:
        raise MessageError(f'{len(data)} bytes that are no PoseArray') from error


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
        layout = cdr.Layout(cdr.text_field('frame_id', frame_id))
        layout.count(1)  # height
        layout.count(s.size)  # width
        layout.count(len(fields))
        for name, offset, kind in fields:
            layout.constants(cdr.text_field('tendon name', name))
            layout.count(offset)
            layout.constants(np.array([kind], '<u1'))
            layout.count(1)  # numbers of this name
        layout.constants(np.array([0], '<u1'))  # is_bigendian
        layout.count(points.strides[0])  # bytes of a point
        layout.count(points.nbytes)  # and of the row that all are in
        layout.sequence(points.nbytes, kind='|u1')
        layout.constants(np.array([1], '<u1'))  # is_dense: no number is missing
        self._template = cdr.Template(layout)

    def write(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message of a single solution of this arm; ConfigError as of `cdr.Template`."""
        self._tensions[...] = backbone.tendon_tensions
        self._positions[...] = backbone.position
        return self._template.write(sec, nanosec, self._points.view(np.uint8).ravel())
