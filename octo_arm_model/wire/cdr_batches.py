"""Many messages of one kind at a time, where `BackboneWriter` writes one by one.

The same bytes, from its own messages: where they hold stamps and numbers is found by changing
these, every bit of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.rod.backbone import Backbone

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
        self._make_room(0)

    def _make_room(self, count: int) -> None:
        """Have ``count`` messages lie ready, of which only stamps and numbers change."""
        self._rows = np.tile(self._row, (count, 1))
        first, last, size = self._message.start, self._message.stop, self._row.size
        flat = self._rows.reshape(-1).data
        self._messages = [flat[i * size + first : i * size + last] for i in range(count)]

    def write(
        self, stamps: IntArray, numbers: Sequence[FloatArray], first: int
    ) -> list[memoryview]:
        """Messages with ``stamps`` (n, 2) and ``numbers``, each (n, rows, columns).

        Stamps are sec and nanosec. Numbers stand there row by row, the columns of each of the
        ``numbers`` in turn. The messages are those from ``first`` on that are held here, and stay
        as they are until these are written again.
        """
        part = slice(first, first + len(stamps))
        if part.stop > len(self._messages):
            # Those written before stay with whoever has them.
            self._make_room(part.stop)
        rows = self._rows[part]
        sec, nanosec = stamps.T
        words = rows.view('<u4')
        words[:, self._sec] = sec.astype('<i4').view('<u4')[:, np.newaxis]
        words[:, self._nanosec] = nanosec.astype('<u4')[:, np.newaxis]
        width = sum(columns.shape[-1] for columns in numbers)
        in_run = self._length // width  # rows
        runs: FloatArray = np.ndarray(
            (len(rows), self._runs, in_run, width), '<f8', rows, _WORD * self._first,
            (self._row.size, _WORD * self._apart, _WORD * width, _WORD),
        )  # fmt: skip
        done = 0
        for columns in numbers:
            place = runs[..., done : done + columns.shape[-1]]
            place[...] = columns.reshape(place.shape)
            done += columns.shape[-1]
        return self._messages[part]


def _padded(message: bytes) -> bytes:
    """The ``message`` with its fields at a multiple of a word, as long as one."""
    padded = bytes(_WORD - _HEAD) + message
    return padded + bytes(-len(padded) % _WORD)
