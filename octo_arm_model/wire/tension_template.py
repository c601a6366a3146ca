"""Messages of tensions like one before them, read without a parser.

A publisher's messages of type octo_arm_msgs/TendonTensions differ in stamps and tensions alone.
Where all other bytes are those of a message that was read in full, so is what they mean.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray

_ENCAPSULATION = bytes([0, 1, 0, 0])  # plain CDR, little-endian, no options
_STAMP = len(_ENCAPSULATION)  # where the fields begin, and every number is aligned from
_FRAME = _STAMP + 8


class Stamp(NamedTuple):
    """Seconds and nanoseconds, as in builtin_interfaces/Time, which takes long to make."""

    sec: int
    nanosec: int

    @classmethod
    def from_ns(cls, nanoseconds: int) -> Stamp:
        """Stamp of a time [ns]."""
        return cls(*divmod(nanoseconds, 10**9))

    @property
    def ns(self) -> int:
        """The time [ns]."""
        return self.sec * 10**9 + self.nanosec


class Familiar:
    """Reads messages that differ from one example in stamp and tensions alone.

    Attributes:
        arm: the arm they are for.
    """

    def __init__(self, example: bytes, names: Sequence[str], arm: Arm) -> None:
        """Learn from an ``example`` that names every tendon of ``arm`` once, as ``names``."""
        self.arm = arm
        self._count = len(names)
        order = [list(names).index(name) for name in arm.tendon_names]
        self._order = None if order == sorted(order) else order
        self._length, self._place, self._fixed = len(example), _FRAME, b''
        if not example.startswith(_ENCAPSULATION):
            self._length = -1  # laid out otherwise: nothing is like it
            return
        # The frame, how many names, the names, how many tensions, the tensions.
        place = _after_number(_after_string(_FRAME, example))
        for _ in names:
            place = _after_string(place, example)
        place = _after_number(place)
        self._place = place + (_STAMP - place) % 8
        self._fixed = example[_FRAME : self._place]

    def read(self, data: bytes) -> tuple[FloatArray, Stamp] | None:
        """Tensions [N] and the stamp; None if it is not so familiar."""
        if (
            len(data) != self._length
            or not data.startswith(_ENCAPSULATION)
            or data[_FRAME : self._place] != self._fixed
        ):
            return None
        tensions = np.frombuffer(data, '<f8', self._count, self._place)
        if self._order is not None:
            tensions = tensions[self._order]
        stamp = Stamp(*struct.unpack_from('<iI', data, _STAMP))
        return tensions.reshape(self.arm.tension_shape), stamp


def _after_string(place: int, data: bytes) -> int:
    """Where the string ends whose length is the next number from ``place``."""
    end = _after_number(place)
    (length,) = struct.unpack_from('<I', data, end - 4)
    return end + int(length)


def _after_number(place: int) -> int:
    """Where the next uint32 from ``place`` ends."""
    return place + -place % 4 + 4
