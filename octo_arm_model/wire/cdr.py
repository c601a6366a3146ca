"""Templates of messages in CDR.

Messages of one arm differ only in stamps and numbers. A `Template` holds the places of these and
all other bytes, as ROS 2 sends them: plain little-endian CDR, in which every number is at a
multiple of its size from the first field. Bytes are laid out once; then stamps and numbers are
set in each copy. ROS is not needed.
"""

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import ConfigError

ENCAPSULATION = bytes([0, 1, 0, 0])  # plain CDR, little-endian, no options
POSE = 7  # numbers of a pose: x, y, z [m] and the quaternion x, y, z, w
_START = 4  # place of the message in memory, so that numbers are aligned for NumPy


class Template:
    """A message whose fields are added one by one, and which `write` then copies."""

    def __init__(self, frame: bytes | None = None) -> None:
        """Begin with a header in ``frame``, if one is given."""
        self._memory = bytearray(_START) + ENCAPSULATION
        self._stamps: list[int] = []  # their places in memory
        # Type, place of the first number, shape and strides of the arrays that vary.
        self._slots: list[tuple[str, int, tuple[int, ...], tuple[int, ...]]] = []
        if frame is not None:
            self.header(frame)

    def header(self, frame: bytes) -> None:
        """Add a std_msgs/Header, whose stamp varies."""
        self._stamps.append(self._room(4, 2))
        self.constants(frame)

    def count(self, value: int) -> None:
        """Add a uint32, such as the length of a sequence."""
        self.constants(np.array(value, '<u4'))

    def constants(self, *values: bytes | NDArray[Any]) -> None:
        """Add strings and arrays of numbers that do not vary."""
        for value in values:
            if isinstance(value, bytes):
                self.count(len(value) + 1)  # with the NUL at the end
                self._memory += value + b'\0'
            else:
                self._room(value.itemsize, 0)
                self._memory += value.tobytes()

    def numbers(self, *shape: int, kind: str = '<f8') -> None:
        """Add an array of numbers that vary."""
        size = np.dtype(kind).itemsize
        strides = np.empty(shape, kind).strides
        self._slots.append((kind, self._room(size, math.prod(shape)), shape, strides))

    def sequence(self, count: int, kind: str = '<f8') -> None:
        """Add a sequence of ``count`` numbers that vary."""
        self.count(count)
        if count:
            self.numbers(count, kind=kind)
        else:  # an empty sequence is not aligned
            self._slots.append((kind, 0, (0,), (1,)))

    def poses(self, count: int, frame: bytes | None = None) -> None:
        """Add poses that vary: positions (count, 3) and quaternions (count, 4).

        Each follows a header in ``frame``, if one is given.
        """
        places = []
        for _ in range(count):
            if frame is not None:
                self.header(frame)
            places.append(self._room(8, POSE))
        step = places[1] - places[0] if count > 1 else 8 * POSE
        self._slots.append(('<f8', places[0], (count, 3), (step, 8)))
        self._slots.append(('<f8', places[0] + 3 * 8, (count, 4), (step, 8)))

    def _room(self, size: int, count: int) -> int:
        """Add aligned zeros for ``count`` numbers of ``size`` bytes, and return their place."""
        place = aligned(len(self._memory), size)
        self._memory += bytes(place + size * count - len(self._memory))
        return place

    @functools.cached_property
    def _views(self) -> tuple[memoryview, NDArray[Any], NDArray[Any], list[NDArray[Any]]]:
        """The message, its words, the indices of stamps among them, and the arrays that vary."""
        words = np.frombuffer(self._memory, '<u4', len(self._memory) // 4)
        stamps = np.add.outer(np.array(self._stamps, np.intp) // 4, [0, 1])
        slots: list[NDArray[Any]] = [
            np.ndarray(shape, kind, self._memory, place, strides)
            for kind, place, shape, strides in self._slots
        ]
        return memoryview(self._memory)[_START:], words, stamps, slots

    def write(self, sec: int, nanosec: int, *values: NDArray[Any]) -> bytes:
        """Return a copy with a stamp and the ``values`` of what varies, in the order of adding.

        Nothing can be added to the template any more.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        if not (-(2**31) <= sec < 2**31 and 0 <= nanosec < 2**32):
            raise ConfigError(f'stamp is {sec} s, {nanosec} ns, expected an int32 and a uint32')
        message, words, stamps, slots = self._views
        words[stamps] = sec & 0xFFFFFFFF, nanosec
        for slot, value in zip(slots, values):
            slot[...] = value
        return message.tobytes()


def aligned(place: int, size: int) -> int:
    """Return the first multiple of ``size`` from ``place`` on."""
    return place + -place % size


def text_field(label: str, text: str) -> bytes:
    """Return a ``text`` in UTF-8 up to the first NUL, where strings of ROS messages end."""
    try:
        return text.encode().split(b'\0')[0]
    except UnicodeEncodeError as error:
        raise ConfigError(f'{label} is {text!r}, which UTF-8 cannot hold') from error
