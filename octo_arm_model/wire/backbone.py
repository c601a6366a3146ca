"""The messages of a backbone, written and read as bytes without message objects."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import MessageError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver
from octo_arm_model.wire import cdr

# Topics of tendons; the second is written only if some are driven by length.
TENDON_LENGTHS, TENSION_ESTIMATES = 'tendon_lengths', 'tendon_tension_estimates'
TIP_POSE = 'tip_pose'  # left out if its covariance is unknown
# Topics on which a backbone is published, with their types.
BACKBONE_TOPICS: dict[str, str] = {
    'backbone/path': 'nav_msgs/msg/Path',
    'backbone/poses': 'geometry_msgs/msg/PoseArray',
    'strains': 'octo_arm_msgs/msg/SectionStrains',
    TIP_POSE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
}


class BackboneWriter:
    """Writes the messages of single solutions of one arm, for one thread at a time.

    The bytes returned do not change when the next message is written. Every method raises
    ConfigError if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
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
            ConfigError: if UTF-8 cannot hold a name.
        """
        frame = cdr.text_field('frame_id', frame_id)
        self._poses = pose_array(frame, s.size)
        self._path = path(frame, s.size)
        self._strains = strains = cdr.Template(frame)
        strains.constants(cdr.text_field('model', model))
        for values in (s.astype('<f8'), section.astype('<i4')):
            strains.count(s.size)
            strains.constants(values)
        for _ in ('tau', 'xi', 'k', 'q'):
            strains.sequence(s.size)
        self._tip = pose_with_covariance(frame)
        # With positions in place of tensions.
        self._lengths = lengths = tendon_tensions(frame, tendon_names)
        lengths.count(0)  # no velocities
        lengths.sequence(len(tendon_names))
        self._tensions = tendon_tensions(frame, tendon_names)

    @classmethod
    def of(cls, frame_id: str, solver: Solver) -> BackboneWriter:
        """Return a writer for ``solver``; ConfigError if UTF-8 cannot hold a name."""
        grid, names = solver.grid, solver.arm.tendon_names
        return cls(frame_id, solver.model, grid.s, grid.section, names)

    def poses(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Return a geometry_msgs/PoseArray of the stations."""
        return self._poses.write(sec, nanosec, backbone.position, backbone.quaternion)

    def path(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Return a nav_msgs/Path of the stations; every pose has the same header."""
        return self._path.write(sec, nanosec, backbone.position, backbone.quaternion)

    def strains(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Return an octo_arm_msgs/SectionStrains of the stations."""
        values = backbone.tau, backbone.xi, backbone.k, backbone.q
        return self._strains.write(sec, nanosec, *values)

    def tip_pose(
        self, backbone: Backbone, covariance: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """Return a geometry_msgs/PoseWithCovarianceStamped of the tip, ``covariance`` (6, 6)."""
        values = backbone.position[-1:], backbone.quaternion[-1:], covariance
        return self._tip.write(sec, nanosec, *values)

    def all(
        self, backbone: Backbone, covariance: FloatArray | None, sec: int, nanosec: int
    ) -> dict[str, bytes]:
        """Return the messages by topic; no pose of the tip without its ``covariance``."""
        writers = self.path, self.poses, self.strains
        messages = {
            topic: write(backbone, sec, nanosec) for topic, write in zip(BACKBONE_TOPICS, writers)
        }
        if covariance is not None:
            messages[TIP_POSE] = self.tip_pose(backbone, covariance, sec, nanosec)
        return messages

    def tendon_lengths(
        self, lengths: FloatArray, tensions: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """Return a sensor_msgs/JointState: lengths [m] are positions, tensions [N] are efforts."""
        return self._lengths.write(sec, nanosec, lengths.ravel(), tensions.ravel())

    def tensions(self, tensions: FloatArray, sec: int, nanosec: int) -> bytes:
        """Return an octo_arm_msgs/TendonTensions of the ``tensions`` of all tendons [N]."""
        return self._tensions.write(sec, nanosec, tensions.ravel())


def pose_array(frame: bytes, stations: int) -> cdr.Template:
    """Return the template of a geometry_msgs/PoseArray."""
    layout = cdr.Template(frame)
    layout.count(stations)
    layout.poses(stations)
    return layout


def path(frame: bytes, stations: int) -> cdr.Template:
    """Return the template of a nav_msgs/Path, in which every pose has the header of the path."""
    layout = cdr.Template(frame)
    layout.count(stations)
    layout.poses(stations, frame)
    return layout


def pose_with_covariance(frame: bytes) -> cdr.Template:
    """Return the template of a geometry_msgs/PoseWithCovarianceStamped."""
    layout = cdr.Template(frame)
    layout.poses(1)
    layout.numbers(6, 6)
    return layout


def tendon_tensions(frame: bytes, names: Sequence[str]) -> cdr.Template:
    """Return the template of an octo_arm_msgs/TendonTensions of the tendons ``names``."""
    layout = cdr.Template(frame)
    layout.count(len(names))
    layout.constants(*(cdr.text_field('tendon name', name) for name in names))
    layout.sequence(len(names))
    return layout


def read_poses(data: bytes) -> tuple[float, FloatArray]:
    """Return the stamp [s] and the poses (poses, 7) of a serialised geometry_msgs/PoseArray.

    This is ten times faster than deserialising every pose into an object.

    Raises:
        MessageError: if ``data`` is not a PoseArray.
    """
    try:
        order, start = {b'\0\0': '>', b'\0\1': '<'}[bytes(data[:2])], len(cdr.ENCAPSULATION)
        sec, nanosec, length = struct.unpack_from(f'{order}iII', data, start)
        place = start + cdr.aligned(12 + length, 4)
        (count,) = struct.unpack_from(f'{order}I', data, place)
        place = start + cdr.aligned(place + 4 - start, 8)
        end = place + 8 * cdr.POSE * count
        if len(data) - end >= 8:  # a serialiser may append fewer
            raise ValueError
        poses = np.frombuffer(data[place:end], f'{order}f8')
        return sec + 1e-9 * nanosec, poses.astype(np.float64).reshape(count, cdr.POSE)
    except (KeyError, ValueError, struct.error) as error:
        raise MessageError(f'{len(data)} bytes that are no PoseArray') from error


TENSION_PROFILES = 'tendon_tension_profiles'
PREFIX = 'tension_'  # begins the field of a tendon, so that its name cannot be x, y, z or s
_FLOAT32, _FLOAT64 = 7, 8  # constants of sensor_msgs/PointField
# A point in memory: x, y, z of 4 bytes, 4 bytes of padding, then s and the tensions of 8 bytes.
_AXES, _S, _TENDONS = 3, 2, 3


class TensionProfilesWriter:
    """Writes the tensions of all tendons at all stations of one arm as a PointCloud2.

    A point has the fields x, y, z [m] in single precision, as RViz reads them, s [m], and for each
    tendon ``tension_`` followed by its name [N].
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
        self._template = layout = cdr.Template(cdr.text_field('frame_id', frame_id))
        layout.count(1)  # height
        layout.count(s.size)  # width
        layout.count(len(fields))
        for name, offset, kind in fields:
            layout.constants(cdr.text_field('tendon name', name))
            layout.count(offset)
            layout.constants(np.array([kind], '<u1'))
            layout.count(1)  # one number in this field
        layout.constants(np.array([0], '<u1'))  # is_bigendian
        layout.count(points.strides[0])  # bytes of a point
        layout.count(points.nbytes)  # bytes of the only row
        layout.sequence(points.nbytes, kind='|u1')
        layout.constants(np.array([1], '<u1'))  # is_dense: no number is missing

    def write(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Return the message of a single solution; ConfigError if no stamp holds the time."""
        self._tensions[...] = backbone.tendon_tensions
        self._positions[...] = backbone.position
        return self._template.write(sec, nanosec, self._points.view(np.uint8).ravel())
