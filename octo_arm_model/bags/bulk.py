"""Many messages of one kind at a time, where `BackboneWriter` writes one by one.

The same bytes, from its own messages: where they hold stamps and numbers is found by changing
these, every bit of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from octo_arm_model.backbone import Backbone
from octo_arm_model.hints import FloatArray, IntArray

_WORD = 8  # bytes of a number
_HEAD = 4  # bytes before the fields, which places are counted from


class Bulk:
    """Messages of one kind for one arm."""

    def __init__(
        self, write: Callable[[Backbone, int, int], bytes], filled: Callable[[float], Backbone]
    ) -> None:
        """Learn from ``write``, given shapes ``filled`` with one number."""
        ones = float(np.int64(-1).view(np.float64))
        examples = [
            write(filled(0.0), 0, 0),
            write(filled(0.0), -1, 2**32 - 1),
            write(filled(ones), 0, 0),
        ]
        self._message = slice(_WORD - _HEAD, _WORD - _HEAD + len(examples[0]))
        none, stamped, numbered = (np.frombuffer(_padded(one), np.uint8) for one in examples)
        self._row = none
        changed = np.flatnonzero((none != stamped).view('<u4'))
        self._sec, self._nanosec = changed[::2], changed[1::2]
        numbers = np.flatnonzero((none != numbered).view('<u8'))
        # Numbers come in runs of one length, equally far apart.
        self._first = int(numbers[0])
        ends = np.flatnonzero(np.diff(numbers) > 1)
        self._length = int(ends[0]) + 1 if ends.size else numbers.size
        self._runs = numbers.size // self._length
        self._apart = int(numbers[self._length] - numbers[0]) if ends.size else 0
        run, place = np.divmod(np.arange(numbers.size), self._length)
        assert np.array_equal(numbers, self._first + run * self._apart + place)

    def write(self, stamps_ns: IntArray, numbers: FloatArray) -> list[memoryview]:
        """Messages with ``stamps_ns`` (n,) [ns] and ``numbers`` (n, ...) in their order there."""
        count = len(stamps_ns)
        rows = np.empty((count, self._row.size), np.uint8)
        rows[:] = self._row
        sec, nanosec = np.divmod(stamps_ns, 10**9)
        words = rows.view('<u4')
        words[:, self._sec] = sec.astype('<i4').view('<u4')[:, np.newaxis]
        words[:, self._nanosec] = nanosec.astype('<u4')[:, np.newaxis]
        runs: FloatArray = np.ndarray(
            (count, self._runs, self._length), '<f8', rows, _WORD * self._first,
            (self._row.size, _WORD * self._apart, _WORD),
        )  # fmt: skip
        runs[...] = numbers.reshape(count, self._runs, self._length)
        flat, size = rows.reshape(-1).data, self._row.size
        first, last = self._message.start, self._message.stop
        return [flat[i * size + first : i * size + last] for i in range(count)]


def _padded(message: bytes) -> bytes:
    """The ``message`` with its fields at a multiple of a word, as long as one."""
    padded = bytes(_WORD - _HEAD) + message
    return padded + bytes(-len(padded) % _WORD)
