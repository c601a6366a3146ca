"""Messages of tensions read from their bytes: those laid out like one that was read in full.

A publisher repeats names and frame in every message. Where all bytes but stamp, numbers and
padding are those of a message that was read in full, so is what they mean.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.wire.cdr import ENCAPSULATION, Comparison, Layout
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tensions import TensionMessage

_FIELDS = len(ENCAPSULATION)
_STAMP = struct.Struct('<iI')


class TensionBatch(NamedTuple):
    """Messages of one layout, out of some that were given.

    Attributes:
        places: which of those given they are.
        tensions: theirs [N], (n, *Arm.tension_shape).
        stamps: theirs; None where their type has none.
    """

    places: list[int]
    tensions: FloatArray
    stamps: list[Stamp] | None


class TensionLayout:
    """Reads messages laid out like an example, one or many at once.

    Attributes:
        arm: the arm they are for.
    """

    def __init__(self, kind: TensionMessage, example: bytes, message: Any, arm: Arm) -> None:
        """Lay out an ``example`` that was decoded as ``message`` and fits ``arm``.

        Where its bytes are not laid out as ``kind`` says, not even the example is like it.
        """
        self.arm = arm
        layout = Layout()
        for name, add in kind.fields.items():
            if name == kind.tensions:
                number = len(layout.slots)
            add(layout, getattr(message, name))
        self._slot = layout.slots[number]
        self._stamp = layout.stamps[0] if kind.has_stamp else None
        self._comparison = Comparison(layout, len(example))
        self._order: list[int] | None = None
        if kind.names is not None:
            place_of = {name: place for place, name in enumerate(getattr(message, kind.names))}
            order = [place_of[name] for name in arm.tendon_names]
            self._order = None if order == sorted(order) else order

    def read(self, data: bytes) -> tuple[FloatArray, Stamp | None] | None:
        """Tensions [N], of `Arm.tension_shape`, and the stamp; None if laid out otherwise."""
        if not self._comparison.holds(data):
            return None
        kind, place, (count,), _ = self._slot
        tensions = np.frombuffer(data, kind, count, _FIELDS + place)
        if self._order is not None:
            tensions = tensions[self._order]
        tensions = tensions.astype(np.float64, copy=False).reshape(self.arm.tension_shape)
        if self._stamp is None:
            return tensions, None
        return tensions, Stamp(*_STAMP.unpack_from(data, _FIELDS + self._stamp))

    def read_all(self, messages: Sequence[bytes]) -> TensionBatch:
        """Read those of ``messages`` that have this layout."""
        size = self._comparison.size
        places = [place for place, data in enumerate(messages) if len(data) == size]
        rows = np.empty((0, 0), np.uint8)
        if places:
            joined = b''.join(messages[place] for place in places)
            rows = np.frombuffer(joined, np.uint8).reshape(-1, size)
            is_alike = self._comparison.hold(rows)
            rows, places = rows[is_alike], list(itertools.compress(places, is_alike))
        tensions = self._slot.view(rows, _FIELDS, len(rows), size)
        if self._order is not None:
            tensions = tensions[:, self._order]
        tensions = np.array(tensions, np.float64).reshape(-1, *self.arm.tension_shape)
        if self._stamp is None:
            return TensionBatch(places, tensions, None)
        first = _FIELDS + self._stamp
        pairs = _STAMP.iter_unpack(rows[:, first : first + _STAMP.size].tobytes())
        return TensionBatch(places, tensions, [Stamp(*pair) for pair in pairs])
