"""The messages of a backbone as bytes, written into templates instead of built as objects.

Those of one arm differ in stamps and numbers alone, so all else is laid out once, as ROS 2 sends
it: plain CDR, every number at a multiple of its size. Nothing of ROS is needed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.rod.backbone import Backbone

_ENCAPSULATION = bytes([0, 1, 0, 0])  # plain CDR, little-endian, no options
_FIELDS = 8  # where the fields begin in a template: numbers are then aligned for NumPy too
_START = _FIELDS - len(_ENCAPSULATION)
_POSE = 7  # numbers of a pose: x, y, z [m] and the quaternion x, y, z, w


class Layout:
    """A message that grows field by field.

    Attributes:
        fields: its bytes after the encapsulation header, where all places are counted from.
        stamps: places of its stamps.
        slots: the numbers that change: their type, place and shape, and the bytes between rows.
    """

    def __init__(self, frame: bytes | None = None) -> None:
        """Begin with a header in ``frame``, if one is given."""
        self.fields = bytearray()
        self.stamps: list[int] = []
        self.slots: list[tuple[str, int, tuple[int, ...], int]] = []
        if frame is not None:
            self.header(frame)

    def header(self, frame: bytes) -> None:
        """Add a std_msgs/Header, its stamp still to be written."""
        self.stamps.append(self.room(4, 2))
        self.string(frame)

    def count(self, value: int) -> None:
        """Add the uint32 that says how much follows."""
        self.room(4, 0)
        self.fields += value.to_bytes(4, 'little')

    def string(self, text: bytes) -> None:
        """Add a string; its NUL counts."""
        self.count(len(text) + 1)
        self.fields += text + b'\0'

    def constants(self, values: NDArray[Any]) -> None:
        """Add a sequence of numbers, not empty, that stay as they are."""
        self.count(values.size)
        self.fixed(values)

    def fixed(self, values: NDArray[Any]) -> None:
        """Add numbers that stay as they are, without their count."""
        self.room(values.itemsize, 0)
        self.fields += values.tobytes()

    def numbers(self, *shape: int, kind: str = '<f8') -> None:
        """Add numbers still to be written, without their count."""
        size = np.dtype(kind).itemsize
        place = self.room(size, math.prod(shape))
        self.slots.append((kind, place, shape, size * shape[-1] if len(shape) > 1 else size))

    def sequence(self, count: int) -> None:
        """Add a sequence of ``count`` float64 still to be written."""
        self.count(count)
        # Where there are no numbers there is nothing to align.
        place = self.room(8, count) if count else len(self.fields)
        self.slots.append(('<f8', place, (count,), 8))

    def poses(self, place: int, count: int, step: int = 8 * _POSE) -> None:
        """Say that positions (count, 3) and quaternions (count, 4) are written from ``place``."""
        self.slots.append(('<f8', place, (count, 3), step))
        self.slots.append(('<f8', place + 3 * 8, (count, 4), step))

    def room(self, size: int, count: int) -> int:
        """Make room for ``count`` numbers of ``size`` bytes and return their place."""
        self.fields += bytes(-len(self.fields) % size)
        place = len(self.fields)
        self.fields += bytes(size * count)
        return place


class Template:
    """A message whose numbers and stamps are written again and again."""

    def __init__(self, layout: Layout) -> None:
        """Take the fields of ``layout``."""
        self._memory = bytearray(_START) + _ENCAPSULATION + layout.fields
        self._message = memoryview(self._memory)[_START:]
        self._slots = [self._view(*slot) for slot in layout.slots]
        # The headers of a path are equally far apart, except its own and that of the first pose:
        # counts are between these, and what pads the first may differ.
        others = np.array(layout.stamps[2:])
        steps = np.diff(others)
        if steps.size and (steps == steps[0]).all():
            runs = [(others[0], others.size, steps[0])]
        else:
            runs = [(place, 1, 8) for place in others]
        runs += [(place, 1, 8) for place in layout.stamps[:2]]
        self._stamps = [self._view('<u8', place, (count,), step) for place, count, step in runs]

    def write(self, sec: int, nanosec: int, *values: FloatArray) -> bytes:
        """Copy of the message with a stamp and the ``values`` of its slots, in their order.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        if not (-(2**31) <= sec < 2**31 and 0 <= nanosec < 2**32):
            raise ConfigError(f'stamp is {sec} s, {nanosec} ns, expected an int32 and a uint32')
        stamp = np.uint64((nanosec << 32) | (sec & 0xFFFFFFFF))
        for stamps in self._stamps:
            stamps.fill(stamp)
        for slot, new in zip(self._slots, values):
            slot[...] = new
        return self._message.tobytes()

    def _view(self, kind: str, place: int, shape: tuple[int, ...], step: int) -> NDArray[Any]:
        strides = (step, np.dtype(kind).itemsize)[: len(shape)]
        return np.ndarray(shape, kind, self._memory, _FIELDS + place, strides)


