"""The layout of messages in CDR, from which they are written.

Messages of one arm differ in stamps and numbers alone. A `Layout` describes where these are and
what all other bytes are, as ROS 2 sends them: plain little-endian CDR, every number at a multiple
of its size from where the fields begin. Bytes are laid out once; a template then sets stamps and
numbers. Nothing of ROS is needed.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import ConfigError

ENCAPSULATION = bytes([0, 1, 0, 0])  # plain CDR, little-endian, no options
POSE = 7  # numbers of a pose: x, y, z [m] and the quaternion x, y, z, w
_STAMP = '<u8'  # sec and nanosec as one number


class Slot(NamedTuple):
    """Numbers that differ from message to message.

    Attributes:
        kind: their type, for NumPy.
        place: of the first, in bytes from the first field.
        shape: theirs, of one or two axes.
        step: bytes from one row to the next.
    """

    kind: str
    place: int
    shape: tuple[int, ...]
    step: int

    def view(self, memory: Any, start: int) -> NDArray[Any]:
        """Its numbers in a message whose fields begin at byte ``start`` of ``memory``."""
        strides = (self.step, np.dtype(self.kind).itemsize)[: len(self.shape)]
        return np.ndarray(self.shape, self.kind, memory, start + self.place, strides)


class Layout:
    """The fields of a message, added one by one.

    Attributes:
        fields: its bytes after the encapsulation header, zero where they vary.
        stamps: places of its stamps in ``fields``.
        slots: its numbers that vary.
    """

    def __init__(self, frame: bytes | None = None) -> None:
        """Begin with a header in ``frame``, if one is given."""
        self.fields = bytearray()
        self.stamps: list[int] = []
        self.slots: list[Slot] = []
        if frame is not None:
            self.header(frame)

    def header(self, frame: bytes) -> None:
        """Add a std_msgs/Header, whose stamp varies."""
        self.stamps.append(self._room(4, 2))
        self.string(frame)

    def count(self, value: int) -> None:
        """Add a uint32, such as the length of a sequence."""
        self._constant(4, value.to_bytes(4, 'little'))

    def string(self, text: bytes) -> None:
        """Add a string; its NUL counts."""
        self.count(len(text) + 1)
        self._constant(1, text + b'\0')

    def strings(self, texts: Sequence[bytes]) -> None:
        """Add a sequence of strings."""
        self.count(len(texts))
        for text in texts:
            self.string(text)

    def constants(self, values: NDArray[Any]) -> None:
        """Add an array of constant numbers."""
        self._constant(values.itemsize, values.tobytes())

    def constant_sequence(self, values: NDArray[Any]) -> None:
        """Add a sequence of constant numbers, not empty."""
        self.count(values.size)
        self.constants(values)

    def zeros(self, size: int, count: int) -> None:
        """Add ``count`` numbers of ``size`` bytes that are 0."""
        self._constant(size, bytes(size * count))

    def numbers(self, *shape: int, kind: str = '<f8') -> None:
        """Add an array of numbers that vary."""
        size = np.dtype(kind).itemsize
        place = self._room(size, math.prod(shape))
        self.slots.append(Slot(kind, place, shape, size * shape[-1] if len(shape) > 1 else size))

    def sequence(self, count: int, kind: str = '<f8') -> None:
        """Add a sequence of ``count`` numbers that vary."""
        self.count(count)
        if count:
            self.numbers(count, kind=kind)
        else:  # an empty sequence is not aligned
            self.slots.append(Slot(kind, len(self.fields), (0,), 0))

    def poses(self, count: int, frame: bytes | None = None) -> None:
        """Add poses that vary: slots of positions (count, 3) and quaternions (count, 4).

        Each follows a header in ``frame``, if one is given.
        """
        places = []
        for _ in range(count):
            if frame is not None:
                self.header(frame)
            places.append(self._room(8, POSE))
        step = places[1] - places[0] if count > 1 else 8 * POSE
        self.slots.append(Slot('<f8', places[0], (count, 3), step))
        self.slots.append(Slot('<f8', places[0] + 3 * 8, (count, 4), step))

    def _constant(self, size: int, data: bytes) -> None:
        self._room(size, 0)
        self.fields += data

    def _room(self, size: int, count: int) -> int:
        """Add zeros for ``count`` numbers of ``size`` bytes, aligned; returns their place."""
        place = aligned(len(self.fields), size)
        self.fields += bytes(place + size * count - len(self.fields))
        return place

    def stamp_slots(self) -> list[Slot]:
        """Its stamps as numbers of 8 bytes, those that are equally far apart as one slot.

        The headers of a path are, but for its own and that of its first pose: counts are between
        these, and what pads the first may differ.
        """
        others = self.stamps[2:]
        steps = np.unique(np.diff(others))
        if steps.size != 1:
            return [Slot(_STAMP, place, (1,), 8) for place in self.stamps]
        slots = [Slot(_STAMP, place, (1,), 8) for place in self.stamps[:2]]
        return [*slots, Slot(_STAMP, others[0], (len(others),), int(steps[0]))]


def aligned(place: int, size: int) -> int:
    """The first multiple of ``size`` from ``place`` on."""
    return place + -place % size


def text_field(what: str, text: str) -> bytes:
    """UTF-8 up to the first NUL, where strings of ROS messages end."""
    try:
        return text.encode().split(b'\0')[0]
    except UnicodeEncodeError as error:
        raise ConfigError(f'{what} is {text!r}, which UTF-8 cannot hold') from error


_FIELDS = 8  # where the fields begin in memory, so that NumPy finds its numbers aligned
_START = _FIELDS - len(ENCAPSULATION)


class Template:
    """A message in whose memory stamps and numbers are written again and again."""

    def __init__(self, layout: Layout) -> None:
        """Take the fields of ``layout``."""
        memory = bytearray(_START) + ENCAPSULATION + layout.fields
        self._message = memoryview(memory)[_START:]
        self._slots = [slot.view(memory, _FIELDS) for slot in layout.slots]
        self._stamps = [slot.view(memory, _FIELDS) for slot in layout.stamp_slots()]

    def write(self, sec: int, nanosec: int, *values: NDArray[Any]) -> bytes:
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
