"""Writers of messages of a `Layout`: bytes laid out once, then stamps and numbers set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.wire.cdr.layout import ENCAPSULATION, Layout

_ALIGNMENT = 8  # bytes of the largest number
_FIELDS = 8  # where the fields begin in memory, so that NumPy finds its numbers aligned
_START = _FIELDS - len(ENCAPSULATION)


class Template:
    """A message in whose memory stamps and numbers are written again and again."""

    def __init__(self, layout: Layout) -> None:
        """Take the fields of ``layout``."""
        memory = bytearray(_START) + ENCAPSULATION + layout.fields
        self._message = memoryview(memory)[_START:]
        size = len(memory)
        self._slots = [slot.view(memory, _FIELDS, 1, size)[0] for slot in layout.slots]
        self._stamps = [slot.view(memory, _FIELDS, 1, size)[0] for slot in layout.stamp_slots()]

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


class BatchTemplate:
    """Many messages of one layout in one memory, written together."""

    def __init__(self, layout: Layout) -> None:
        """Take the fields of ``layout``."""
        self._layout, self._stamp_slots = layout, layout.stamp_slots()
        message = bytes(_START) + ENCAPSULATION + layout.fields
        self._end = len(message)
        self._row = np.frombuffer(message + bytes(-len(message) % _ALIGNMENT), np.uint8)
        self._allocate(0)

    def _allocate(self, count: int) -> None:
        """Replace the memory by one of ``count`` messages."""
        self._rows = np.tile(self._row, (count, 1))
        flat, size = self._rows.reshape(-1).data, self._row.size
        self._messages = [flat[i * size + _START : i * size + self._end] for i in range(count)]

    def write(
        self, stamps: IntArray, values: Sequence[FloatArray], first: int
    ) -> list[memoryview]:
        """Messages with ``stamps`` (n, 2) and ``values``, for each slot (n, ...) in their order.

        Stamps are sec and nanosec, an int32 and a uint32. The messages are those from ``first`` on
        in the memory, and hold until these are written again.
        """
        part = slice(first, first + len(stamps))
        if part.stop > len(self._messages):
            self._allocate(part.stop)  # messages written before keep the memory they are in
        rows, size = self._rows[part], self._row.size
        sec, nanosec = stamps.astype(np.uint64).T
        packed = (nanosec << np.uint64(32)) | (sec & np.uint64(0xFFFFFFFF))
        for slot in self._stamp_slots:
            slot.view(rows, _FIELDS, len(rows), size)[...] = packed[:, np.newaxis]
        for slot, new in zip(self._layout.slots, values, strict=True):
            view = slot.view(rows, _FIELDS, len(rows), size)
            view[...] = new.reshape(view.shape)
        return self._messages[part]