class BackboneWriter:
    """Writes the messages of single solutions of one arm, for one thread at a time.

    The bytes are those of the messages `octo_arm_model.ros.messages` builds, and stay as they are
    when the next are written. Every method raises ConfigError if a ROS stamp cannot hold ``sec``
    [s] and ``nanosec`` [ns], or if what is to be written is not of the shape laid out for.
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
            ConfigError: if ``s`` and ``section`` are not those of at least two stations, or a name
                is not one that UTF-8 can hold.
        """
        if s.ndim != 1 or s.size < 2 or section.shape != s.shape:
            shapes = f's is of shape {s.shape} and section of {section.shape}'
            raise ConfigError(f'{shapes}, expected one value for each of two or more stations')
        self._model, self._s, self._section = model, s, section
        self._position_shape, self._tendons = (s.size, 3), len(tendon_names)
        frame = text_field('frame_id', frame_id)
        self._poses = Template(_pose_array(frame, s.size))
        self._path = Template(_path(frame, s.size))
        self._strains = Template(_section_strains(frame, text_field('model', model), s, section))
        self._tip = Template(_pose_with_covariance(frame))
        self._lengths = Template(_joint_state(frame, tendon_names))

    def poses(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message geometry_msgs/PoseArray."""
        self._check(backbone)
        return self._poses.write(sec, nanosec, backbone.position, backbone.quaternion)

    def path(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message nav_msgs/Path, every pose with the same header."""
        self._check(backbone)
        return self._path.write(sec, nanosec, backbone.position, backbone.quaternion)

    def strains(self, backbone: Backbone, sec: int, nanosec: int) -> bytes:
        """Message octo_arm_msgs/SectionStrains; ConfigError also for another model or arm."""
        self._check(backbone)
        same = backbone.model == self._model
        for own, given in ((self._s, backbone.s), (self._section, backbone.section)):
            # Solutions of one solver share these arrays, which is quick to see.
            same = same and (given is own or np.array_equal(given, own))
        if not same:
            raise ConfigError('the backbone is of another model or other stations')
        new = backbone.tau, backbone.xi, backbone.k, backbone.q
        return self._strains.write(sec, nanosec, *new)

    def tip_pose(
        self, backbone: Backbone, covariance: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """Message geometry_msgs/PoseWithCovarianceStamped of the tip, ``covariance`` (6, 6)."""
        self._check(backbone)
        if covariance.shape != (6, 6):
            raise ConfigError(f'covariance is of shape {covariance.shape}, expected (6, 6)')
        new = backbone.position[-1:], backbone.quaternion[-1:], covariance
        return self._tip.write(sec, nanosec, *new)

    def tendon_lengths(
        self, lengths: FloatArray, tensions: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """Message sensor_msgs/JointState: lengths [m] as position, tensions [N] as effort."""
        counts = lengths.size, tensions.size
        if counts != (self._tendons, self._tendons):
            raise ConfigError(f'{counts} lengths and tensions, expected {self._tendons} of each')
        return self._lengths.write(sec, nanosec, lengths.ravel(), tensions.ravel())

    def _check(self, backbone: Backbone) -> None:
        if backbone.position.shape != self._position_shape:
            shape, expected = backbone.position.shape, self._position_shape
            what = 'a single solution with the stations of this writer'
            raise ConfigError(f'position is of shape {shape}, expected {expected}: {what}')


def _pose_array(frame: bytes, stations: int) -> Layout:
    layout = Layout(frame)
    layout.count(stations)
    layout.poses(layout.room(8, _POSE * stations), stations)
    return layout


def _path(frame: bytes, stations: int) -> Layout:
    layout = Layout(frame)
    layout.count(stations)
    places = []
    for _ in range(stations):
        layout.header(frame)
        places.append(layout.room(8, _POSE))
    layout.poses(places[0], stations, places[1] - places[0])
    return layout


def _section_strains(frame: bytes, model: bytes, s: FloatArray, section: IntArray) -> Layout:
    layout = Layout(frame)
    layout.string(model)
    layout.constants(s.astype('<f8'))
    layout.constants(section.astype('<i4'))
    for _ in ('tau', 'xi', 'k', 'q'):
        layout.sequence(s.size)
    return layout


def _pose_with_covariance(frame: bytes) -> Layout:
    layout = Layout(frame)
    layout.poses(layout.room(8, _POSE), 1)
    layout.numbers(6, 6)
    return layout


def _joint_state(frame: bytes, names: Sequence[str]) -> Layout:
    layout = Layout(frame)
    layout.count(len(names))
    for name in names:
        layout.string(text_field('tendon name', name))
    layout.sequence(len(names))
    layout.count(0)  # no velocities
    layout.sequence(len(names))
    return layout


def text_field(what: str, text: str) -> bytes:
    """UTF-8 up to the first NUL, where strings of ROS messages end."""
    try:
        return text.encode().split(b'\0')[0]
    except UnicodeEncodeError as error:
        raise ConfigError(f'{what} is {text!r}, which UTF-8 cannot hold') from error
