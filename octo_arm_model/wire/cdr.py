"""The layout of messages in CDR, and templates that write them.

Messages of one arm differ only in stamps and numbers. A `Layout` holds the places of these and all
other bytes, as ROS 2 sends them: plain little-endian CDR, in which every number is at a multiple
of its size from the first field. Bytes are laid out once; a `Template` then sets stamps and
numbers. ROS is not needed.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import ConfigError

ENCAPSULATION = bytes([0, 1, 0, 0])  # plain CDR, little-endian, no options
POSE = 7  # numbers of a pose: x, y, z [m] and the quaternion x, y, z, w


class Layout:
    """The fields of a message, added one by one.

    Attributes:
        fields: bytes of the message after the encapsulation header, zero where they vary.
        stamps: places of the stamps in ``fields``, multiples of 4.
        slots: arrays of numbers that vary: their NumPy type, the place of the first number, their
            shape, and the strides in bytes along each axis.
    """

    def __init__(self, frame: bytes | None = None) -> None:
        """Begin with a header in ``frame``, if one is given."""
        self.fields = bytearray()
        self.stamps: list[int] = []
        self.slots: list[tuple[str, int, tuple[int, ...], tuple[int, ...]]] = []
        if frame is not None:
            self.header(frame)

    def header(self, frame: bytes) -> None:
        """Add a std_msgs/Header, whose stamp varies."""
        self.stamps.append(self._room(4, 2))
        self.constants(frame)

    def count(self, value: int) -> None:
        """Add a uint32, such as the length of a sequence."""
        self.constants(np.array(value, '<u4'))

    def constants(self, *values: bytes | NDArray[Any]) -> None:
        """Add strings and arrays of numbers that do not vary."""
        for value in values:
            if isinstance(value, bytes):
                self.count(len(value) + 1)  # with the NUL at the end
                self.fields += value + b'\0'
            else:
                self._room(value.itemsize, 0)
                self.fields += value.tobytes()

    def numbers(self, *shape: int, kind: str = '<f8') -> None:
        """Add an array of numbers that vary."""
        size = np.dtype(kind).itemsize
        strides = np.empty(shape, kind).strides
        self.slots.append((kind, self._room(size, math.prod(shape)), shape, strides))

    def sequence(self, count: int, kind: str = '<f8') -> None:
        """Add a sequence of ``count`` numbers that vary."""
        self.count(count)
        if count:
            self.numbers(count, kind=kind)
        else:  # an empty sequence is not aligned
            self.slots.append((kind, 0, (0,), (1,)))

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
        self.slots.append(('<f8', places[0], (count, 3), (step, 8)))
        self.slots.append(('<f8', places[0] + 3 * 8, (count, 4), (step, 8)))

    def _room(self, size: int, count: int) -> int:
        """Add aligned zeros for ``count`` numbers of ``size`` bytes, and return their place."""
        place = aligned(len(self.fields), size)
        self.fields += bytes(place + size * count - len(self.fields))
        return place


def aligned(place: int, size: int) -> int:
    """Return the first multiple of ``size`` from ``place`` on."""
    return place + -place % size


def text_field(label: str, text: str) -> bytes:
    """Return a ``text`` in UTF-8 up to the first NUL, where strings of ROS messages end."""
    try:
        return text.encode().split(b'\0')[0]
    except UnicodeEncodeError as error:
        raise ConfigError(f'{label} is {text!r}, which UTF-8 cannot hold') from error


_FIELDS = 8  # place of the fields in memory, so that numbers are aligned for NumPy
_START = _FIELDS - len(ENCAPSULATION)


class Template:
    """A message whose stamps and numbers are overwritten for each copy."""

    def __init__(self, layout: Layout) -> None:
        """Take the fields of ``layout``."""
        memory = bytearray(_START) + ENCAPSULATION + layout.fields
        self._message = memoryview(memory)[_START:]
        self._slots: list[NDArray[Any]] = [
            np.ndarray(shape, kind, memory, _FIELDS + place, strides)
            for kind, place, shape, strides in layout.slots
        ]
        self._words = np.frombuffer(memory, '<u4', (len(memory) - _FIELDS) // 4, _FIELDS)
        self._stamps = np.add.outer(np.array(layout.stamps, np.intp) // 4, [0, 1])

    def write(self, sec: int, nanosec: int, *values: NDArray[Any]) -> bytes:
        """Return a copy of the message with a stamp and the ``values`` of its slots, in order.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        if not (-(2**31) <= sec < 2**31 and 0 <= nanosec < 2**32):
            raise ConfigError(f'stamp is {sec} s, {nanosec} ns, expected an int32 and a uint32')
        self._words[self._stamps] = sec & 0xFFFFFFFF, nanosec
        for slot, value in zip(self._slots, values):
            slot[...] = value
        return self._message.tobytes()
